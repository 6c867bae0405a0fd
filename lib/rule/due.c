/* SPDX-License-Identifier: MIT
 *
 * due.c - runs the rules that are due at a tick.
 */
#include "rule/private.h"

static void arm(cw_rule_set *set, unsigned rule)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    cw_rule_take_arming(s, cw_rules_now(set));
    if (s->rule.trigger == CW_TRIGGER_ARMED)
        cw_rule_fire(set, rule);
}

/* Runs one rule at the present tick. Returns true when anything was due. */
static bool run_rule(cw_rule_set *set, unsigned rule)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    bool ends = s->active && s->active_until <= cw_rules_now(set);
    bool acts = s->to_act;
    bool fires = s->fire_at <= cw_rules_now(set);
    bool arms = cw_rule_next_arming(s) <= cw_rules_now(set);
    bool goes_on = s->rule.action == CW_ACTION_RAW && (s->active || s->waits) &&
                   s->next_at <= cw_rules_now(set);
    if (ends)
        cw_rule_end_action(set, rule);
    if (goes_on && !cw_raw_go_on(set, rule))
        cw_rule_end_action(set, rule);
    s->to_act = false;
    if (acts)
        cw_rule_act(set, rule);
    if (fires) {
        s->fire_at = CW_NEVER;
        cw_rule_fire(set, rule);
    }
    if (arms)
        arm(set, rule);
    return ends || goes_on || acts || fires || arms;
}

static void find_next_due(cw_rule_set *set)
{
    uint64_t next = CW_NEVER;
    for (unsigned rule = 0; rule < set->count; rule++) {
        const cw_rule_state *s = cw_rule_at(set, rule);
        if (!s->used)
            continue;
        next = cw_least(next, cw_least(s->fire_at, cw_rule_next_arming(s)));
        if (s->active || s->waits)
            next = cw_least(next, cw_least(s->active_until, s->next_at));
    }
    set->next_due = cw_least(next, cw_rules_next_held(set));
}

/* Runs until nothing is due any more: rules may arm each other at the same tick, each one once. */
static void run_rules(cw_rule_set *set)
{
    bool again = true;
    while (again) {
        again = false;
        set->work += 1 + set->count / CW_RULES_OF_A_PIECE;
        for (unsigned rule = 0; rule < set->count; rule++)
            if (cw_rule_at(set, rule)->used)
                again = run_rule(set, rule) || again;
    }
    if (set->rewired)
        cw_rules_rewire(set);
}

static bool is_traffic(const cw_rule_state *s)
{
    return s->used && s->active && s->does->kind == CW_KIND_TRAFFIC;
}

/* Goes from node to node. Otherwise a drop of an early node would have to go before all events of
 * later ones, maybe thousands. The order makes no difference to the queues. */
static void run_traffic(cw_rule_set *set)
{
    uint64_t nodes = 0;
    for (unsigned rule = 0; rule < set->count; rule++)
        if (is_traffic(cw_rule_at(set, rule)))
            nodes |= cw_node_bit(cw_rule_at(set, rule)->rule.node);
    for (; nodes; nodes &= nodes - 1)
        for (unsigned rule = 0; rule < set->count; rule++)
            if (cw_rule_at(set, rule)->rule.node == cw_lowest_node(nodes) &&
                is_traffic(cw_rule_at(set, rule)))
                cw_rule_at(set, rule)->does->traffic(set, rule);
}

void cw_rules_start(cw_rule_set *set)
{
    for (unsigned i = 0; i < set->count; i++) {
        cw_rule_state *s = cw_rule_at(set, i);
        if (s->used && s->fire_at < cw_rules_now(set))
            s->fire_at = cw_rules_now(set);
    }
}

void cw_rules_run_due(cw_rule_set *set)
{
    if (set->next_due > cw_rules_now(set) && set->awake_count == 0)
        return;
    bool due = set->next_due <= cw_rules_now(set);
    if (due) {
        run_rules(set);
        cw_rules_release_held(set);
    }
    if (due)
        run_traffic(set);
    bool steady = !due && set->traffic_rules > 0;
    for (unsigned i = 0; steady && i < set->awake_count; i++)
        if (is_traffic(cw_rule_at(set, set->awake[i])))
            cw_rule_at(set, set->awake[i])->does->traffic(set, set->awake[i]);
    if (due)
        find_next_due(set);
}
