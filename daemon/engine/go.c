/* SPDX-License-Identifier: MIT
 *
 * go.c - lets the bus go on to a tick, with changes of its configuration and of its nodes.
 */
#include "engine/core.h"

#include <time.h>

#define SLICE_TICKS (CW_CLOCK_HZ / 1000u)

/* Advances to the present in slices, for WAKE_MAX_NS at most. A bus that is too much for this
 * machine falls behind, but does not delay signals and statistics. */
static bool catch_up(engine *e, uint64_t now)
{
    uint64_t tick;
    do {
        uint64_t next = engine_next_tick(e);
        tick = next < now && now - next > SLICE_TICKS ? next + SLICE_TICKS : now;
        tick = engine_run_to(e, tick);
    } while (tick < now && !engine_turn_is_over(e));
    return tick >= now;
}

bool engine_go(engine *e, uint64_t now)
{
    engine_run_to_boundary(e, now);
    const bool present = (!e->next || !engine_turn_is_over(e)) && catch_up(e, now);
    engine_see_guests_off(e);
    engine_obey(e);
    return present;
}

static bool may_stop(const engine *e)
{
    return cw_bus_idle(e->now.bus) || cw_bus_now(e->now.bus) >= e->stop_tick;
}

void engine_run_out(engine *e, uint64_t now)
{
    while (!may_stop(e) && cw_bus_tick_after(e->now.bus, 1) <= now)
        if (!engine_advance(e, cw_bus_tick_after(e->now.bus, 1)))
            break;
    if (!may_stop(e) && clock_ns(CLOCK_MONOTONIC) < e->stop_ns)
        return;
    e->stopped = true;
    e->over(e);
}
