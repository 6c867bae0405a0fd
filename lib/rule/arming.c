/* SPDX-License-Identifier: MIT
 *
 * arming.c - rules that act only when they are armed: after a hit of another one, or by hand.
 */
#include "rule/private.h"

#include <string.h>

bool cw_rule_add_arming(cw_rule_set *set, unsigned rule, uint64_t tick)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    if (s->armings == CW_ARMINGS_MAX)
        return false;
    unsigned place = s->armings++;
    for (; place > 0 && s->arm_at[place - 1] > tick; place--)
        s->arm_at[place] = s->arm_at[place - 1];
    s->arm_at[place] = tick;
    cw_rules_set_due(set, tick);
    return true;
}

void cw_rule_take_arming(cw_rule_state *s, uint64_t tick)
{
    s->armed_at = tick;
    s->armed++;
    s->armings--;
    memmove(&s->arm_at[0], &s->arm_at[1], s->armings * sizeof s->arm_at[0]);
}

/* Returns the tick of the next arming. Rules without delay can form a ring, which then goes round
 * once in a bit. */
uint64_t cw_rule_next_arming(const cw_rule_state *s)
{
    if (s->armings == 0)
        return CW_NEVER;
    bool again = s->armed_at != CW_NEVER && s->arm_at[0] <= s->armed_at;
    return again ? s->armed_at + 1 : s->arm_at[0];
}

/* Arms the rules that come after this one, at once or later. */
void cw_rule_arm_followers(cw_rule_set *set, unsigned rule, uint64_t reported)
{
    if (set->after_rules == 0)
        return;
    set->work += 1 + set->count / CW_RULES_OF_A_PIECE;
    for (unsigned i = 0; i < set->count; i++) {
        const cw_rule_state *s = cw_rule_at(set, i);
        if (s->used && s->rule.has_after && s->rule.after == rule)
            (void)cw_rule_add_arming(set, i, cw_after(reported, s->rule.after_delay));
    }
}
