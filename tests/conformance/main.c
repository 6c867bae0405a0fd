/* SPDX-License-Identifier: MIT
 *
 * main.c - runs the conformance cases and prints a table of sections.
 *
 *     conformance [-v] [-c] [NUMBER...]    only the cases whose number begins like one of these
 *
 * -v prints every script and bit, -c the number of elementary tests of each case.
 *
 * A required case that is missing, or that ran fewer elementary tests than required, counts as
 * that many failed ones. Exit status: 0 all passed, 1 not.
 */
#include "bench.h"

#include <stdio.h>
#include <string.h>

static const section *const sections[] = {
    &section_7_1, &section_7_2, &section_7_3, &section_7_4, &section_7_5,
    &section_7_6, &section_7_7, &section_7_8, &section_8_1, &section_8_2, &section_8_3,
    &section_8_4, &section_8_5, &section_8_6, &section_8_7, &section_8_8, &section_9_6, &section_x,
    &section_x_fd,
};
#define SECTION_COUNT (sizeof sections / sizeof sections[0])

typedef struct tally {
    unsigned cases, cases_failed, passed, failed;
} tally;

static bool verbose_counts;

static tally run_table(const required_table *table, char **only, int only_count);
static tally run_section(const section *s, const required_table *table, char **only,
                         int only_count);
static unsigned count_unknown(const section *s);
static bool belongs(const char *number, const section *s);
static bool wanted(const char *number, char **only, int only_count);
static void add(tally *sum, const tally *t);
static void print_row(const char *name, const tally *t);

int main(int argc, char **argv)
{
    tally all = {0};

    argc--;
    argv++;
    if (argc > 0 && strcmp(argv[0], "-v") == 0) {
        bench_set_verbose(true);
        argc--;
        argv++;
    }
    if (argc > 0 && strcmp(argv[0], "-c") == 0) {
        verbose_counts = true;
        argc--;
        argv++;
    }
    for (size_t i = 0; i < SECTION_COUNT; i++)
        all.failed += count_unknown(sections[i]);
    for (unsigned i = 0; i < required_table_count; i++) {
        tally t = run_table(&required_tables[i], argv, argc);
        add(&all, &t);
    }
    printf("%u passed, %u failed\n", all.passed, all.failed);
    return all.failed > 0 || all.passed == 0;
}

static void add(tally *sum, const tally *t)
{
    sum->cases += t->cases;
    sum->cases_failed += t->cases_failed;
    sum->passed += t->passed;
    sum->failed += t->failed;
}

static tally run_table(const required_table *table, char **only, int only_count)
{
    tally all = {0};

    if (table->title)
        printf("\n%s\n", table->title);
    for (size_t i = 0; i < SECTION_COUNT; i++) {
        tally t = run_section(sections[i], table, only, only_count);
        if (i == 0)
            printf("%-8s %6s %6s %10s %6s %6s\n", "section", "cases", "failed", "elementary",
                   "passed", "failed");
        if (t.cases > 0)
            print_row(sections[i]->name, &t);
        add(&all, &t);
    }
    print_row("all", &all);
    return all;
}

/* Runs every entry of the section that has this number. */
static void run_entries(const section *s, const char *number)
{
    for (unsigned i = 0; i < s->count; i++) {
        const test_case *c = &s->cases[i];
        if (strcmp(c->number, number) != 0)
            continue;
        if (c->script)
            bench_run("%s", c->script);
        else
            c->run();
    }
}

static tally run_number(const section *s, const requirement *required, const char *passes)
{
    tally t = {.cases = 1};

    for (; *passes; passes++) {
        bench_set_pass(bench_pass_of(*passes));
        bench_begin(required->number, &t.passed, &t.failed);
        run_entries(s, required->number);
    }
    if (verbose_counts)
        printf("%-8s %u\n", required->number, t.passed + t.failed);
    if (t.passed + t.failed < required->count) {
        printf("FAILED %s: %u elementary tests, %u are required\n", required->number,
               t.passed + t.failed, required->count);
        t.failed += required->count - t.passed - t.failed;
    }
    t.cases_failed = t.failed > 0;
    return t;
}

static bool is_required(const char *number)
{
    for (unsigned i = 0; i < required_table_count; i++) {
        for (size_t k = 0; k < required_tables[i].count; k++) {
            if (strcmp(required_tables[i].rows[k].number, number) == 0)
                return true;
        }
    }
    return false;
}

static unsigned count_unknown(const section *s)
{
    unsigned unknown = 0;

    for (unsigned i = 0; i < s->count; i++) {
        bool found = is_required(s->cases[i].number);
        if (!found)
            printf("FAILED %s: no such case\n", s->cases[i].number);
        unknown += !found;
    }
    return unknown;
}

static tally run_section(const section *s, const required_table *table, char **only,
                         int only_count)
{
    tally sum = {0};

    for (size_t i = 0; i < table->count; i++) {
        const requirement *row = &table->rows[i];
        if (!belongs(row->number, s) || !wanted(row->number, only, only_count))
            continue;
        tally t = run_number(s, row, table->passes);
        add(&sum, &t);
    }
    return sum;
}

static bool belongs(const char *number, const section *s)
{
    size_t length = strlen(s->name);

    return strncmp(number, s->name, length) == 0 && strspn(&number[length], ".0123456789") > 0;
}

static bool wanted(const char *number, char **only, int only_count)
{
    for (int i = 0; i < only_count; i++) {
        if (strncmp(number, only[i], strlen(only[i])) == 0)
            return true;
    }
    return only_count == 0;
}

static void print_row(const char *name, const tally *t)
{
    printf("%-8s %6u %6u %10u %6u %6u\n", name, t->cases, t->cases_failed, t->passed + t->failed,
           t->passed, t->failed);
}
