/* SPDX-License-Identifier: MIT
 *
 * main.c - runs the conformance cases and prints a table of sections.
 *
 *     conformance [-v] [NUMBER...]    only the cases whose number begins like one of these
 *
 * A required case that is missing, or that ran fewer elementary tests than required, counts as
 * that many failed ones. Exit status: 0 all passed, 1 not.
 */
#include "bench.h"

#include <stdio.h>
#include <string.h>

/* Numbers of ISO 16845-1 with the least number of elementary tests; X: beyond the standard. X11 on
 * are ours: overload frames on request, presume-ack, offers withdrawn and replaced, loopback. */
typedef struct requirement {
    const char *number;
    unsigned count;
} requirement;

static const requirement requirements[] = {
    {"7.1.1", 45}, {"7.1.2", 45},  {"7.1.3", 6},  {"7.1.4", 1},  {"7.1.5", 7},  {"7.1.8", 7},
    {"7.1.9", 2},  {"7.1.10", 10}, {"7.1.11", 7}, {"7.1.12", 1}, {"7.2.1", 1},  {"7.2.2", 10},
    {"7.2.3", 8},  {"7.2.5", 3},   {"7.2.6", 1},  {"7.2.7", 1},  {"7.2.9", 1},  {"7.2.10", 5},
    {"7.2.11", 1}, {"7.3.1", 3},   {"7.3.2", 1},  {"7.3.3", 3},  {"7.3.4", 3},  {"7.4.1", 2},
    {"7.4.2", 1},  {"7.4.3", 2},   {"7.4.4", 3},  {"7.4.5", 3},  {"7.4.6", 2},  {"7.4.7", 2},
    {"7.5.1", 3},  {"7.5.2", 1},   {"7.5.3", 3},  {"7.5.4", 1},  {"7.5.5", 3},  {"7.5.6", 3},
    {"7.5.7", 1},  {"7.6.1", 3},   {"7.6.2", 3},  {"7.6.3", 1},  {"7.6.4", 1},  {"7.6.5", 1},
    {"7.6.6", 1},  {"7.6.7", 1},   {"7.6.8", 3},  {"7.6.9", 8},  {"7.6.10", 1}, {"7.6.11", 1},
    {"7.6.12", 2}, {"7.6.13", 2},  {"7.6.14", 1}, {"7.6.15", 1}, {"7.6.16", 1}, {"7.6.17", 1},
    {"7.6.18", 1}, {"7.6.19", 1},  {"7.6.20", 1}, {"7.6.21", 1}, {"8.1.1", 45}, {"8.1.2", 45},
    {"8.1.3", 11}, {"8.1.4", 31},  {"8.1.5", 1},  {"8.1.6", 6},  {"8.1.7", 3},  {"8.1.8", 2},
    {"8.2.1", 13}, {"8.2.2", 14},  {"8.2.3", 6},  {"8.2.4", 4},  {"8.2.5", 5},  {"8.2.6", 1},
    {"8.3.1", 3},  {"8.3.2", 2},   {"8.3.3", 3},  {"8.3.4", 3},  {"8.4.1", 2},  {"8.4.2", 2},
    {"8.4.3", 2},  {"8.4.4", 3},   {"8.4.5", 3},  {"8.5.1", 3},  {"8.5.2", 1},  {"8.5.3", 3},
    {"8.5.4", 3},  {"8.5.5", 1},   {"8.5.6", 1},  {"8.5.7", 1},  {"8.5.8", 1},  {"8.5.9", 3},
    {"8.5.12", 1}, {"8.5.13", 3},  {"8.5.14", 1}, {"8.5.15", 1}, {"8.5.10", 1}, {"8.5.11", 2},
    {"8.6.1", 3},  {"8.6.2", 3},   {"8.6.3", 1},  {"8.6.4", 5},  {"8.6.5", 1},  {"8.6.6", 8},
    {"8.6.7", 5},  {"8.6.8", 1},   {"8.6.9", 3},  {"8.6.10", 2}, {"8.6.11", 1}, {"8.6.12", 1},
    {"8.6.13", 1}, {"8.6.14", 1},  {"8.6.15", 1}, {"8.6.16", 1}, {"8.6.17", 1}, {"8.6.18", 1},
    {"8.6.19", 1}, {"8.6.20", 1},  {"8.6.21", 1}, {"9.6.1", 1},  {"9.6.2", 1},  {"X1", 1},
    {"X2", 1},     {"X3", 1},      {"X4", 1},     {"X5", 1},     {"X6", 1},     {"X7", 1},
    {"X8", 1},     {"X9", 1},      {"X10", 1},    {"X11", 1},    {"X12", 1},    {"X13", 1},
    {"X14", 1},    {"X15", 122},   {"X16", 16},
    /* Inside the bit: all timings of timed.c. */
    {"7.7.1", 3512}, {"7.7.2", 278}, {"7.7.3", 224}, {"7.7.4", 424},
    {"7.7.5", 224}, {"7.7.6", 112}, {"7.7.7", 64}, {"7.7.8", 64},
    {"7.7.9.1", 178}, {"7.7.9.2", 14}, {"7.7.10", 16}, {"7.7.11", 56},
    {"8.7.1", 32},   {"8.7.2", 16},  {"8.7.3", 16},  {"8.7.4", 56},
    {"8.7.5", 28},   {"8.7.6", 16},  {"8.7.7", 178}, {"8.7.8", 16},
    {"8.7.9", 16},
};
#define REQUIRED_COUNT (sizeof requirements / sizeof requirements[0])

