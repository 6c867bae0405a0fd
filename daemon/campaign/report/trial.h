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
    bool has_seed;    /* otherwise that of the text */
    uint64_t seed;
    int64_t limit_ms; /* of real time */
} trial;

typedef struct trial_result {
    row_class class;
    bool failed;       /* the expectation, if any, is not met */
    unsigned degraded; /* DEGRADED_... as a set, of a row of this class; otherwise 0 */
    json_t *spells;    /* of being not error-active, see below; NULL: there is no result */
} trial_result;

/* Spells are an object with two ticks for each BUS:NODE that has had one. At the first tick the
 * last spell has begun, if it goes on in the end, otherwise it is -1. At the second one the last
 * spell has ended that has an end, or it is 0. */

/* Returns true when no spell that goes on in the end would have ended in the run of `before`. None
 * has begun before its node became error-active there for the last time. */
bool trial_ends_like(const trial_result *r, const json_t *before);

/* Runs it once. The caller frees the result. */
trial_result trial_run(const trial *t, const char *expectation, const row_signs *signs);

void trial_result_free(trial_result *r);

#endif
