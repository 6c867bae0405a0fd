/* SPDX-License-Identifier: MIT
 *
 * awake.c - the rules that are looked at in every bit.
 */
#include "rule/private.h"

#include "rule/list.h"

/* Returns whether an action at a position is under way, or may come in the present frame. */
static bool position_needs_bits(const cw_position_kept *kept)
{
    return kept->bound != 0 || kept->bits_left != 0 || kept->pulses;
}

bool cw_rule_needs_bits(const cw_rule_state *s)
{
    if (s->hit_now || cw_rule_is(s, CW_HAS_POSITION))
        return s->hit_now || position_needs_bits(&s->position);
    const bool window = cw_rule_is(s, CW_EACH_BIT) || s->for_attempt;
    const bool deviates = cw_rule_is(s, CW_DEVIATES) && s->traffic.outstanding != 0;
    return (s->active && window) || deviates;
}

/* Returns true for bits that no longer come after an error. */
static bool is_in_frame(cw_field field)
{
    return field < CW_FIELD_INTERMISSION || field > CW_FIELD_OVERLOAD_DELIMITER;
}

void cw_rule_unbind_ended(const cw_rule_set *set, cw_rule_state *s)
{
    for (uint64_t rest = s->position.bound; rest; rest &= rest - 1) {
        const cw_mac *mac = set->bus.macs[cw_lowest_node(rest)];
        bool ended = mac->role != CW_ROLE_TRANSMITTER ||
                     (is_in_frame(s->rule.field) && !cw_mac_is_sending(mac));
        if (ended)
            s->position.bound &= ~(rest & (~rest + 1));
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
        if (cw_rule_is(s, CW_HAS_POSITION))
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
        cw_rule_unbind(cw_rule_at(set, set->awake[i]), UINT64_MAX);
    cw_rules_fall_asleep(set);
}
