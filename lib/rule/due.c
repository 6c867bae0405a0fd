/* SPDX-License-Identifier: MIT
 *
 * due.c - runs the rules that are due at a tick.
 */
#include "rule/private.h"

/* Arms a rule, and lets it act at once if that is its trigger. */
static void due_arm(cw_rule_set *set, unsigned rule)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    cw_rule_take_arming(s, cw_rules_now(set));
    if (s->rule.trigger == CW_TRIGGER_ARMED)
        cw_rule_fire(set, rule);
}

/* Returns the first time of a rule at or after a tick. */
static uint64_t first_time(const cw_rule *r, uint64_t tick)
{
    if (tick <= r->time_begin)
        return r->time_begin;
    const uint64_t times = (tick - r->time_begin - 1) / r->again_ticks + 1;
    const uint64_t room = (CW_NEVER - r->time_begin) / r->again_ticks;
    return times < room ? r->time_begin + times * r->again_ticks : CW_NEVER;
}

void cw_rule_plan_from(cw_rule_state *s, uint64_t tick)
{
    const cw_rule *r = &s->rule;
    const uint64_t next = r->again_ticks ? first_time(r, tick)
                                         : (tick > r->time_begin ? tick : r->time_begin);
    s->fire_at = r->again_ticks == 0 || next < r->time_end ? next : CW_NEVER;
}

/* Times follow from start and period, not from the bits in which the rule acts. Those within one
 * bit count as one. */
static void plan_again(const cw_rule_set *set, cw_rule_state *s)
{
    s->fire_at = CW_NEVER;
    if (s->rule.again_ticks > 0 && !cw_rule_is_over(s))
        cw_rule_plan_from(s, cw_rules_now(set) + 1);
}

/* Runs one rule at the present tick. Returns true when anything was due. */
static bool run_rule(cw_rule_set *set, unsigned rule)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    bool ends = s->active && s->active_until <= cw_rules_now(set);
    bool acts = s->to_act;
    bool fires = s->fire_at <= cw_rules_now(set);
    bool arms = cw_rule_next_arming(s) <= cw_rules_now(set);
    bool goes_on = cw_rule_is_raw(s) && (s->active || s->raw.waits) &&
                   s->raw.next_at <= cw_rules_now(set);
    if (ends)
        cw_rule_end_action(set, rule);
    if (goes_on && !cw_raw_go_on(set, rule))
        cw_rule_end_action(set, rule);
    s->to_act = false;
    if (acts)
        cw_rule_act(set, rule);
    if (fires) {
        cw_rule_fire(set, rule);
        plan_again(set, s);
    }
    if (arms)
        due_arm(set, rule);
    return ends || goes_on || acts || fires || arms;
}

static bool is_traffic(const cw_rule_state *s)
{
    return s->used && s->active && s->does->kind == CW_KIND_TRAFFIC;
}

/* Returns the tick at which an action under way goes on, or ends. */
static uint64_t next_of_action(const cw_rule_state *s)
{
    if (cw_rule_is_raw(s))
        return s->active || s->raw.waits ? s->raw.next_at : CW_NEVER;
    if (is_traffic(s))
        return cw_least(s->active_until, s->traffic.next_at);
    return s->active ? s->active_until : CW_NEVER;
}

/* Finds the first tick at which a rule or a frame held back is due. */
static void find_next_due(cw_rule_set *set)
{
    uint64_t next = CW_NEVER;
    for (unsigned rule = 0; rule < set->count; rule++) {
        const cw_rule_state *s = cw_rule_at(set, rule);
        if (!s->used)
            continue;
        next = cw_least(next, cw_least(s->fire_at, cw_rule_next_arming(s)));
        next = cw_least(next, next_of_action(s));
    }
    set->next_due = cw_least(next, cw_rules_next_held(set));
}

/* Runs until nothing is left to do: rules may arm each other at the same tick, each one once. */
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
            cw_rule_plan_from(s, cw_rules_now(set));
    }
}

/* Returns the latest tick that is known for one rule; 0: none. */
static uint64_t known_until(const cw_rule_state *s)
{
    uint64_t until = s->active && s->active_until != CW_NEVER ? s->active_until : 0;
    if (cw_rule_is_over(s))
        return until;
    if (s->fire_at != CW_NEVER && s->fire_at > until)
        until = s->fire_at;
    const bool armed = s->rule.trigger == CW_TRIGGER_ARMED && s->armings > 0;
    const uint64_t last = armed ? s->arm_at[s->armings - 1] : 0;
    return last != CW_NEVER && last > until ? last : until;
}

uint64_t cw_rules_until(const cw_rule_set *set)
{
    uint64_t until = 0;
    for (unsigned i = 0; i < set->count && set->next_due != CW_NEVER; i++) {
        const cw_rule_state *s = &set->rules[i];
        const uint64_t known = s->used && !s->rule.quiet ? known_until(s) : 0;
        until = known > until ? known : until;
    }
    return until > cw_rules_now(set) ? until : 0;
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
