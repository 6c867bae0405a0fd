/* SPDX-License-Identifier: MIT
 *
 * report.h - what the rows of a campaign show together.
 *
 * Rows are read one by one. The memory depends on the factors and their values, not on the rows.
 * A lack of memory ends the program.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_REPORT_H
#define CANWIRE_CAMPAIGN_REPORT_REPORT_H

#include "campaign/report/candidates.h"
#include "campaign/report/dimension.h"
#include "campaign/report/latency.h"
#include "campaign/report/pairs.h"
#include "campaign/report/source.h"
#include "campaign/report/spans.h"

#define REPORT_GROUPS_MAX (2 * CAMPAIGN_FACTORS_MAX)

typedef struct report {
    const campaign *campaign; /* not owned; NULL: its file cannot be opened */
    row_source source;        /* of the first row */
    int unread;               /* the errno with which its file cannot be opened, or 0 */
    row_signs signs;          /* of the campaign */
    uint64_t rows;
    spans numbers;            /* of the rows, or their seeds */
    class_counts classes;
    size_t factor_count;
    dimension factors[CAMPAIGN_FACTORS_MAX];
    pairs pairs;
    size_t group_count;
    dimension groups[REPORT_GROUPS_MAX]; /* frames and fields of spaces of faults */
    dimension expectations;   /* rows in which each has failed */
    dimension errors;         /* the first errors */
    dimension lost;           /* rows in which frames were lost, or rules never acted */
    latency latency;          /* from the first hit of a rule to the first error */
    uint64_t failed_within;   /* rows that have failed, with a latency within the limit */
    candidates candidates[CLASS_COUNT]; /* of failures, degraded ones, time-outs and crashes */
} report;

/* Begins with the first row, and the campaign if there is one. */
void report_begin(report *r, const report_row *first, const campaign *c);

/* Says in half a sentence, to be freed, that the file that the rows come from cannot be read. */
char *report_unread_text(const report *r);

/* Returns the number of rows that belong to the report, or 0 when it is not known. */
uint64_t report_possible(const report *r);

/* Returns the first number that is missing, and the last one behind it that is missing, too. False:
 * none is known to be missing. */
bool report_missing(const report *r, span *out);

void report_free(report *r);

#endif
