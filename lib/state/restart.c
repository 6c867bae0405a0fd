/* SPDX-License-Identifier: MIT
 *
 * restart.c - the times of the restarts that are to come (R12), and what nodes do next.
 */
#include "state/state.h"

void cw_schedule_restart(cw_bus *bus, unsigned i, uint64_t tick)
{
    bus->restarts[i].at = tick;
    bus->node_due = cw_least(bus->node_due, tick);
}

uint64_t cw_automatic_restart(const cw_bus *bus, unsigned i)
{
    if (bus->restarts[i].ticks == 0)
        return CW_NEVER;
    uint64_t due = cw_after(bus->restarts[i].off_at, bus->restarts[i].ticks);
    return due > cw_now(bus) ? due : cw_now(bus);
}

void cw_find_node_due(cw_bus *bus)
{
    bus->node_due = CW_NEVER;
    for (unsigned i = 0; i < bus->node_count; i++) {
        bus->node_due = cw_least(bus->node_due,
                                 cw_least(cw_tt_due(bus, i),
                                          cw_least(bus->restarts[i].at, cw_buffers_due(bus, i))));
        if (!bus->lean)
            bus->node_due = cw_least(bus->node_due, bus->sleeps[i].awake_at);
    }
}
