/* SPDX-License-Identifier: MIT
 *
 * trial.h - runs a scenario once, in a process of its own: one that crashes or hangs ends alone.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_TRIAL_H
#define CANWIRE_CAMPAIGN_REPORT_TRIAL_H

#include "campaign/report/bundle.h"
#include "campaign/report/row.h"

typedef struct trial {
    const char *name; /* of the file that the main text stands for */
    const bundle_text *text;
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
    char *unwell;      /* nodes that are not error-active in the end, with how often each has
                          become so; NULL: there is no result */
} trial_result;

/* Runs it once. The caller frees the result. */
trial_result trial_run(const trial *t, const char *expectation, const row_signs *signs);

void trial_result_free(trial_result *r);

#endif
