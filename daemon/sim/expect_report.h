/* SPDX-License-Identifier: MIT
 *
 * expect_report.h - results of expectations, as text and as JUnit XML.
 */
#ifndef CANWIRE_SIM_EXPECT_REPORT_H
#define CANWIRE_SIM_EXPECT_REPORT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

typedef struct expect_outcome {
    char *name;   /* owned, never NULL */
    char *wanted; /* the expectation as text */
    char *got;
    bool met;
    uint64_t ticks; /* of bus time that it covers */
    unsigned configuration; /* of the run, counted from 1; set by expect_report_add() */
} expect_outcome;

/* All zeros is an empty report. */
typedef struct expect_report {
    expect_outcome *outcomes;
    size_t count;
    size_t failed;
    unsigned configuration; /* number of the present one, counted by the caller */
} expect_report;

/* Frees the texts. */
void expect_outcome_free(expect_outcome *outcome);

/* Takes over the texts of the result. Without a name the text of the expectation is the name.
 * Returns false, with the texts freed, when one is NULL or memory is short. */
bool expect_report_add(expect_report *report, expect_outcome outcome);

void expect_report_free(expect_report *report);

/* Writes a line per expectation and one with the sum. */
void expect_report_text(FILE *out, const expect_report *report);

typedef struct expect_suite {
    const expect_report *report;
    const char *bus; /* names the suite and the class of its cases */
} expect_suite;

/* Writes suites with a test case per expectation, for Jenkins and others. All names in a suite are
 * different: expectations of several configurations have a number. Times are bus time; ticks is the
 * time of the whole run. */
void expect_report_junit(FILE *out, const expect_suite *suites, size_t count, uint64_t ticks);

#endif
