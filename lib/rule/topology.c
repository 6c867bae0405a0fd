/* SPDX-License-Identifier: MIT
 *
 * topology.c - the wire of each node, and the nodes that acknowledge, by rules.
 */
#include "rule/private.h"

#define ALL_NODES UINT64_MAX

/* Returns the nodes of all active rules of a kind. */
static uint64_t named_by_active(const cw_rule_set *set, cw_action action)
{
    uint64_t nodes = 0;
    for (unsigned i = 0; i < set->count; i++) {
        const cw_rule_state *s = &set->rules[i];
        if (s->used && s->active && s->rule.action == action)
            nodes |= s->rule.nodes;
    }
    return nodes;
}

/* Returns the nodes that drive raw bits. */
static uint64_t driving(const cw_rule_set *set)
{
    uint64_t nodes = 0;
    for (unsigned i = 0; i < set->count; i++) {
        const cw_rule_state *s = &set->rules[i];
        if (s->used && s->active && cw_rule_is_raw(s))
            nodes |= cw_node_bit(s->rule.node);
    }
    return nodes;
}

/* Makes wires from the group numbers of a rule. */
static unsigned partition(const cw_rule_set *set, uint64_t *wires, const cw_rule *rule)
{
    unsigned count = 0;
    for (unsigned number = 0; number <= UINT8_MAX; number++) {
        uint64_t members = 0;
        for (unsigned i = 0; i < set->bus.node_count; i++)
            if (rule->group[i] == number)
                members |= cw_node_bit(i);
        if (members)
            wires[count++] = members;
    }
    return count;
}

/* The last active partition counts. */
static unsigned find_wires(const cw_rule_set *set, uint64_t *wires)
{
    for (unsigned i = set->count; i-- > 0;) {
        const cw_rule_state *s = &set->rules[i];
        if (s->used && s->active && s->rule.action == CW_ACTION_PARTITION)
            return partition(set, wires, &s->rule);
    }
    wires[0] = ALL_NODES;
    return 1;
}

void cw_rules_find_topology(const cw_rule_set *set, cw_topology *topology)
{
    topology->no_ack = named_by_active(set, CW_ACTION_NO_ACK);
    topology->off = named_by_active(set, CW_ACTION_DISCONNECT);
    topology->raw = set->raw_rules ? driving(set) : 0;
    topology->wire_count = find_wires(set, topology->wires);
}
