/* SPDX-License-Identifier: MIT
 *
 * timer.c - the moment at which an engine wakes up next.
 */
#include "engine/core.h"

#include "base/log.h"
#include "run/due.h"

#include <time.h>

uint64_t engine_next_tick(const engine *e)
{
    return due_tick(e->now.bus, e->now.plan, e->config);
}

/* Reading the CPU time is a system call, so only `spin` does it. */
static bool may_spin(engine *e)
{
    return e->config->pacing == CFG_PACING_SPIN &&
           pacing_may_spin(&e->duty, clock_ns(CLOCK_MONOTONIC), clock_ns(CLOCK_THREAD_CPUTIME_ID));
}

/* Returns when the bus is to wake: for what is due, and while it ticks at each tick. */
static int64_t next_wake_ns(engine *e)
{
    int64_t wake_ns = INT64_MAX;
    if (e->due_ns != INT64_MAX)
        wake_ns = pacing_wake_ns(e->config->pacing, e->due_ns, may_spin(e));
    if (!e->ticking)
        return wake_ns;
    int64_t tick_ns = pacing_next_tick_ns(clock_ns(CLOCK_MONOTONIC));
    return tick_ns < wake_ns ? tick_ns : wake_ns;
}

/* A bus without a timer would advance only when somebody asks for its state. */
void engine_fail(engine *e, const char *what, const char *why)
{
    if (!e->failed)
        log_error("%s: %s; the bus cannot go on", what, why);
    e->failed = true;
    ev_break(e->loop, EVBREAK_ALL);
}

bool engine_is_watched(engine *e, int events, const char *what)
{
    if (events & EV_ERROR)
        engine_fail(e, what, "it cannot be watched any more");
    return !(events & EV_ERROR);
}

bool engine_has_failed(const engine *e)
{
    return e->failed;
}

void engine_arm_timer(engine *e)
{
    uint64_t tick = engine_next_tick(e);
    if (e->stopping && e->stop_tick < tick)
        tick = e->stop_tick;
    if (e->next && e->next->deadline < tick)
        tick = e->next->deadline;
    e->due_ns = tick == CW_NEVER ? INT64_MAX : clock_monotonic_ns(e->clock, tick);
    e->wake_ns = next_wake_ns(e);
    e->arm(e);
}

void engine_spin(const engine *e)
{
    if (e->config->pacing != CFG_PACING_SPIN ||
        e->due_ns > clock_ns(CLOCK_MONOTONIC) + PACING_SPIN_NS)
        return;
    while (clock_ns(CLOCK_MONOTONIC) < e->due_ns)
        continue;
}
