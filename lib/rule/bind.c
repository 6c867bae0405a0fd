/* SPDX-License-Identifier: MIT
 *
 * bind.c - binds rules to the transmissions that begin.
 */
#include "rule/private.h"

/* Matches a rule that acts at the beginning of a transmission; at most one hit in a bit. An action
 * that lasts for a time acts in this bit already, for all nodes alike: some have not driven yet. */
static void match_transmission(cw_rule_set *set, unsigned rule, unsigned node)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    uint64_t reported = cw_rules_bit_end(set);
    bool again = s->hit_now;
    if (!again && !cw_rule_begins(set, rule, cw_rules_now(set), reported))
        return;
    if (!cw_rule_is(s, CW_RANDOM_BITS))
        cw_rule_note_hit(set, rule, reported);
    if (cw_rule_is(s, CW_LASTS))
        cw_rule_begin_window(set, rule, cw_node_bit(node));
    else
        cw_rule_act_later(set, rule, reported);
    cw_rule_wake(set, rule); /* to report the hit at the end of the bit */
}

bool cw_rules_bind(cw_rule_set *set, unsigned node, const cw_frame *frame)
{
    uint64_t self = cw_node_bit(node);
    bool wrong_crc = false;
    for (unsigned i = 0; i < set->awake_count; i++)
        cw_rule_unbind(cw_rule_at(set, set->awake[i]), self);
    cw_candidates c;
    unsigned rule;
    cw_candidates_begin(&c, set, frame);
    while (cw_candidates_next(&c, &rule, set)) {
        cw_rule_state *s = cw_rule_at(set, rule);
        const cw_rule *r = &s->rule;
        if (!cw_rule_names(r->from, self) || !cw_rule_acts_on_wire(s))
            continue;
        if (cw_rule_is(s, CW_HAS_POSITION)) {
            s->position.bound |= cw_rule_is_over(s) ? 0 : self;
            cw_rule_wake(set, rule);
        } else if (!cw_rule_is(s, CW_IN_ENCODING)) {
            match_transmission(set, rule, node);
        } else if (cw_rule_names(r->nodes, self) &&
                   (s->hit_now ||
                    cw_rule_match(set, rule, cw_rules_now(set), cw_rules_bit_end(set)))) {
            cw_rule_note_hit(set, rule, cw_rules_bit_end(set));
            wrong_crc = true;
        }
    }
    return wrong_crc;
}
