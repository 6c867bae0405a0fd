/* SPDX-License-Identifier: MIT
 *
 * report.h - what an analysis has found, as a table and as JSON.
 */
#ifndef CANWIRE_CLI_ANALYSE_REPORT_H
#define CANWIRE_CLI_ANALYSE_REPORT_H

#include "cli/analyse/sources.h"

#include <jansson.h>
#include <stdio.h>

/* An analysis that has been made. */
typedef struct analysis {
    const sources *sources;
    uint64_t error_every; /* ticks; CW_NEVER: no errors */
    uint64_t simulated;   /* ticks of bus time; 0: nothing */
    double error_rate;    /* errors in a bit, at random; 0: none */
    const int *survived;  /* with an error rate: see failure_find() */
} analysis;

/* Returns true when a message may come later than its period ends, or has been seen later than its
 * bound, or not at all. */
bool report_is_bad(const analysis *a);

void report_print(FILE *out, const analysis *a);

/* Returns an object that the caller releases. */
json_t *report_json(const analysis *a);

#endif
