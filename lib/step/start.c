/* SPDX-License-Identifier: MIT
 *
 * start.c - a frame for a bus at rest begins at its tick, and with it the bits of all nodes.
 *
 * It is for buses with `start_at_tick`: the recessive bit before the frame is shorter then.
 */
#include "step/step.h"

/* Returns true when a controller has nothing to do but to wait for a SOF, if for anything. */
static bool waits_for_sof(const cw_mac *m)
{
    return m->phase == CW_MAC_IDLE || m->phase == CW_MAC_OFF || m->phase == CW_MAC_BUS_OFF ||
           m->phase == CW_MAC_ASLEEP;
}

/* Returns true when that is so for all nodes, and none has a frame for the next bit. */
static bool bus_rests(const cw_bus *bus)
{
    bool rests = !bus->followers || waits_for_sof(&bus->common);
    for (uint64_t rest = cw_single_nodes(bus); rests && rest; rest &= rest - 1)
        rests = waits_for_sof(&bus->nodes[cw_lowest_node(rest)].mac);
    for (uint64_t rest = bus->waiting; rests && rest; rest &= rest - 1)
        rests = cw_mac_of(bus, cw_lowest_node(rest))->phase != CW_MAC_IDLE;
    return rests;
}

/* Returns the tick of the first frame up to a tick whose node can begin it, or CW_NEVER. Others are
 * dropped. */
static uint64_t first_that_begins(const cw_bus *bus, uint64_t end)
{
    for (unsigned n = 0; n < bus->inbox.count; n++) {
        const cw_inbox_entry *entry = cw_inbox_at(&bus->inbox, n);
        if (entry->at_tick >= end)
            break;
        if (cw_mac_of(bus, entry->node)->phase == CW_MAC_IDLE)
            return entry->at_tick;
    }
    return CW_NEVER;
}

uint64_t cw_start_in_bit(const cw_bus *bus, uint64_t end)
{
    const uint64_t first = cw_inbox_first(bus);
    if (first <= cw_now(bus) || first >= end || bus->frame_step.active ||
        bus->rules.awake_count > 0 || cw_is_off_grid(bus) || !bus_rests(bus))
        return end;
    return cw_least(end, first_that_begins(bus, end));
}

bool cw_short_bit_fits(const cw_bus *bus, uint64_t tick)
{
    const uint64_t end = cw_next_bit_end(bus); /* lower than now at the end of time */
    return tick > cw_now(bus) && end > cw_now(bus) && end <= tick;
}
