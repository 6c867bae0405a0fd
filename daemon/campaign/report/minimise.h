/* SPDX-License-Identifier: MIT
 *
 * minimise.h - makes a scenario shorter as long as it does the same (delta debugging).
 *
 * A shorter scenario has the same class, and the same expectation fails. A degraded one is so for
 * the same reasons. No node is in a bad state in the end just because the run, or the traffic, ends
 * before it recovers. So it has come into that state after the time at which it has recovered in
 * the row. Without its fault rules the expectation is met, if this was so in the beginning:
 * what fails then is due to the faults.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_MINIMISE_H
#define CANWIRE_CAMPAIGN_REPORT_MINIMISE_H

#include "campaign/report/bundle.h"
#include "campaign/report/row.h"
#include "campaign/space/sample.h"

/* A scenario that is to become shorter. */
typedef struct minimise_task {
    const campaign *campaign; /* NULL: the text is a scenario */
    choice choices[CAMPAIGN_FACTORS_MAX]; /* of the row */
    const char *name;         /* of the scenario's file */
    const char *text;         /* without a campaign; it has no zero byte at its end */
    size_t size;              /* of the text */
    bool has_until;
    cfg_time until;
    bool has_seed;
    uint64_t seed;
    uint64_t end_ns;          /* bus time at the end of the row */
    row_class class;
    unsigned degraded;        /* DEGRADED_... as a set, of this class; otherwise 0 */
    const char *expectation;  /* NULL: none has failed */
    const row_signs *signs;
    int64_t limit_ms;         /* of real time for a run */
    int64_t deadline_ns;      /* of wall_ns(), when it ends, with what it has then */
} minimise_task;

typedef struct minimised {
    bundle_text text; /* of the scenario; without a main one it does not do the same again */
    bool tried;       /* it has been run again, and does the same */
    size_t rules;
    size_t traffic;
    bool has_until;
    uint64_t until_ns;
    bool has_seed;
    bool whole; /* the deadline has not come before the end */
} minimised;

/* Makes it short. The caller frees the texts. */
minimised minimise(const minimise_task *task);

#endif
