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

/* Binds a rule that acts on the wire. Returns true when the frame is to have a wrong CRC. */
static bool bind_rule(cw_rule_set *set, unsigned rule, unsigned node)
{
    const uint64_t self = cw_node_bit(node);
    cw_rule_state *s = cw_rule_at(set, rule);
    if (cw_rule_is(s, CW_HAS_POSITION)) {
        s->position.bound |= cw_rule_is_over(s) ? 0 : self;
        cw_rule_wake(set, rule);
        return false;
    }
    if (!cw_rule_is(s, CW_IN_ENCODING)) {
        match_transmission(set, rule, node);
        return false;
    }
    if (!cw_rule_names(s->rule.nodes, self) ||
        !(s->hit_now || cw_rule_match(set, rule, cw_rules_now(set), cw_rules_bit_end(set))))
        return false;
    cw_rule_note_hit(set, rule, cw_rules_bit_end(set));
    return true;
}

/* Binds all rules whose filters match the frame. */
static bool bind_all(cw_rule_set *set, unsigned node, const cw_frame *frame)
{
    bool wrong_crc = false;
    cw_candidates c;
    unsigned rule;
    cw_candidates_begin(&c, set, frame);
    while (cw_candidates_next(&c, &rule, set)) {
        const cw_rule_state *s = cw_rule_at(set, rule);
        if (cw_rule_names(s->rule.from, cw_node_bit(node)) && cw_rule_acts_on_wire(s) &&
            bind_rule(set, rule, node))
            wrong_crc = true;
    }
    return wrong_crc;
}

/* A frame that has been compared with the rules mostly has one rule, or none. */
bool cw_rules_bind(cw_rule_set *set, unsigned node, const cw_frame *frame)
{
    for (unsigned i = 0; i < set->awake_count; i++)
        cw_rule_unbind(cw_rule_at(set, set->awake[i]), cw_node_bit(node));
    if (!cw_rules_know(set, cw_node_bit(node)) || set->watcher[node] == CW_SEVERAL_RULES)
        return bind_all(set, node, frame);
    return set->watcher[node] != CW_NO_RULE && bind_rule(set, set->watcher[node], node);
}
