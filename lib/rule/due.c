/* SPDX-License-Identifier: MIT
 *
 * due.c - what rules have to do at a tick.
 */
#include "rule/private.h"

static void arm(cw_bus *bus, unsigned rule)
{
    cw_rule_state *s = cw_rule_at(bus, rule);
    cw_rule_take_arming(s, cw_now(bus));
    if (s->rule.trigger == CW_TRIGGER_ARMED)
        cw_rule_fire(bus, rule);
}

/* One rule at the present tick; returns whether anything was due. */
static bool run_rule(cw_bus *bus, unsigned rule)
{
    cw_rule_state *s = cw_rule_at(bus, rule);
    bool ends = s->active && s->active_until <= cw_now(bus);
    bool acts = s->to_act;
    bool fires = s->fire_at <= cw_now(bus);
    bool arms = cw_rule_next_arming(s) <= cw_now(bus);
    if (ends)
        cw_rule_end_action(bus, rule);
    s->to_act = false;
    if (acts)
        cw_rule_act(bus, rule);
    if (fires) {
        s->fire_at = CW_NEVER;
        cw_rule_fire(bus, rule);
    }
    if (arms)
        arm(bus, rule);
    return ends || acts || fires || arms;
}

static void find_next_due(cw_bus *bus)
{
    uint64_t next = CW_NEVER;
    for (unsigned rule = 0; rule < bus->rules.count; rule++) {
        const cw_rule_state *s = cw_rule_at(bus, rule);
        if (!s->used)
            continue;
        next = cw_least(next, cw_least(s->fire_at, cw_rule_next_arming(s)));
        if (s->active)
            next = cw_least(next, cw_least(s->active_until, s->next_at));
    }
    bus->rules.next_due = cw_least(next, cw_rules_next_held(bus));
}

/* Until nothing is due any more: rules may arm each other at the same tick, each one once. */
static void run_rules(cw_bus *bus)
{
    bool again = true;
    while (again) {
        again = false;
        bus->work += 1 + bus->rules.count / CW_RULES_OF_A_PIECE;
        for (unsigned rule = 0; rule < bus->rules.count; rule++)
            if (cw_rule_at(bus, rule)->used)
                again = run_rule(bus, rule) || again;
    }
    if (bus->rules.rewired)
        cw_rules_apply_topology(bus);
}

static bool is_traffic(const cw_rule_state *s)
{
    return s->used && s->active && s->does->kind == CW_KIND_TRAFFIC;
}

/* One node after the other: a drop of an earlier one would have to go before all events of later
 * ones, of which there may be thousands. To the queues it is all the same. */
static void run_traffic(cw_bus *bus)
{
    uint64_t nodes = 0;
    for (unsigned rule = 0; rule < bus->rules.count; rule++)
        if (is_traffic(cw_rule_at(bus, rule)))
            nodes |= cw_node_bit(cw_rule_at(bus, rule)->rule.node);
    for (; nodes; nodes &= nodes - 1)
        for (unsigned rule = 0; rule < bus->rules.count; rule++)
            if (cw_rule_at(bus, rule)->rule.node == cw_lowest_node(nodes) &&
                is_traffic(cw_rule_at(bus, rule)))
                cw_rule_at(bus, rule)->does->traffic(bus, rule);
}

void cw_rules_run_due(cw_bus *bus)
{
    if (bus->rules.next_due > cw_now(bus) && bus->rules.awake_count == 0)
        return;
    bool due = bus->rules.next_due <= cw_now(bus);
    if (due) {
        run_rules(bus);
        cw_rules_release_held(bus);
    }
    if (due)
        run_traffic(bus);
    bool steady = !due && bus->rules.traffic_rules > 0;
    for (unsigned i = 0; steady && i < bus->rules.awake_count; i++)
        if (is_traffic(cw_rule_at(bus, bus->rules.awake[i])))
            cw_rule_at(bus, bus->rules.awake[i])->does->traffic(bus, bus->rules.awake[i]);
    if (due)
        find_next_due(bus);
}
