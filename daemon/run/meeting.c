/* SPDX-License-Identifier: MIT
 *
 * meeting.c - advances the buses of a rig together, so that gateways hand over frames in time.
 */
#include "run/meeting.h"

#include "run/due.h"

#define FRAME_BITS_MIN 25 /* nominal bits of any frame, SOF to its reception, at any data rate */

static uint64_t least(uint64_t a, uint64_t b)
{
    return a < b ? a : b;
}

/* Returns the first tick at which the bus expects an event. Off the grid, and where there is a data
 * rate, one may come up to a bit before it says. */
static uint64_t next_event(const cw_bus *bus, const release_plan *plan, const cfg *config)
{
    if (cw_bus_is_on_grid(bus) && config->dbitrate_bps == 0)
        return due_tick(bus, plan, config);
    const uint64_t next = cw_bus_next(bus);
    const uint64_t bit = cw_rate_ticks(config->rate, 1);
    return least(next == CW_NEVER || next < bit ? next : next - bit, release_next_tick(plan));
}

uint64_t meeting_next(const cw_bus *bus, const release_plan *plan, const cfg *config)
{
    const uint64_t bit = cw_bus_tick_after(bus, 1);
    uint64_t next = next_event(bus, plan, config);
    /* rules, replies and fast replays send frames that the bus does not know yet */
    if (config->rule_count > 0 || config->reply_count > 0 || release_is_fast(plan))
        next = least(next, cw_bus_tick_after(bus, FRAME_BITS_MIN));
    return next > bit ? next : bit;
}

void meeting_look(meeting *m, size_t bus)
{
    m->next[bus] =
        gateways_nodes(m->gateways, bus) ? m->calls->next(m->user, bus) : CW_NEVER;
}

uint64_t meeting_tick(const meeting *m)
{
    uint64_t tick = CW_NEVER;
    for (size_t i = 0; i < m->bus_count; i++)
        tick = least(tick, m->next[i]);
    return tick;
}

bool meeting_hold(meeting *m, uint64_t tick, uint32_t buses)
{
    bool good = true;
    for (size_t i = 0; i < m->bus_count; i++) {
        if (!(buses >> i & 1u) && m->next[i] > tick)
            continue;
        good = m->calls->go(m->user, i, tick) && good;
        meeting_look(m, i);
    }
    uint32_t given = gateways_meet(m->gateways);
    for (size_t i = 0; given; i++, given >>= 1)
        if (given & 1u)
            meeting_look(m, i);
    return good;
}
