/* SPDX-License-Identifier: MIT
 *
 * trial.h - runs a scenario once, in a process of its own: one that crashes or hangs ends alone.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_TRIAL_H
#define CANWIRE_CAMPAIGN_REPORT_TRIAL_H

#include "campaign/report/row.h"

typedef struct trial {
    const char *name; /* of the file that the text stands for */
    const char *text;
    bool has_until;
    cfg_time until;
    bool has_seed;    /* else that of the text */
    uint64_t seed;
    int64_t limit_ms; /* of real time */
} trial;

typedef struct trial_result {
    row_class class;
    bool failed;       /* the expectation, if any, is not met */
    unsigned degraded; /* DEGRADED_... as a set, of a row of this class; else 0 */
} trial_result;

/* Runs it. */
trial_result trial_run(const trial *t, const char *expectation, const row_signs *signs);

#endif
