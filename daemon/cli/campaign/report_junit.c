/* SPDX-License-Identifier: MIT
 *
 * report_junit.c - a report as JUnit XML: a suite for each class of rows or factor.
 *
 * A case fails when a row failed undetected, took too long, or has crashed. It is an error when a
 * row has no result for another reason.
 */
#include "cli/campaign/report_view.h"

#include "base/text/xmltext.h"

#include <inttypes.h>

#define VALUES_MAX 1000u /* cases of a factor */

typedef struct totals {
    uint64_t cases;
    uint64_t failures;
    uint64_t errors;
} totals;

static uint64_t failures_of(const class_counts *c)
{
    return c->of[CLASS_UNDETECTED] + c->of[CLASS_TIMEOUT] + c->of[CLASS_CRASHED];
}

static uint64_t errors_of(const class_counts *c)
{
    return c->of[CLASS_INVALID] + c->of[CLASS_BROKEN];
}

static void count_case(totals *t, const class_counts *c)
{
    t->cases++;
    t->failures += failures_of(c) > 0;
    t->errors += failures_of(c) == 0 && errors_of(c) > 0;
}

static totals totals_of(const dimension *d)
{
    totals t = {.cases = 0};
    for (size_t i = 0; i < d->count && i < VALUES_MAX; i++)
        count_case(&t, &d->values[i].rows);
    return t;
}

static void write_totals(FILE *out, const totals *t)
{
    fprintf(out, " tests=\"%" PRIu64 "\" failures=\"%" PRIu64 "\" errors=\"%" PRIu64
            "\" skipped=\"0\">\n", t->cases, t->failures, t->errors);
}

static void write_message(FILE *out, const class_counts *c)
{
    const char *comma = "";
    fputs(" message=\"", out);
    for (unsigned i = 0; i < CLASS_COUNT; i++) {
        if (c->of[i] == 0)
            continue;
        fprintf(out, "%s%" PRIu64 " %s", comma, c->of[i], class_name((row_class)i));
        comma = ", ";
    }
    fputs("\"/>\n", out);
}

static void write_case(FILE *out, const char *suite, const char *name, const class_counts *c)
{
    const bool failed = failures_of(c) > 0;
    fputs("    <testcase", out);
    xml_attribute(out, "name", name);
    xml_attribute(out, "classname", suite);
    if (!failed && errors_of(c) == 0) {
        fputs("/>\n", out);
        return;
    }
    fprintf(out, ">\n      <%s type=\"row\"", failed ? "failure" : "error");
    write_message(out, c);
    fputs("    </testcase>\n", out);
}

static void write_suite(FILE *out, const dimension *d)
{
    const totals t = totals_of(d);
    fputs("  <testsuite", out);
    xml_attribute(out, "name", d->name);
    write_totals(out, &t);
    for (size_t i = 0; i < d->count && i < VALUES_MAX; i++)
        write_case(out, d->name, d->values[i].text, &d->values[i].rows);
    fputs("  </testsuite>\n", out);
}

/* A case for each class: all rows of the class. */
static void write_classes(FILE *out, const report *r)
{
    totals t = {.cases = 0};
    for (unsigned i = 0; i < CLASS_COUNT; i++) {
        class_counts one = {.of[0] = 0};
        one.of[i] = r->classes.of[i];
        count_case(&t, &one);
    }
    fputs("  <testsuite name=\"classes\"", out);
    write_totals(out, &t);
    for (unsigned i = 0; i < CLASS_COUNT; i++) {
        class_counts one = {.of[0] = 0};
        one.of[i] = r->classes.of[i];
        write_case(out, "classes", class_name((row_class)i), &one);
    }
    fputs("  </testsuite>\n", out);
}

void campaign_report_junit(FILE *out, const report_view *v)
{
    const report *r = v->report;
    fputs("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites", out);
    xml_attribute(out, "name", r->source.file);
    fputs(">\n", out);
    write_classes(out, r);
    for (size_t i = 0; i < r->factor_count; i++)
        write_suite(out, &r->factors[i]);
    fputs("</testsuites>\n", out);
}
