/* SPDX-License-Identifier: MIT
 *
 * quantum_edge.c - the acknowledgement of a clean frame: an edge that several nodes drive at nearly
 * the same time.
 *
 * Each node plans its ACK slot by the last edge of the sender. A node that sees an edge before
 * begins its slot earlier (T5), yet after that edge. On a line no way is shorter than the direct
 * one. So its own edge comes nowhere before the one that it has seen. The first edge at each node
 * is that of a node that begins as planned.
 *
 * Mostly the first plan and the last one are enough to say that all nodes read the slot right. Then
 * nobody looks at single nodes here.
 */
#include "step/quantum_clean.h"

#define BITS_TO_SLOT 11 /* from the last edge to dominant, at most */

/* ---- The plan -------------------------------------------------------------------------------- */

/* Returns the quanta by which an edge so far behind the start of a bit moves it. Not inlined, since
 * mostly it is one. */
__attribute__((noinline)) static cw_span turns_of(cw_span behind, cw_span quantum)
{
    return behind < 0 ? -((quantum - 1 - behind) / quantum) : behind / quantum;
}

/* Plans the ACK slots of receivers in a row as if nobody acknowledged. Bits begin with the quantum
 * in which the last edge came. up: they are above the sender, which sends its edges with the key.
 * seen: the first key of an acknowledgement that goes up from below. along: such edges have to go
 * along the line. Returns the first key with those of the receivers. */
static inline __attribute__((always_inline)) cw_span
plan_receivers(const cw_clean_frame *f, cw_clean_node *c, const cw_clean_node *behind_last,
               cw_span key, bool up, cw_span seen, bool along)
{
    const cw_span drift = f->edge * f->bit, slot = f->slot, edge = f->edge;
    for (; c < behind_last; c++) {
        const cw_span arrival = key + (up ? c->from_below : c->from_above);
        const cw_span quantum = c->quantum, bit = c->bit;
        const cw_span phase = (arrival - c->delimiter) % quantum;
        const cw_span behind = phase + drift - edge * bit;
        cw_span ack = arrival - phase + slot * bit, turns = 0;
        if (behind < 0) {
            turns = behind >= -quantum ? 1 : -turns_of(behind, quantum);
            ack -= behind >= -quantum ? quantum : turns * quantum;
        } else if (behind >= quantum) {
            turns = behind < 2 * quantum ? 1 : turns_of(behind, quantum);
            ack += behind < 2 * quantum ? quantum : turns * quantum;
        }
        c->turns = (uint64_t)turns;
        c->ack = ack;
        seen = ack + c->down < seen ? ack + c->down : seen;
        if (along)
            c->arrival = seen + c->from_below;
    }
    return seen;
}

/* Plans the slots of all nodes, where no edge has to go along the line. */
static void plan_at_one_place(cw_clean_frame *f, const cw_clean *clean, cw_clean_node *sender,
                              const cw_clean_node *behind_last)
{
    const cw_span key = f->begin + sender->out[CW_DOMINANT] - sender->place;
    f->seen = plan_receivers(f, clean->nodes, sender, key + 2 * sender->place, false, CW_NO_KEY,
                             false);
    f->seen = plan_receivers(f, sender + 1, behind_last, key, true, f->seen, false);
    f->first = f->seen + sender->place;
}

/* Lets acknowledgements that go down the line arrive at nodes in a row. first: the first one of all
 * that comes to the line. Returns the first key with those of the nodes. */
static cw_span go_down(cw_clean_node *row, const cw_clean_node *behind_last, cw_span seen,
                       cw_span *first)
{
    for (size_t k = (size_t)(behind_last - row); k-- > 0;) {
        cw_clean_node *c = &row[k];
        const cw_span key = c->ack + c->up, on_line = key - c->place;
        seen = key < seen ? key : seen;
        *first = on_line < *first ? on_line : *first;
        c->arrival = seen + c->from_above < c->arrival ? seen + c->from_above : c->arrival;
    }
    return seen;
}

/* Plans the slots of all nodes. Acknowledgements first go up the line, then down. */
static void plan_along(cw_clean_frame *f, const cw_clean *clean, cw_clean_node *sender,
                       const cw_clean_node *behind_last)
{
    const cw_span key = f->begin + sender->out[CW_DOMINANT] - sender->place;
    cw_span seen = plan_receivers(f, clean->nodes, sender, key + 2 * sender->place, false,
                                  CW_NO_KEY, true);
    sender->arrival = seen + sender->from_below;
    (void)plan_receivers(f, sender + 1, behind_last, key, true, seen, true);
    f->first = CW_NO_KEY;
    seen = go_down(sender + 1, behind_last, CW_NO_KEY, &f->first);
    if (seen + sender->from_above < sender->arrival)
        sender->arrival = seen + sender->from_above;
    (void)go_down(clean->nodes, sender, seen, &f->first);
}

/* Plans the slots. Clocks do not differ by more than the longest and the shortest bit. */
static void plan(cw_bus *bus, cw_clean_frame *f)
{
    const cw_clean *clean = &bus->timed.clean;
    cw_clean_node *sender = cw_clean_at(clean, f->sender);
    sender->ack = f->begin + f->slot * sender->bit;
    f->most_ack = sender->ack + bus->timed.longest +
                  BITS_TO_SLOT * (clean->most_bit - clean->least_bit);
    if (clean->at_one_place)
        plan_at_one_place(f, clean, sender, clean->nodes + bus->node_count);
    else
        plan_along(f, clean, sender, clean->nodes + bus->node_count);
}

