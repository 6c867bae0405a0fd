/* SPDX-License-Identifier: MIT
 *
 * pacing.h - when the daemon wakes up for what is due, and how much of a processor it may burn for
 * it.
 *
 * All times are CLOCK_MONOTONIC in ns unless they say otherwise.
 */
#ifndef CANWIRE_ENGINE_PACING_H
#define CANWIRE_ENGINE_PACING_H

#include "config/config.h"

#include <stdbool.h>
#include <stdint.h>

#define PACING_SPIN_NS INT64_C(50000) /* of `spin`: the last part of a wait is spent awake */

/* The kernel stops real-time processes that take more than 95 % of a second
 * (sched_rt_runtime_us). So `spin` only fills up what the daemon runs anyway, to this much of
 * the time in a window so far. */
#define PACING_WINDOW_NS INT64_C(100000000)
#define PACING_DUTY_PERCENT 85
#define PACING_ADVANCE_NS INT64_C(200000) /* at the begin of a window */

/* The present window. Starts all zero. */
typedef struct pacing_duty {
    int64_t window_ns; /* its begin */
    int64_t cpu_ns;    /* CPU time of the thread then */
} pacing_duty;

/* Whether there is processor time left to burn. cpu_ns: CPU time of the thread. */
bool pacing_may_spin(pacing_duty *d, int64_t now_ns, int64_t cpu_ns);

/* When to wake up for what is due. may_spin: see above; of no account but in `spin`. */
int64_t pacing_wake_ns(cfg_pacing pacing, int64_t due_ns, bool may_spin);

/* The next wake-up of `tick` after now. */
int64_t pacing_next_tick_ns(int64_t now_ns);

#endif
