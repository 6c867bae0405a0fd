/* SPDX-License-Identifier: MIT
 *
 * pacing.h - decides when the daemon wakes up, and how much processor time `spin` may use.
 *
 * All times are CLOCK_MONOTONIC in ns unless stated otherwise.
 */
#ifndef CANWIRE_ENGINE_PACING_H
#define CANWIRE_ENGINE_PACING_H

#include "config/config.h"

#include <stdbool.h>
#include <stdint.h>

#define PACING_SPIN_NS INT64_C(50000) /* of `spin`: the last part of a wait is a busy loop */

/* The kernel stops real-time processes that take more than 95 % of a second (sched_rt_runtime_us).
 * So `spin` only adds to the daemon's own work, up to this part of the present window. */
#define PACING_WINDOW_NS INT64_C(100000000)
#define PACING_DUTY_PERCENT 85
#define PACING_ADVANCE_NS INT64_C(200000) /* at the start of a window */

/* The present window; starts all zero. */
typedef struct pacing_duty {
    int64_t window_ns; /* its beginning */
    int64_t cpu_ns;    /* CPU time of the thread then */
} pacing_duty;

/* Returns true when processor time is left for `spin`. cpu_ns: CPU time of the thread. */
bool pacing_may_spin(pacing_duty *d, int64_t now_ns, int64_t cpu_ns);

/* Returns the time to wake up for an event at due_ns. may_spin: see above; used by `spin` only. */
int64_t pacing_wake_ns(cfg_pacing pacing, int64_t due_ns, bool may_spin);

/* Returns the next wake-up of `tick` after now. */
int64_t pacing_next_tick_ns(int64_t now_ns);

#endif
