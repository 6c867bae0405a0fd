/* SPDX-License-Identifier: MIT
 *
 * slots.h - how often the triggers of time-triggered schedules hand in their frames.
 */
#ifndef CANWIRE_CLI_ANALYSE_SLOTS_H
#define CANWIRE_CLI_ANALYSE_SLOTS_H

#include "config/config.h"

/* The moments of one trigger. All times are ticks by the clocks as FILE gives them. */
typedef struct slots_cadence {
    uint64_t period; /* shortest time between two ... */
    uint64_t jitter; /* ... but for so much */
    uint64_t usual;  /* time between two as long as the first time master sends */
    uint64_t slot;   /* the frame begins before so much time has passed */
} slots_cadence;

/* The cadences of all triggers of a configuration. */
typedef struct slots {
    slots_cadence *all; /* CW_TRIGGERS_MAX for each node; the period is 0 where it is not known */
} slots;

/* Returns false without memory. slots_free() in either case. */
bool slots_find(slots *s, const cfg *config);

void slots_free(slots *s);

/* Returns NULL when it is not known how often a trigger of a node acts. Then frames begin its
 * basic cycles that are not those of a schedule, or none do. */
const slots_cadence *slots_of(const slots *s, unsigned node, unsigned trigger);

#endif
