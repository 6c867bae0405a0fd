/* SPDX-License-Identifier: MIT
 *
 * expect_report.h - outcomes of expectations, as text and as JUnit XML.
 */
#ifndef CANWIRE_CLI_SIM_EXPECT_REPORT_H
#define CANWIRE_CLI_SIM_EXPECT_REPORT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

typedef struct expect_outcome {
    char *name;   /* own ones, never NULL */
    char *wanted; /* in words */
    char *got;
    bool met;
    uint64_t ticks; /* of bus time that it looked at */
    unsigned configuration; /* of the run, counted from 1; set by expect_report_add() */
} expect_outcome;

/* All zeros is an empty report. */
typedef struct expect_report {
    expect_outcome *outcomes;
    size_t count;
    size_t failed;
    unsigned configuration; /* which one is judged now; for the caller to count */
} expect_report;

/* Takes the texts of the outcome over. name NULL: what is wanted is its name. False, with the texts
 * freed, when one of them is NULL or there is no memory. */
bool expect_report_add(expect_report *report, expect_outcome outcome);

void expect_report_free(expect_report *report);

/* A line per expectation and one with the sum. */
void expect_report_text(FILE *out, const expect_report *report);

/* One suite with a test case per expectation, as Jenkins and others read it; their names are
 * different: what several configurations expect has their number behind it. Times are bus time;
 * ticks is that of the whole run. `bus` names the suite and the class of its cases. */
void expect_report_junit(FILE *out, const expect_report *report, const char *bus, uint64_t ticks);

#endif
