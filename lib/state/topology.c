/* SPDX-License-Identifier: MIT
 *
 * topology.c - the wire of each node, and the nodes that acknowledge, by rules and hosts.
 */
#include "state/state.h"

#include <string.h>

/* Takes a node off its wire, brings it back, or changes how it acknowledges. */
static void put_node(cw_bus *bus, unsigned i, const cw_topology *topology)
{
    uint64_t self = cw_node_bit(i);
    bool goes = (topology->off & self) && cw_mac_is_on_bus(cw_mac_of(bus, i));
    bool comes = (bus->rules.off & ~topology->off & self) != 0;
    bool silent = (topology->no_ack & self) != 0;
    if (!goes && !comes && silent == bus->nodes[i].mac.no_ack)
        return; /* so that a change at one node does not disturb the others */
    cw_mac *m = cw_own_mac(bus, i);
    m->no_ack = silent;
    if (goes) {
        cw_note_left(bus, i);
        cw_mac_disconnect(m);
        cw_sleep_settle(bus, i);
        bus->pending = true;
    }
    if (comes)
        cw_mac_reconnect(m);
}

/* Notes the nodes that hosts have taken off the bus, and that no rule has changed there. */
static void find_unplugged(cw_bus *bus)
{
    bus->unplugged = 0;
    for (uint64_t rest = bus->detached; rest; rest &= rest - 1)
        if (bus->nodes[cw_lowest_node(rest)].mac.phase == CW_MAC_OFF)
            bus->unplugged |= rest & (~rest + 1);
}

void cw_apply_topology(cw_bus *bus)
{
    cw_topology topology;
    cw_rules_find_topology(&bus->rules, &topology);
    topology.off |= bus->detached;
    bus->rules.cut = topology.off;
    bus->rules.raw = topology.raw;
    topology.off |= topology.raw;
    for (unsigned i = 0; i < bus->node_count; i++)
        put_node(bus, i, &topology);
    bus->rules.off = topology.off;
    bus->rules.rewired = false;
    memcpy(bus->groups, topology.wires, topology.wire_count * sizeof bus->groups[0]);
    bus->group_count = topology.wire_count;
    find_unplugged(bus);
    cw_outlook_forget(bus);
}

uint64_t cw_wired_and(const cw_bus *bus, uint64_t driven)
{
    uint64_t levels = UINT64_MAX;
    for (unsigned g = 0; g < bus->group_count; g++)
        if ((driven & bus->groups[g]) != bus->groups[g])
            levels &= ~bus->groups[g];
    return levels;
}
