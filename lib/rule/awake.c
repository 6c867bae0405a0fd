/* SPDX-License-Identifier: MIT
 *
 * awake.c - the rules that are looked at in every bit.
 */
#include "rule/private.h"

#include "rule/list.h"

bool cw_rule_needs_bits(const cw_rule_state *s)
{
    bool window = cw_rule_is(s, CW_EACH_BIT) || s->for_attempt;
    bool deviates = s->outstanding != 0 && cw_rule_is(s, CW_DEVIATES);
    return s->bound != 0 || s->bits_left != 0 || s->pulses || s->hit_now ||
           (s->active && window) || deviates;
}

/* Returns true for bits that do not come any more after an error. */
static bool is_in_frame(cw_field field)
{
    return field < CW_FIELD_INTERMISSION || field > CW_FIELD_OVERLOAD_DELIMITER;
}

void cw_rule_unbind_ended(const cw_rule_set *set, cw_rule_state *s)
{
    for (uint64_t rest = s->bound; rest; rest &= rest - 1) {
        const cw_mac *mac = set->bus.macs[cw_lowest_node(rest)];
        bool ended = mac->role != CW_ROLE_TRANSMITTER ||
                     (is_in_frame(s->rule.field) && !cw_mac_is_sending(mac));
        if (ended)
            s->bound &= ~(rest & (~rest + 1));
    }
}

void cw_rule_wake(cw_rule_set *set, unsigned rule)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    if (s->awake)
        return;
    s->awake = true;
    cw_list_add(set->awake, &set->awake_count, rule);
}

void cw_rules_fall_asleep(cw_rule_set *set)
{
    unsigned kept = 0;
    for (unsigned i = 0; i < set->awake_count; i++) {
        unsigned rule = set->awake[i];
        cw_rule_state *s = cw_rule_at(set, rule);
        cw_rule_unbind_ended(set, s);
        s->awake = s->used && cw_rule_needs_bits(s);
        if (s->awake)
            set->awake[kept++] = (uint16_t)rule;
    }
    set->awake_count = kept;
}

void cw_rules_unbind(cw_rule_set *set)
{
    for (unsigned i = 0; i < set->awake_count; i++)
        set->rules[set->awake[i]].bound = 0;
    cw_rules_fall_asleep(set);
}
