/* SPDX-License-Identifier: MIT
 *
 * bind.c - rules and the transmissions that begin.
 */
#include "rule/private.h"

#include "format/bits.h"

static void encode_offer(bus_node *n, const cw_frame *frame, bool wrong_crc)
{
    if (n->wrong_crc == wrong_crc)
        return;
    n->wrong_crc = wrong_crc;
    (void)cw_bits_encode_crc(&n->mac.tx, frame, wrong_crc ? 1 : 0);
}

/* A rule that acts at the beginning of a transmission; at most one hit in a bit. What lasts for a
 * time acts in this bit already, for all nodes alike: some have not driven yet. */
static void match_transmission(cw_bus *bus, unsigned rule, unsigned node)
{
    cw_rule_state *s = cw_rule_at(bus, rule);
    uint64_t told = cw_bit_end(bus);
    bool again = s->hit_now;
    if (!again && !cw_rule_begins(bus, rule, cw_now(bus), told))
        return;
    s->hit_now = !cw_rule_is(s, CW_RANDOM_BITS);
    if (cw_rule_is(s, CW_LASTS))
        cw_rule_begin_window(bus, rule, cw_node_bit(node));
    else
        cw_rule_act_later(bus, rule, told);
    cw_rule_wake(bus, rule); /* to tell the hit at the end of the bit */
}

void cw_rules_bind(cw_bus *bus, unsigned node, const cw_frame *frame)
{
    bus_node *n = &bus->nodes[node];
    uint64_t self = cw_node_bit(node);
    bool wrong_crc = false;
    for (unsigned i = 0; i < bus->rules.awake_count; i++)
        cw_rule_at(bus, bus->rules.awake[i])->bound &= ~self;
    cw_candidates c;
    unsigned rule;
    cw_candidates_begin(&c, bus, frame);
    while (cw_candidates_next(&c, &rule, bus)) {
        cw_rule_state *s = cw_rule_at(bus, rule);
        const cw_rule *r = &s->rule;
        if (!cw_rule_names(r->from, self) || !cw_rule_acts_on_wire(s))
            continue;
        if (cw_rule_is(s, CW_HAS_POSITION)) {
            s->bound |= cw_rule_is_over(s) ? 0 : self;
            cw_rule_wake(bus, rule);
        } else if (!cw_rule_is(s, CW_IN_ENCODING)) {
            match_transmission(bus, rule, node);
        } else if (cw_rule_names(r->nodes, self) &&
                   (s->hit_now ||
                    cw_rule_match(bus, rule, cw_now(bus), cw_bit_end(bus)))) {
            s->hit_now = true;
            wrong_crc = true;
            cw_rule_wake(bus, rule);
        }
    }
    encode_offer(n, frame, wrong_crc);
}
