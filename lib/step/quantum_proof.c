/* SPDX-License-Identifier: MIT
 *
 * quantum_proof.c - what clean frames need to know of nodes, and for which pairs of nodes the one
 * reads all bits of the other one right.
 *
 * A receiver synchronises to each falling edge. Its bit begins with the quantum in which the edge
 * comes, so up to one quantum before it. That holds as long as no edge is further from its
 * expected place than sjw, at most ten bits after the edge before it. Then nothing is left of
 * edges before, and each sample of the ten bits lies in its bit.
 */
#include "step/quantum_clean.h"

#define BITS 10 /* between two falling edges, at most, and from the last one to the ACK slot */
#define BITS_TO_SLOT 11 /* ... to the ACK slot, with one more for safety */

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
    const cw_clean_node *r = cw_clean_at(&bus->timed.clean, receiver);
    const cw_span bit = r->bit, others = cw_clean_at(&bus->timed.clean, sender)->bit;
    const cw_span late = greater(BITS * (others - bit), 0);
    const cw_span early = greater(BITS * (bit - others), 0);
    const cw_span skew = delay(bus, sender, receiver, CW_RECESSIVE) -
                         delay(bus, sender, receiver, CW_DOMINANT);
    const bool synchronises = late <= r->sjw && early <= r->sjw && early <= bit - r->to_sample;
    const bool begun = r->quantum + late + greater(skew, 0) < r->to_first_look;
    const bool not_over = lesser(others, bit) - early + lesser(skew, 0) >= r->to_sample;
    return synchronises && begun && not_over;
}

/* A node must see its own level at its own samples. */
static bool reads_itself(const cw_clean_node *n)
{
    return greater(n->own[CW_DOMINANT], n->own[CW_RECESSIVE]) + n->quantum < n->to_first_look;
}

/* Finds the length of the node's bit, and where in it the node looks. */
static void find_spans(cw_clean_node *n, const cw_bit_timing *t)
{
    n->quantum = t->quantum;
    n->bit = t->quantum * cw_bit_timing_quanta(t);
    n->to_sample = t->quantum * cw_bit_timing_sample_at(t);
    n->to_first_look = n->to_sample - (t->triple_sampling ? 2 * t->quantum : 0);
    n->sjw = t->sjw * t->quantum;
}

/* Finds the parts of the ways to and from a node. */
static void find_ways(cw_clean_node *n, const cw_way *way)
{
    n->place = way->place;
    n->resyncs = n->unheard = n->harmless = 0;
    for (unsigned level = 0; level < 2; level++) {
        n->out[level] = way->tx_delay[level] + way->stub;
        n->in[level] = way->rx_delay[level] + way->stub;
        n->own[level] = way->tx_delay[level] + way->rx_delay[level];
    }
    n->from_below = n->in[CW_DOMINANT] + n->place;
    n->from_above = n->in[CW_DOMINANT] - n->place;
}

/* Returns by how much edges to recessive are under way for longer than others, or shorter. */
static cw_span skew_of(const cw_bus *bus, unsigned from, unsigned to)
{
    const cw_span skew = delay(bus, from, to, CW_RECESSIVE) - delay(bus, from, to, CW_DOMINANT);
    return skew < 0 ? -skew : skew;
}

/* Finds who reads the sender right for sure. */
static uint64_t find_harmless(const cw_bus *bus, unsigned sender)
{
    uint64_t harmless = 0;
    for (unsigned i = 0; i < bus->node_count; i++) {
        const bool right = i == sender ? reads_itself(cw_clean_at(&bus->timed.clean, i))
                                       : reads_right(bus, sender, i);
        harmless |= right ? cw_node_bit(i) : 0;
    }
    return harmless;
}

/* Finds how long edges of a node are under way. */
static void find_delays(cw_bus *bus, unsigned from)
{
    cw_clean *clean = &bus->timed.clean;
    cw_clean_node *n = cw_clean_at(clean, from);
    n->near = bus->node_count > 1 ? CW_SPAN_MAX : 0;
    n->far = n->last_arrival = 0;
    for (unsigned i = 0; i < bus->node_count; i++) {
        n->last_arrival = greater(n->last_arrival, delay(bus, from, i, CW_RECESSIVE));
        clean->most_skew = greater(clean->most_skew, skew_of(bus, from, i));
        if (i == from)
            continue;
        n->near = lesser(n->near, delay(bus, from, i, CW_DOMINANT));
        n->far = greater(n->far, delay(bus, from, i, CW_DOMINANT));
    }
}

