/* SPDX-License-Identifier: MIT
 *
 * rule.c - decides whether a match of a rule is a hit, and counts it.
 */
#include "rule/private.h"

bool cw_rule_is_over(const cw_rule_state *s)
{
    return s->rule.count != 0 && s->hits >= s->rule.count;
}

/* Returns true when all nodes that the rule names are in one of its states. */
static bool states_match(const cw_rule_set *set, const cw_rule *rule)
{
    for (uint64_t rest = rule->state_nodes; rest; rest &= rest - 1) {
        const unsigned i = cw_lowest_node(rest);
        const cw_state state = *set->bus.asleep >> i & 1u ? CW_STATE_SLEEPING
                                                          : cw_mac_state(set->bus.macs[i]);
        if (!(rule->state_mask >> state & 1u))
            return false;
    }
    return true;
}

/* Returns true when something other than numbers and chance keeps the rule from a match. */
static bool is_gated(const cw_rule_set *set, const cw_rule_state *s, uint64_t start)
{
    const cw_rule *r = &s->rule;
    return start < r->time_begin || start >= r->time_end || cw_rule_is_over(s) ||
           (cw_rule_needs_arming(r) && s->armed == 0) || !states_match(set, r);
}

void cw_rule_count_hit(cw_rule_set *set, unsigned rule, uint64_t reported)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    s->hits++;
    s->last_hit = reported;
    if (cw_rule_is_over(s))
        cw_rules_forget_all(set);
    cw_rule_arm_followers(set, rule, reported);
}

/* Counts a match. Returns whether its turn has come, so that only chance can still make it none. */
static inline bool count_match(const cw_rule_set *set, cw_rule_state *s, uint64_t start,
                               uint64_t reported)
{
    if (is_gated(set, s, start))
        return false;
    s->matches++;
    if (s->rule.hold_off > 0 && s->hits > 0 && reported - s->last_hit < s->rule.hold_off)
        return false;
    if (s->to_pass == 0)
        return true;
    s->to_pass--;
    return false;
}

/* Draws for `probability`. A rule without it consumes no draw. */
static bool draw_match(cw_rule_state *s)
{
    if (s->rule.probability == UINT64_MAX)
        return true;
    return cw_prng_next(&s->prng) < s->rule.probability;
}

bool cw_rule_takes_match(cw_rule_set *set, unsigned rule, uint64_t start, uint64_t reported)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    if (!count_match(set, s, start, reported))
        return false;
    s->to_pass = s->rule.every - 1;
    if (!draw_match(s))
        return false;
    if (cw_rule_needs_arming(&s->rule))
        s->armed--;
    s->taken++;
    return true;
}

bool cw_rule_passes_over(cw_rule_set *set, unsigned rule, uint64_t start, uint64_t reported)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    if (!count_match(set, s, start, reported))
        return true;
    const cw_prng before = s->prng;
    if (draw_match(s)) {
        s->matches--;
        s->prng = before;
        return false;
    }
    s->to_pass = s->rule.every - 1;
    return true;
}

bool cw_rule_match(cw_rule_set *set, unsigned rule, uint64_t start, uint64_t reported)
{
    if (!cw_rule_takes_match(set, rule, start, reported))
        return false;
    cw_rule_count_hit(set, rule, reported);
    return true;
}
