/* SPDX-License-Identifier: MIT
 *
 * quantum_edge.c - the acknowledgement of a clean frame: an edge that several nodes drive at nearly
 * the same time.
 *
 * Each node plans its ACK slot by the last edge of the sender. A node that sees an edge before
 * begins its slot earlier (T5), yet after that edge. On a line no way is shorter than the direct
 * one. So its own edge comes nowhere before the one that it has seen. The first edge at each node
 * is that of a node that begins as planned.
 */
#include "step/quantum.h"

#define NO_KEY (CW_SPAN_MAX / 2) /* no edge comes so late; keys are moments of edges on the line */

/* ---- The plan -------------------------------------------------------------------------------- */

/* Plans the ACK slot of a receiver as if nobody acknowledged. Bits begin with the quantum in which
 * the last edge came. */
static void plan_receiver(const cw_clean_frame *f, cw_clean_node *c, cw_span arrival, cw_span bit,
                          unsigned last)
{
    const cw_span phase = (arrival - c->delimiter[last]) % c->quantum;
    const cw_span behind = phase + (cw_span)f->edge * (bit - c->bit);
    cw_span turns = 0;
    if (behind < 0)
        turns = -((c->quantum - 1 - behind) / c->quantum);
    else if (behind >= c->quantum)
        turns = behind / c->quantum;
    c->phase = phase;
    c->turns = (int32_t)turns;
    c->ack = arrival - phase + f->slot * c->bit + turns * c->quantum;
}

/* Plans it for all nodes. */
static void plan(cw_bus *bus, const cw_clean_frame *f)
{
    const cw_clean *clean = &bus->timed.clean;
    cw_clean_node *sender = &clean->nodes[f->sender];
    const cw_cable *cable = &bus->timed.cable;
    for (unsigned i = 0; i < bus->node_count; i++)
        plan_receiver(f, &clean->nodes[i],
                      f->begin + cw_cable_delay(cable, f->sender, i, CW_DOMINANT), sender->bit,
                      clean->last);
    sender->ack = f->begin + f->slot * sender->bit;
}

/* ---- Arrivals -------------------------------------------------------------------------------- */

/* Returns the moment at which the planned edge of a node comes to the line; NO_KEY: it has none. */
static cw_span key_of(const cw_clean_node *c)
{
    return c->acknowledges ? c->ack + c->out[CW_DOMINANT] : NO_KEY;
}

/* Finds when the first edge of another node comes to each node, if no edge goes along a line.
 * Returns the first one on the line. */
static cw_span arrive_at_one_place(cw_bus *bus)
{
    cw_clean_node *nodes = bus->timed.clean.nodes;
    cw_span first = NO_KEY, second = NO_KEY;
    unsigned driver = 0;
    for (unsigned i = 0; i < bus->node_count; i++) {
        const cw_span key = key_of(&nodes[i]);
        if (key < first) {
            second = first;
            first = key;
            driver = i;
        } else if (key < second) {
            second = key;
        }
    }
    for (unsigned i = 0; i < bus->node_count; i++)
        nodes[i].arrival = first + nodes[i].in[CW_DOMINANT];
    nodes[driver].arrival = second + nodes[driver].in[CW_DOMINANT];
    return first;
}

/* Does the same where edges go along the line, at first from its one end to the other. */
static cw_span arrive_along_line(cw_bus *bus)
{
    const cw_clean *clean = &bus->timed.clean;
    cw_span first = NO_KEY, seen = NO_KEY; /* seen: as if it had come from place 0 */
    for (unsigned k = 0; k < bus->node_count; k++) {
        cw_clean_node *c = &clean->nodes[clean->along[k]];
        const cw_span key = key_of(c);
        c->arrival = seen + c->place + c->in[CW_DOMINANT];
        seen = key - c->place < seen ? key - c->place : seen;
        first = key < first ? key : first;
    }
    seen = NO_KEY;
    for (unsigned k = bus->node_count; k-- > 0;) {
        cw_clean_node *c = &clean->nodes[clean->along[k]];
        const cw_span key = key_of(c), arrival = seen - c->place + c->in[CW_DOMINANT];
        c->arrival = arrival < c->arrival ? arrival : c->arrival;
        seen = key + c->place < seen ? key + c->place : seen;
    }
    return first;
}

/* ---- The slots ------------------------------------------------------------------------------- */

/* Returns by how much an edge before its start makes the bit before a slot shorter. hard: it ends
 * that bit in any case (T4). */
static cw_span early_by(const cw_clean_node *c, cw_span before, bool hard)
{
    if (before <= c->quantum)
        return c->quantum;
    const cw_span left = (before + c->quantum - 1) / c->quantum * c->quantum;
    return hard || left < c->sjw ? left : c->sjw;
}

/* Returns by how much a later edge makes the slot of a node longer that does not acknowledge. */
static cw_span later_by(const cw_clean_node *c, cw_span behind, bool hard)
{
    const cw_span in = behind / c->quantum * c->quantum;
    return hard || in < c->sjw ? in : c->sjw;
}

/* Finds the end of the slot of a node. Returns false when the edge comes at a wrong time for it. */
static bool end_slot(cw_clean_node *c, unsigned next, bool hard)
{
    const cw_span behind = c->arrival - c->ack;
    c->delimiter[next] = c->ack + c->bit;
    if (behind < 0)
        c->delimiter[next] -= early_by(c, -behind, hard);
    else if (!c->acknowledges)
        c->delimiter[next] += later_by(c, behind, hard);
    return behind >= c->to_sample - c->bit && (c->acknowledges || behind < c->to_first_look);
}

/* Finds the ends of all slots. */
static bool end_slots(cw_bus *bus, cw_clean_frame *f)
{
    const cw_clean *clean = &bus->timed.clean;
    const unsigned next = !clean->last;
    f->least_end = f->first_end = CW_SPAN_MAX;
    f->most_end = f->released = 0;
    for (unsigned i = 0; i < bus->node_count; i++) {
        cw_clean_node *c = &clean->nodes[i];
        if (!end_slot(c, next, clean->away >> i & 1u))
            return false;
        const cw_span end = c->delimiter[next], gone = end + c->last_arrival;
        f->least_end = end < f->least_end ? end : f->least_end;
        f->most_end = end > f->most_end ? end : f->most_end;
        if (!c->acknowledges)
            continue;
        f->first_end = end < f->first_end ? end : f->first_end;
        f->released = gone > f->released ? gone : f->released;
    }
    return true;
}

/* Returns true when all nodes see the slot dominant and the bit behind it recessive. */
static bool all_read_right(const cw_bus *bus, const cw_clean_frame *f)
{
    const cw_clean *clean = &bus->timed.clean;
    for (unsigned i = 0; i < bus->node_count; i++) {
        const cw_clean_node *c = &clean->nodes[i];
        const cw_span end = c->delimiter[!clean->last];
        const bool seen = c->acknowledges || f->first_end >= end - c->bit + c->to_sample;
        if (!seen || f->released >= end + c->to_first_look)
            return false;
    }
    return true;
}

bool cw_clean_acknowledge(cw_bus *bus, cw_clean_frame *f)
{
    cw_clean_node *sender = &bus->timed.clean.nodes[f->sender];
    const bool acknowledges = sender->acknowledges; /* frames of others */
    plan(bus, f);
    sender->acknowledges = false;
    const cw_span first = bus->timed.clean.at_one_place ? arrive_at_one_place(bus)
                                                        : arrive_along_line(bus);
    const bool right = first < NO_KEY && end_slots(bus, f) && all_read_right(bus, f);
    sender->acknowledges = acknowledges;
    return right;
}
