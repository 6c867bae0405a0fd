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
    cw_fault *f = cw_fault_at(bus, rule);
    uint64_t told = cw_bit_end(bus);
    bool again = f->hit_now;
    if (!again && !cw_fault_begins(bus, rule, cw_now(bus), told))
        return;
    f->hit_now = !cw_fault_is(f, CW_RANDOM_BITS);
    if (cw_fault_is(f, CW_LASTS))
        cw_fault_begin_window(bus, rule, cw_node_bit(node));
    else
        cw_fault_act_later(bus, rule, told);
    cw_fault_wake(bus, rule); /* to tell the hit at the end of the bit */
}

void cw_fault_transmission(cw_bus *bus, unsigned node, const cw_frame *frame)
{
    bus_node *n = &bus->nodes[node];
    uint64_t self = cw_node_bit(node);
    bool wrong_crc = false;
    for (unsigned i = 0; i < bus->faults.awake_count; i++)
        cw_fault_at(bus, bus->faults.awake[i])->bound &= ~self;
    cw_candidates c;
    unsigned rule;
    cw_candidates_begin(&c, bus, frame);
    while (cw_candidates_next(&c, &rule, bus)) {
        cw_fault *f = cw_fault_at(bus, rule);
        const cw_rule *r = &f->rule;
        if (!cw_fault_names(r->from, self) || !cw_fault_acts_on_wire(f))
            continue;
        if (cw_fault_is(f, CW_HAS_POSITION)) {
            f->bound |= cw_fault_is_over(f) ? 0 : self;
            cw_fault_wake(bus, rule);
        } else if (!cw_fault_is(f, CW_IN_ENCODING)) {
            match_transmission(bus, rule, node);
        } else if (cw_fault_names(r->nodes, self) &&
                   (f->hit_now ||
                    cw_fault_match(bus, rule, cw_now(bus), cw_bit_end(bus)))) {
            f->hit_now = true;
            wrong_crc = true;
            cw_fault_wake(bus, rule);
        }
    }
    encode_offer(n, frame, wrong_crc);
}
