/* SPDX-License-Identifier: MIT
 *
 * report_junit.c - a report as JUnit XML: a suite for each class of rows or factor.
 *
 * A case fails when a row failed undetected, took too long, or has crashed. It is an error when a
 * row has no result for another reason.
 */
#include "cli/campaign/report_view.h"

#include "base/text/buffer.h"
#include "base/text/jsonput.h"
#include "base/text/junit.h"

#include <inttypes.h>

#define VALUES_MAX 1000u /* cases of a factor */

static uint64_t failures_of(const class_counts *c)
{
    return c->of[CLASS_UNDETECTED] + c->of[CLASS_TIMEOUT] + c->of[CLASS_CRASHED];
}

static uint64_t errors_of(const class_counts *c)
{
    return c->of[CLASS_INVALID] + c->of[CLASS_BROKEN];
}

static void count_case(junit_counts *t, const class_counts *c)
{
    t->cases++;
    t->failures += failures_of(c) > 0;
    t->errors += failures_of(c) == 0 && errors_of(c) > 0;
}

/* Puts how many rows there are of each class. */
static void put_rows(buffer *out, const class_counts *c)
{
    for (unsigned i = 0; i < CLASS_COUNT; i++)
        if (c->of[i] > 0)
            buffer_print(out, "%s%" PRIu64 " %s", buffer_length(out) > 0 ? ", " : "", c->of[i],
                         class_name((row_class)i));
}

/* Writes a value as a test case, which fails when a row of it has failed. */
static void write_case(FILE *out, const char *suite, const char *name, const class_counts *c)
{
    buffer message = {.data = NULL};
    put_rows(&message, c);
    const char *problem = failures_of(c) > 0 ? "failure" : errors_of(c) > 0 ? "error" : NULL;
    const junit_case one = {.name = name, .suite = suite, .ticks = JUNIT_NO_TIME,
                            .problem = problem, .type = "row", .message = buffer_text(&message)};
    if (one.message)
        junit_write_case(out, &one);
    else
        json_no_memory();
    buffer_free(&message);
}

/* Writes a factor as a suite with a test case for each value, up to a limit. */
static void write_suite(FILE *out, const dimension *d)
{
    junit_counts t = {.cases = 0};
    for (size_t i = 0; i < d->count && i < VALUES_MAX; i++)
        count_case(&t, &d->values[i].rows);
    junit_begin_suite(out, d->name, &t, JUNIT_NO_TIME);
    for (size_t i = 0; i < d->count && i < VALUES_MAX; i++)
        write_case(out, d->name, d->values[i].text, &d->values[i].rows);
    junit_end_suite(out);
}

/* A case for each class: all rows of the class. */
static void write_classes(FILE *out, const report *r)
{
    class_counts each[CLASS_COUNT] = {{.of[0] = 0}};
    junit_counts t = {.cases = 0};
    for (unsigned i = 0; i < CLASS_COUNT; i++) {
        each[i].of[i] = r->classes.of[i];
        count_case(&t, &each[i]);
    }
    junit_begin_suite(out, "classes", &t, JUNIT_NO_TIME);
    for (unsigned i = 0; i < CLASS_COUNT; i++)
        write_case(out, "classes", class_name((row_class)i), &each[i]);
    junit_end_suite(out);
}

void campaign_report_junit(FILE *out, const report_view *v)
{
    const report *r = v->report;
    junit_begin(out, r->source.file, NULL, JUNIT_NO_TIME);
    write_classes(out, r);
    for (size_t i = 0; i < r->factor_count; i++)
        write_suite(out, &r->factors[i]);
    junit_end(out);
}
