/* SPDX-License-Identifier: MIT
 *
 * expect_report.c - results of expectations, as text and as JUnit XML.
 */
#include "sim/expect_report.h"

#include "base/text/buffer.h"
#include "base/text/counted.h"
#include "base/text/jsonput.h"
#include "base/text/junit.h"
#include "base/text/plain.h"

#include <stdlib.h>
#include <string.h>

void expect_outcome_free(expect_outcome *outcome)
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
        expect_outcome_free(&outcome);
        return false;
    }
    outcome.configuration = report->configuration;
    report->outcomes = longer;
    report->outcomes[report->count++] = outcome;
    report->failed += !outcome.met;
    return true;
}

/* Frees all outcomes. The report can be used again. */
void expect_report_free(expect_report *report)
{
    for (size_t i = 0; i < report->count; i++)
        expect_outcome_free(&report->outcomes[i]);
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

/* Puts the name, with a suffix that makes it different from those of other cases. */
static void put_name(buffer *out, const expect_report *report, const expect_outcome *o)
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
    buffer_put(out, o->name);
    if (elsewhere)
        buffer_print(out, " (configuration %u)", o->configuration);
    if (before > 0)
        buffer_print(out, " (%zu)", before + 1);
}

/* Writes an expectation as a case, whose message tells wanted and found. */
static void write_case(FILE *out, const expect_report *report, const expect_outcome *o,
                       const char *bus)
{
    buffer name = {.data = NULL}, message = {.data = NULL};
    put_name(&name, report, o);
    buffer_print(&message, "wanted %s, got %s", o->wanted, o->got);
    const junit_case one = {.name = buffer_text(&name), .suite = bus, .ticks = o->ticks,
                            .problem = o->met ? NULL : "failure", .type = "expectation",
                            .message = buffer_text(&message)};
    if (one.name && one.message)
        junit_write_case(out, &one);
    else
        json_no_memory();
    buffer_free(&name);
    buffer_free(&message);
}

static junit_counts counts_of(const expect_report *report)
{
    return (junit_counts){.cases = report->count, .failures = report->failed};
}

void expect_report_junit(FILE *out, const expect_suite *suites, size_t count, uint64_t ticks)
{
    junit_counts all = {.cases = 0};
    for (size_t i = 0; i < count; i++) {
        all.cases += suites[i].report->count;
        all.failures += suites[i].report->failed;
    }
    junit_begin(out, "canwire", &all, ticks);
    for (size_t i = 0; i < count; i++) {
        const expect_report *report = suites[i].report;
        const junit_counts counts = counts_of(report);
        junit_begin_suite(out, suites[i].bus, &counts, ticks);
        for (size_t k = 0; k < report->count; k++)
            write_case(out, report, &report->outcomes[k], suites[i].bus);
        junit_end_suite(out);
    }
    junit_end(out);
}
