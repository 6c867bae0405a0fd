/* SPDX-License-Identifier: MIT
 *
 * expect_report.c - results of expectations, as text and as JUnit XML.
 */
#include "sim/expect_report.h"

#include "base/text/counted.h"
#include "base/text/plain.h"
#include "base/text/xmltext.h"
#include "canwire.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

static void free_texts(expect_outcome *outcome)
{
    free(outcome->name);
    free(outcome->wanted);
    free(outcome->got);
}

bool expect_report_add(expect_report *report, expect_outcome outcome)
{
    if (!outcome.name && outcome.wanted)
        outcome.name = strdup(outcome.wanted);
    bool good = outcome.name && outcome.wanted && outcome.got;
    expect_outcome *longer =
        good ? realloc(report->outcomes, (report->count + 1) * sizeof *longer) : NULL;
    if (!longer) {
        free_texts(&outcome);
        return false;
    }
    outcome.configuration = report->configuration;
    report->outcomes = longer;
    report->outcomes[report->count++] = outcome;
    report->failed += !outcome.met;
    return true;
}

void expect_report_free(expect_report *report)
{
    for (size_t i = 0; i < report->count; i++)
        free_texts(&report->outcomes[i]);
    free(report->outcomes);
    *report = (expect_report){.count = 0};
}

/* ---- Text ------------------------------------------------------------------------------------ */

void expect_report_text(FILE *out, const expect_report *report)
{
    for (size_t i = 0; i < report->count; i++) {
        const expect_outcome *o = &report->outcomes[i];
        bool named = strcmp(o->name, o->wanted) != 0;
        plain_print(out, "%s %s%swanted %s, got %s\n", o->met ? "ok    " : "FAILED",
                    named ? o->name : "", named ? ": " : "", o->wanted, o->got);
    }
    fprintf(out, "%s, %zu met, %zu failed\n", counted(report->count, "expectation").text,
            report->count - report->failed, report->failed);
}

/* ---- JUnit XML ------------------------------------------------------------------------------- */

/* Writes a time in seconds with three decimals, since some readers accept no more. It is rounded to
 * the nearest millisecond, but a time above 0 is never shown as 0. */
static void write_time(FILE *out, uint64_t ticks)
{
    const uint64_t ms_ticks = CW_CLOCK_HZ / 1000u;
    uint64_t ms = ticks / ms_ticks + (ticks % ms_ticks >= ms_ticks / 2 ? 1 : 0);
    if (ms == 0 && ticks > 0)
        ms = 1;
    fprintf(out, " time=\"%" PRIu64 ".%03" PRIu64 "\"", ms / 1000u, ms % 1000u);
}

/* Writes a suffix that makes a name different from other cases. */
static void write_which(FILE *out, const expect_report *report, const expect_outcome *o)
{
    size_t before = 0; /* in the same configuration */
    bool elsewhere = false;
    for (const expect_outcome *other = report->outcomes;
         other < report->outcomes + report->count; other++) {
        if (strcmp(other->name, o->name) != 0)
            continue;
        elsewhere = elsewhere || other->configuration != o->configuration;
        before += other < o && other->configuration == o->configuration;
    }
    if (elsewhere)
        fprintf(out, " (configuration %u)", o->configuration);
    if (before > 0)
        fprintf(out, " (%zu)", before + 1);
}

static void write_case(FILE *out, const expect_report *report, const expect_outcome *o,
                       const char *bus)
{
    fputs("    <testcase name=\"", out);
    xml_value(out, o->name);
    write_which(out, report, o);
    fputc('"', out);
    xml_attribute(out, "classname", bus);
    write_time(out, o->ticks);
    if (o->met) {
        fputs("/>\n", out);
        return;
    }
    fputs(">\n      <failure type=\"expectation\" message=\"wanted ", out);
    xml_value(out, o->wanted);
    fputs(", got ", out);
    xml_value(out, o->got);
    fputs("\"/>\n    </testcase>\n", out);
}

static void expect_report_write_counts(FILE *out, size_t count, size_t failed)
{
    fprintf(out, " tests=\"%zu\" failures=\"%zu\" errors=\"0\"", count, failed);
}

static void write_suite(FILE *out, const expect_suite *suite, uint64_t ticks)
{
    const expect_report *report = suite->report;
    fputs("  <testsuite", out);
    xml_attribute(out, "name", suite->bus);
    expect_report_write_counts(out, report->count, report->failed);
    fputs(" skipped=\"0\"", out);
    write_time(out, ticks);
    fputs(">\n", out);
    for (size_t i = 0; i < report->count; i++)
        write_case(out, report, &report->outcomes[i], suite->bus);
    fputs("  </testsuite>\n", out);
}

void expect_report_junit(FILE *out, const expect_suite *suites, size_t count, uint64_t ticks)
{
    size_t all = 0;
    size_t failed = 0;
    for (size_t i = 0; i < count; i++) {
        all += suites[i].report->count;
        failed += suites[i].report->failed;
    }
    fputs("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites name=\"canwire\"", out);
    expect_report_write_counts(out, all, failed);
    write_time(out, ticks);
    fputs(">\n", out);
    for (size_t i = 0; i < count; i++)
        write_suite(out, &suites[i], ticks);
    fputs("</testsuites>\n", out);
}
