/* SPDX-License-Identifier: MIT
 *
 * quantum_proof.c - proves for pairs of nodes that the one reads all bits of the other one right.
 *
 * A receiver synchronises to each falling edge. Its bit begins with the quantum in which the edge
 * comes, so up to one quantum before it. That holds as long as no edge is further from its
 * expected place than sjw, at most ten bits after the edge before it. Then nothing is left of
 * edges before, and each sample of the ten bits lies in its bit.
 */
#include "step/quantum.h"

#define BITS 10 /* between two falling edges, at most, and from the last one to the ACK slot */

/* A frame with all that belongs to it has fewer than 256 bits. */
#define LONGEST_BIT ((cw_span)(CW_LEAP_TICKS / 256) * CW_TICK)

static cw_span lesser(cw_span a, cw_span b)
{
    return a < b ? a : b;
}

static cw_span greater(cw_span a, cw_span b)
{
    return a > b ? a : b;
}

/* Returns how long an edge to a level is under way. */
static cw_span delay(const cw_bus *bus, unsigned from, unsigned to, bool level)
{
    return cw_cable_delay(&bus->timed.cable, from, to, level);
}

/* Edges move bits by whole quanta, so the receiver is 0 to 1 quantum ahead (T10). `late` and
 * `early` are what the sender's bits may come later or earlier than those of the receiver. */
static bool reads_right(const cw_bus *bus, unsigned sender, unsigned receiver)
{
    const cw_clean_proof *proof = &bus->timed.proof;
    const cw_timed_node *r = &bus->timed.nodes[receiver];
    const cw_span bit = proof->bit[receiver], others = proof->bit[sender];
    const cw_span late = greater(BITS * (others - bit), 0);
    const cw_span early = greater(BITS * (bit - others), 0);
    const cw_span skew = delay(bus, sender, receiver, CW_RECESSIVE) -
                         delay(bus, sender, receiver, CW_DOMINANT);
    const cw_span most = r->timing.sjw * r->timing.quantum;
    const bool synchronises = late <= most && early <= most &&
                              early <= bit - proof->to_sample[receiver];
    const bool begun = r->timing.quantum + late + greater(skew, 0) <
                       proof->to_first_look[receiver];
    const bool not_over = lesser(others, bit) - early + lesser(skew, 0) >=
                          proof->to_sample[receiver];
    return synchronises && begun && not_over;
}

/* A node must see its own level at its own samples. */
static bool reads_itself(const cw_bus *bus, unsigned i)
{
    const cw_span longest = greater(delay(bus, i, i, CW_DOMINANT), delay(bus, i, i, CW_RECESSIVE));
    return longest + bus->timed.nodes[i].timing.quantum < bus->timed.proof.to_first_look[i];
}

/* Finds the length of the node's bit, and where in it the node looks. */
static void find_spans(cw_clean_proof *proof, unsigned i, const cw_timed_node *n)
{
    const cw_bit_timing *t = &n->timing;
    proof->bit[i] = t->quantum * cw_bit_timing_quanta(t);
    proof->to_sample[i] = t->quantum * cw_bit_timing_sample_at(t);
    proof->to_first_look[i] = proof->to_sample[i] - (t->triple_sampling ? 2 * t->quantum : 0);
}

/* Finds who reads the sender right for sure, and how long its edges are under way. */
static void find_harmless(cw_bus *bus, unsigned sender)
{
    cw_clean_proof *proof = &bus->timed.proof;
    uint64_t harmless = 0;
    cw_span last = 0;
    for (unsigned i = 0; i < bus->node_count; i++) {
        const bool right = i == sender ? reads_itself(bus, i) : reads_right(bus, sender, i);
        harmless |= right ? cw_node_bit(i) : 0;
        last = greater(last, delay(bus, sender, i, CW_RECESSIVE));
        if (i != sender)
            proof->least_delay = lesser(proof->least_delay, delay(bus, sender, i, CW_DOMINANT));
    }
    proof->harmless[sender] = harmless;
    proof->last_arrival[sender] = last;
}

const cw_clean_proof *cw_timed_proof(cw_bus *bus)
{
    cw_clean_proof *proof = &bus->timed.proof;
    if (proof->valid)
        return proof;
    proof->least_delay = bus->node_count > 1 ? CW_SPAN_MAX : 0;
    bool retimed = false, too_long = false;
    for (unsigned i = 0; i < bus->node_count; i++) {
        find_spans(proof, i, &bus->timed.nodes[i]);
        retimed = retimed || bus->timed.nodes[i].retimed;
        too_long = too_long || proof->bit[i] > LONGEST_BIT;
        proof->harmless[i] = 0;
    }
    for (unsigned i = 0; i < bus->node_count && !too_long; i++)
        find_harmless(bus, i);
    proof->valid = !retimed;
    return proof;
}
