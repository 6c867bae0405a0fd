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

uint64_t cw_start_in_bit(const cw_bus *bus, uint64_t end)
{
    const uint64_t first = cw_inbox_first(bus);
    if (first <= cw_now(bus) || first >= end || bus->frame_step.active ||
        bus->rules.awake_count > 0 || cw_is_off_grid(bus) || !bus_rests(bus))
        return end;
    return first;
}
