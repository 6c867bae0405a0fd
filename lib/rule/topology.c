/* SPDX-License-Identifier: MIT
 *
 * topology.c - who is on which wire, and who acknowledges, by rules and hosts.
 */
#include "rule/private.h"

#define ALL_NODES UINT64_MAX

/* The nodes of all active rules of a kind. */
static uint64_t named_by_active(const cw_bus *bus, cw_action action)
{
    uint64_t nodes = 0;
    for (unsigned i = 0; i < bus->rules.count; i++) {
        const cw_rule_state *s = &bus->rules.rules[i];
        if (s->used && s->active && s->rule.action == action)
            nodes |= s->rule.nodes;
    }
    return nodes;
}

/* Wires from the group numbers of a rule. */
static void partition(cw_bus *bus, const cw_rule *rule)
{
    bus->group_count = 0;
    for (unsigned number = 0; number <= UINT8_MAX; number++) {
        uint64_t members = 0;
        for (unsigned i = 0; i < bus->node_count; i++)
            if (rule->group[i] == number)
                members |= cw_node_bit(i);
        if (members)
            bus->groups[bus->group_count++] = members;
    }
}

/* The last active partition counts. */
static void apply_partition(cw_bus *bus)
{
    bus->groups[0] = ALL_NODES;
    bus->group_count = 1;
    for (unsigned i = bus->rules.count; i-- > 0;) {
        const cw_rule_state *s = &bus->rules.rules[i];
        if (!s->used || !s->active || s->rule.action != CW_ACTION_PARTITION)
            continue;
        partition(bus, &s->rule);
        return;
    }
}

void cw_rules_apply_topology(cw_bus *bus)
{
    uint64_t no_ack = named_by_active(bus, CW_ACTION_NO_ACK);
    uint64_t off = named_by_active(bus, CW_ACTION_DISCONNECT) | bus->detached;
    for (unsigned i = 0; i < bus->node_count; i++) {
        uint64_t self = cw_node_bit(i);
        bool goes = (off & self) && cw_mac_is_on_bus(cw_mac_of(bus, i));
        bool comes = (bus->rules.off & ~off & self) != 0;
        bool silent = (no_ack & self) != 0;
        if (!goes && !comes && silent == bus->nodes[i].mac.no_ack)
            continue; /* so that a change at one node does not disturb the others */
        cw_mac *m = cw_own_mac(bus, i);
        m->no_ack = silent;
        if (goes)
            cw_mac_disconnect(m);
        if (comes)
            cw_mac_reconnect(m);
    }
    bus->rules.off = off;
    bus->rules.rewired = false;
    apply_partition(bus);
}