/* An ACK slot begins up to a quantum before the bit of the sender comes, and what clocks differ by
 * before it or behind it. By an early edge it begins up to a quantum earlier. So much before it is
 * still behind the sample point of the bit before. The last of those who acknowledge has left the
 * wire when the first one looks at the next bit. */
static void find_sure(cw_bus *bus, unsigned sender)
{
    const cw_clean *clean = &bus->timed.clean;
    cw_clean_node *n = cw_clean_at(&bus->timed.clean, sender);
    const cw_span early = clean->most_quantum + 2 * clean->drift;
    n->round = 0;
    for (unsigned i = 0; i < bus->node_count; i++)
        if (i != sender)
            n->round = greater(n->round, delay(bus, sender, i, CW_DOMINANT) +
                                             cw_clean_at(clean, i)->last_arrival);
    n->sure = early <= clean->least_behind &&
              n->round + clean->most_quantum + early + clean->most_bit - clean->least_bit <
                  n->near + clean->least_look;
}

/* Gives the nodes the order of their places on the line. */
static void sort_places(cw_clean *clean, const cw_way *ways, unsigned count)
{
    clean->at_one_place = true;
    for (unsigned i = 0; i < count; i++) {
        unsigned k = i;
        for (; k > 0 && ways[clean->nodes[k - 1].node].place > ways[i].place; k--)
            clean->nodes[k].node = clean->nodes[k - 1].node;
        clean->nodes[k].node = i;
        clean->at_one_place = clean->at_one_place && ways[i].place == ways[0].place;
    }
    for (unsigned k = 0; k < count; k++)
        clean->at[clean->nodes[k].node] = (uint8_t)k;
}

/* Finds the limits of all nodes together. */
static void find_limits(cw_bus *bus)
{
    cw_clean *clean = &bus->timed.clean;
    clean->least_delay = clean->least_bit = clean->least_look = clean->least_behind = CW_SPAN_MAX;
    clean->least_quantum = CW_SPAN_MAX;
    clean->most_bit = clean->most_behind = clean->most_quantum = clean->most_out = 0;
    for (unsigned i = 0; i < bus->node_count; i++) {
        const cw_clean_node *n = &clean->nodes[i];
        clean->least_bit = lesser(clean->least_bit, n->bit);
        clean->most_bit = greater(clean->most_bit, n->bit);
        clean->least_look = lesser(clean->least_look, n->to_first_look);
        clean->least_behind = lesser(clean->least_behind, n->bit - n->to_sample);
        clean->most_behind = greater(clean->most_behind, n->bit - n->to_sample);
        clean->least_delay = lesser(clean->least_delay, n->near);
        clean->least_quantum = lesser(clean->least_quantum, n->quantum);
        clean->most_quantum = greater(clean->most_quantum, n->quantum);
        clean->most_out = greater(clean->most_out, n->out[CW_DOMINANT]);
    }
    clean->drift = BITS_TO_SLOT * (clean->most_bit - clean->least_bit);
}

void cw_clean_prove(cw_bus *bus)
{
    cw_clean *clean = &bus->timed.clean;
    const cw_way *ways = cw_cable_ways(&bus->timed.cable);
    bool retimed = false;
    if (clean->valid)
        return;
    sort_places(clean, ways, bus->node_count);
    for (unsigned i = 0; i < bus->node_count; i++) {
        find_spans(cw_clean_at(clean, i), &bus->timed.nodes[i].timing);
        find_ways(cw_clean_at(clean, i), &ways[i]);
        retimed = retimed || bus->timed.nodes[i].retimed;
    }
    clean->most_skew = 0;
    for (unsigned i = 0; i < bus->node_count; i++)
        find_delays(bus, i);
    find_limits(bus);
    for (unsigned i = 0; i < bus->node_count && clean->most_bit <= LONGEST_BIT; i++) {
        cw_clean_at(clean, i)->harmless = find_harmless(bus, i);
        find_sure(bus, i);
    }
    clean->valid = !retimed;
}
