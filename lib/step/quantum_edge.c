/* SPDX-License-Identifier: MIT
 *
 * quantum_edge.c - one edge to dominant that several nodes drive at nearly the same time: the
 * acknowledgement.
 *
 * The nodes drive in the order of time. A node that sees the edge of another one before it begins
 * its own bit begins it earlier. So an edge can only move the edges of nodes that come later.
 */
#include "step/quantum.h"

/* The start of a bit as it is counted, and the moment at which it is driven (T12). */
typedef struct begin_of_bit {
    cw_span counted;
    cw_span driven;
} begin_of_bit;

/* Returns the start of a bit before which an edge comes. The edge ends the bit before it, or makes
 * it shorter (T4, T5). */
static begin_of_bit begin_early(const cw_timed_node *n, cw_span planned, cw_span arrival, bool hard)
{
    const cw_span quantum = n->timing.quantum;
    const cw_span before = planned - arrival + quantum - 1;
    const cw_span left = before < 2 * quantum ? quantum : before - before % quantum;
    if (left <= n->timing.sjw * quantum || hard)
        return (begin_of_bit){.counted = planned - left, .driven = planned - left + quantum};
    const cw_span begin = planned - n->timing.sjw * quantum;
    return (begin_of_bit){.counted = begin, .driven = begin};
}

/* Returns where a node begins its bit, with the edges that it sees until then. */
static begin_of_bit begin_of(const cw_bus *bus, const cw_common_edge *edge, unsigned i)
{
    const cw_span planned = edge->begin[i], arrival = edge->arrival[i];
    if (arrival >= planned)
        return (begin_of_bit){.counted = planned, .driven = planned};
    return begin_early(&bus->timed.nodes[i], planned, arrival, edge->hard >> i & 1u);
}

/* Lets the edge of a node arrive at others. Returns the latest arrival of a first edge there. */
static cw_span arrive(const cw_bus *bus, cw_common_edge *edge, unsigned from, uint64_t nodes)
{
    const cw_cable *cable = &bus->timed.cable;
    const cw_span driven = edge->drive[from];
    cw_span latest = 0;
    for (; nodes; nodes &= nodes - 1) {
        const unsigned i = cw_lowest_node(nodes);
        const cw_span arrival = driven + cw_cable_delay(cable, from, i, CW_DOMINANT);
        if (arrival < edge->arrival[i]) {
            edge->arrival[i] = arrival;
            if (edge->drivers >> i & 1u)
                edge->drive[i] = begin_of(bus, edge, i).driven;
        }
        if (edge->arrival[i] > latest)
            latest = edge->arrival[i];
    }
    return latest;
}

/* Returns the node whose edge comes first. */
static unsigned first_driver(const cw_common_edge *edge, uint64_t drivers)
{
    unsigned first = cw_lowest_node(drivers);
    for (uint64_t rest = drivers & (drivers - 1); rest; rest &= rest - 1)
        if (edge->drive[cw_lowest_node(rest)] < edge->drive[first])
            first = cw_lowest_node(rest);
    return first;
}

/* Finds when the edge comes to each node. Later drivers move only nodes that come still later. */
static void find_arrivals(const cw_bus *bus, cw_common_edge *edge)
{
    const cw_span least = bus->timed.proof.least_delay;
    cw_span latest = CW_SPAN_MAX;
    for (uint64_t rest = edge->nodes; rest; rest &= rest - 1) {
        const unsigned i = cw_lowest_node(rest);
        edge->arrival[i] = CW_SPAN_MAX;
        edge->drive[i] = edge->begin[i];
    }
    for (uint64_t rest = edge->drivers; rest;) {
        const unsigned i = first_driver(edge, rest);
        if (edge->drive[i] + least >= latest)
            return; /* the edges of others have come before it everywhere */
        rest &= ~cw_node_bit(i);
        latest = arrive(bus, edge, i, edge->nodes & (~edge->drivers | rest));
    }
}

/* Places the bit of a node. Returns false when the edge comes at a wrong time for it. */
static bool place_bit(const cw_bus *bus, cw_common_edge *edge, unsigned i)
{
    const cw_timed_node *n = &bus->timed.nodes[i];
    const cw_clean_proof *proof = &bus->timed.proof;
    const cw_span bit = proof->bit[i], to_sample = proof->to_sample[i];
    const cw_span planned = edge->begin[i], arrival = edge->arrival[i];
    if (arrival < planned - bit + to_sample)
        return false;
    edge->begin[i] = begin_of(bus, edge, i).counted;
    edge->sample[i] = edge->begin[i] + to_sample;
    edge->next[i] = edge->begin[i] + bit;
    if (edge->drivers >> i & 1u)
        return true;
    if (arrival >= planned + proof->to_first_look[i])
        return false;
    if (arrival < planned + n->timing.quantum)
        return true;
    const cw_span in = (arrival - planned) / n->timing.quantum;
    const bool hard = edge->hard >> i & 1u;
    const cw_span later = (hard || in < n->timing.sjw ? in : n->timing.sjw) * n->timing.quantum;
    edge->sample[i] += later;
    edge->next[i] += later;
    return true;
}

/* Finds the first and the last moment at which a driver ends its dominant bit. */
static void find_release(const cw_bus *bus, cw_common_edge *edge, cw_span *first)
{
    *first = edge->released = edge->next[cw_lowest_node(edge->drivers)];
    for (uint64_t rest = edge->drivers; rest; rest &= rest - 1) {
        const unsigned i = cw_lowest_node(rest);
        const cw_span end = edge->next[i], arrival = end + bus->timed.proof.last_arrival[i];
        *first = end < *first ? end : *first;
        edge->released = arrival > edge->released ? arrival : edge->released;
    }
}

bool cw_timed_find_edge(const cw_bus *bus, cw_common_edge *edge)
{
    cw_span first;
    find_arrivals(bus, edge);
    for (uint64_t rest = edge->nodes; rest; rest &= rest - 1)
        if (!place_bit(bus, edge, cw_lowest_node(rest)))
            return false;
    find_release(bus, edge, &first);
    for (uint64_t rest = edge->nodes; rest; rest &= rest - 1) {
        const unsigned i = cw_lowest_node(rest);
        const cw_span next_look = edge->next[i] + bus->timed.proof.to_first_look[i];
        const bool over = edge->released < next_look;
        if (!over || (!(edge->drivers >> i & 1u) && first < edge->sample[i]))
            return false;
    }
    return true;
}
