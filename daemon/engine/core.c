/* SPDX-License-Identifier: MIT
 *
 * core.c - advances the bus, with its inputs, to a tick.
 */
#include "engine/core.h"

/* Returns the limit of one step. A replay that waits for its node checks after each bit. A
 * port with waiting frames checks for room at the end of each frame. */
static uint64_t next_look(const engine *e)
{
    uint64_t bit = cw_bus_tick_after(e->now.bus, 1);
    if (release_is_fast(e->now.plan))
        return bit;
    if (!e->pushed_back)
        return CW_NEVER;
    uint64_t next = cw_bus_next(e->now.bus);
    return next > bit ? next : bit;
}

uint64_t engine_run_to(engine *e, uint64_t tick)
{
    uint64_t end;
    bool all;
    uint64_t reached;
    release_look(e->now.plan, e->now.bus);
    do {
        end = next_look(e);
        if (end > tick)
            end = tick;
        reached = engine_release_to(e, end);
        all = reached == end;
        if (next_look(e) < reached) /* a replay has begun to wait for room */
            reached = end = next_look(e);
        if (!engine_advance(e, reached))
            return cw_bus_now(e->now.bus);
        if (e->pushed_back)
            engine_read_pushed_back(e);
        release_look(e->now.plan, e->now.bus);
    } while (all && end < tick);
    return reached;
}

/* Synchronisations make the bus slower, so it reports them for those only who want them. */
void engine_choose_events(engine *e)
{
    cw_bus_set_events(e->now.bus, CW_EVENTS_USUAL | e->kinds | e->config->lcm.events);
}

void engine_read_limits(engine *e)
{
    e->catch_up_ticks = text_time_ticks(e->config->catch_up, e->config->rate);
}