static const section *const sections[] = {
    &section_7_1, &section_7_2, &section_7_3, &section_7_4, &section_7_5,
    &section_7_6, &section_7_7, &section_8_1, &section_8_2, &section_8_3, &section_8_4,
    &section_8_5, &section_8_6, &section_8_7, &section_9_6, &section_x,
};
#define SECTION_COUNT (sizeof sections / sizeof sections[0])

typedef struct tally {
    unsigned cases, cases_failed, passed, failed;
} tally;

static tally run_section(const section *s, char **only, int only_count);
static bool belongs(const char *number, const section *s);
static bool wanted(const char *number, char **only, int only_count);
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
    for (size_t i = 0; i < SECTION_COUNT; i++) {
        tally t = run_section(sections[i], argv, argc);
        if (i == 0)
            printf("%-8s %6s %6s %10s %6s %6s\n", "section", "cases", "failed", "elementary",
                   "passed", "failed");
        if (t.cases > 0)
            print_row(sections[i]->name, &t);
        all.cases += t.cases;
        all.cases_failed += t.cases_failed;
        all.passed += t.passed;
        all.failed += t.failed;
    }
    print_row("all", &all);
    printf("%u passed, %u failed\n", all.passed, all.failed);
    return all.failed > 0 || all.passed == 0;
}

/* Runs every entry of the section that has this number. */
static tally run_number(const section *s, const requirement *required)
{
    tally t = {.cases = 1};

    bench_begin(required->number, &t.passed, &t.failed);
    for (unsigned i = 0; i < s->count; i++) {
        const test_case *c = &s->cases[i];
        if (strcmp(c->number, required->number) != 0)
            continue;
        if (c->script)
            bench_run("%s", c->script);
        else
            c->run();
    }
    if (t.passed + t.failed < required->count) {
        printf("FAILED %s: %u elementary tests, %u are required\n", required->number,
               t.passed + t.failed, required->count);
        t.failed += required->count - t.passed - t.failed;
    }
    t.cases_failed = t.failed > 0;
    return t;
}

static unsigned count_unknown(const section *s)
{
    unsigned unknown = 0;

    for (unsigned i = 0; i < s->count; i++) {
        bool found = false;
        for (size_t k = 0; k < REQUIRED_COUNT; k++)
            found |= strcmp(requirements[k].number, s->cases[i].number) == 0;
        if (!found)
            printf("FAILED %s: no such case\n", s->cases[i].number);
        unknown += !found;
    }
    return unknown;
}

static tally run_section(const section *s, char **only, int only_count)
{
    tally sum = {.failed = count_unknown(s)};

    for (size_t i = 0; i < REQUIRED_COUNT; i++) {
        tally t;
        if (!belongs(requirements[i].number, s) ||
            !wanted(requirements[i].number, only, only_count))
            continue;
        t = run_number(s, &requirements[i]);
        sum.cases++;
        sum.cases_failed += t.cases_failed;
        sum.passed += t.passed;
        sum.failed += t.failed;
    }
    return sum;
}

static bool belongs(const char *number, const section *s)
{
    size_t length = strlen(s->name);

    return strncmp(number, s->name, length) == 0 && (number[length] == '.' || number[0] == 'X');
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