/* ---- The slots ------------------------------------------------------------------------------- */

/* Returns by how much an edge before its start makes the bit before a slot shorter. hard: it ends
 * that bit in any case (T4). */
static cw_span early_by(const cw_clean_node *c, cw_span before, bool hard)
{
    const cw_span left = (before + c->quantum - 1) / c->quantum * c->quantum;
    return hard || left < c->sjw ? left : c->sjw;
}

/* Returns by how much a later edge makes the slot of a node longer that does not acknowledge. */
static cw_span later_by(const cw_clean_node *c, cw_span behind, bool hard)
{
    const cw_span in = behind / c->quantum * c->quantum;
    return hard || in < c->sjw ? in : c->sjw;
}

cw_span cw_clean_end_of_slot(const cw_clean *clean, const cw_clean_frame *f,
                             const cw_clean_node *c)
{
    const cw_span behind = cw_clean_arrival(clean, f, c) - c->ack;
    const bool hard = clean->away >> c->node & 1u;
    if (behind < 0)
        return c->ack + c->bit - early_by(c, -behind, hard);
    return c->ack + c->bit + (f->drivers >> c->node & 1u ? 0 : later_by(c, behind, hard));
}

/* Returns true when the edge comes at a right time for a node. */
static bool comes_right(const cw_clean *clean, const cw_clean_frame *f, const cw_clean_node *c)
{
    const cw_span behind = cw_clean_arrival(clean, f, c) - c->ack;
    const bool drives = f->drivers >> c->node & 1u;
    return behind >= c->to_sample - c->bit && (drives || behind < c->to_first_look);
}

/* Returns true when a node sees the slot dominant and the bit behind it recessive. */
static bool reads_slot(const cw_clean_frame *f, const cw_clean_node *c, cw_span end)
{
    const bool seen = (f->drivers >> c->node & 1u) || f->first_end >= end - c->bit + c->to_sample;
    return seen && f->released < end + c->to_first_look;
}

static void take_end(cw_clean_frame *f, cw_span end)
{
    f->least_end = end < f->least_end ? end : f->least_end;
    f->most_end = end > f->most_end ? end : f->most_end;
}

/* Returns true when all nodes read it that do not drive it. */
static bool others_read_slot(const cw_bus *bus, cw_clean_frame *f)
{
    const cw_clean *clean = &bus->timed.clean;
    for (uint64_t rest = bus->all & ~f->drivers; rest; rest &= rest - 1) {
        const cw_clean_node *c = cw_clean_at(clean, cw_lowest_node(rest));
        const cw_span end = cw_clean_end_of_slot(clean, f, c);
        if (!comes_right(clean, f, c) || !reads_slot(f, c, end))
            return false;
        take_end(f, end);
    }
    return true;
}

/* Finds limits of all slots by the first and the last plan. Returns false when nodes may read them
 * wrong for all that these limits can say. The first driver ends its slot last. */
static bool find_limits(const cw_bus *bus, cw_clean_frame *f)
{
    const cw_clean *clean = &bus->timed.clean;
    const cw_span least = f->first - clean->most_out - clean->most_quantum;
    const cw_span on_time = f->first + bus->timed.longest;
    const cw_span early = f->most_ack - clean->least_quantum;
    f->first_end = f->least_end = least + clean->least_bit;
    f->last_end = f->first - clean->most_out + clean->least_bit;
    f->most_end = (on_time > early ? on_time : early) + clean->most_bit;
    f->released = f->most_end + bus->timed.longest;
    return f->first + clean->least_in >= f->most_ack - clean->least_behind &&
           f->released < f->least_end + clean->least_look && others_read_slot(bus, f);
}

/* Finds the same by looking at each slot. Not inlined, since it is rare. */
__attribute__((noinline)) static bool look_at_all(const cw_bus *bus, cw_clean_frame *f)
{
    const cw_clean *clean = &bus->timed.clean;
    f->least_end = f->first_end = CW_SPAN_MAX;
    f->most_end = f->last_end = f->released = 0;
    for (unsigned k = 0; k < bus->node_count; k++) {
        const cw_clean_node *c = &clean->nodes[k];
        const cw_span end = cw_clean_end_of_slot(clean, f, c), gone = end + c->last_arrival;
        if (!comes_right(clean, f, c))
            return false;
        take_end(f, end);
        if (!(f->drivers >> c->node & 1u))
            continue;
        f->first_end = end < f->first_end ? end : f->first_end;
        f->last_end = end > f->last_end ? end : f->last_end;
        f->released = gone > f->released ? gone : f->released;
    }
    for (unsigned k = 0; k < bus->node_count; k++)
        if (!reads_slot(f, &clean->nodes[k], cw_clean_end_of_slot(clean, f, &clean->nodes[k])))
            return false;
    return true;
}

bool cw_clean_acknowledge(cw_bus *bus, cw_clean_frame *f)
{
    f->drivers = bus->timed.clean.drivers & ~cw_node_bit(f->sender);
    if (!f->drivers)
        return false;
    plan(bus, f);
    return find_limits(bus, f) || look_at_all(bus, f);
}
