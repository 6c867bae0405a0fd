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
 * Mostly it is sure that all who acknowledge read the slot right (quantum_proof.c).
 */
#include "step/quantum_clean.h"

/* ---- The plan -------------------------------------------------------------------------------- */

/* Plans the ACK slots of receivers in a row as if nobody acknowledged. The bits of a node begin
 * with the quantum in which the last edge came. key: of this edge. up: the receivers are above the
 * sender. seen: the first key of an acknowledgement that goes up from below. along: such edges have
 * to go along the line. Returns the first key with those of the receivers. */
static inline __attribute__((always_inline)) cw_span
plan_receivers(const cw_clean_frame *f, cw_clean_node *c, const cw_clean_node *behind_last,
               cw_span key, bool up, cw_span seen, bool along)
{
    const cw_span left = f->slot - f->edge;
    const size_t slots = f->slots;
    for (; c < behind_last; c++) {
        const cw_span arrival = key + (up ? c->from_below : c->from_above);
        const cw_span phase = (arrival - c->origin) % c->quantum;
        const cw_span ack = arrival - phase + left * c->bit;
        c->slot[slots].ack = ack;
        seen = ack + c->down < seen ? ack + c->down : seen;
        if (along)
            c->slot[slots].arrival = seen + c->from_below;
    }
    return seen;
}

/* Plans the slots of all nodes, where no edge has to go along the line. */
static void plan_at_one_place(const cw_clean_frame *f, cw_clean *clean,
                              const cw_clean_node *sender, const cw_clean_node *behind_last,
                              cw_span key)
{
    cw_clean_node *above = &clean->nodes[sender - clean->nodes + 1];
    const cw_span seen = plan_receivers(f, clean->nodes, sender, key, true, CW_NO_KEY, false);
    clean->slots[f->slots].seen = plan_receivers(f, above, behind_last, key, true, seen, false);
}

/* Lets acknowledgements that go down the line arrive at nodes in a row. Returns the first key with
 * those of the nodes. */
static cw_span go_down(cw_clean_node *row, const cw_clean_node *behind_last, unsigned slots,
                       cw_span seen)
{
    for (size_t k = (size_t)(behind_last - row); k-- > 0;) {
        const cw_clean_node *c = &row[k];
        cw_clean_slot *slot = &row[k].slot[slots];
        seen = slot->ack + c->up < seen ? slot->ack + c->up : seen;
        if (seen + c->from_above < slot->arrival)
            slot->arrival = seen + c->from_above;
    }
    return seen;
}

/* Plans the slots of all nodes. Acknowledgements first go up the line, then down. */
static void plan_along(const cw_clean_frame *f, cw_clean *clean, cw_clean_node *sender,
                       const cw_clean_node *behind_last, cw_span key)
{
    cw_clean_slot *own = &sender->slot[f->slots];
    cw_span seen = plan_receivers(f, clean->nodes, sender, key + 2 * sender->place, false,
                                  CW_NO_KEY, true);
    own->arrival = seen + sender->from_below;
    (void)plan_receivers(f, sender + 1, behind_last, key, true, seen, true);
    seen = go_down(sender + 1, behind_last, f->slots, CW_NO_KEY);
    if (seen + sender->from_above < own->arrival)
        own->arrival = seen + sender->from_above;
    (void)go_down(clean->nodes, sender, f->slots, seen);
}

/* Plans the slots. */
static void plan(cw_bus *bus, const cw_clean_frame *f)
{
    cw_clean *clean = &bus->timed.clean;
    cw_clean_node *sender = cw_clean_at(clean, f->sender);
    const cw_clean_node *behind_last = clean->nodes + bus->node_count;
    const cw_span key = f->begin + f->edge * f->bit + sender->out[CW_DOMINANT] - sender->place;
    sender->slot[f->slots].ack = f->begin + f->slot * f->bit;
    clean->slots[f->slots].drivers = f->drivers;
    if (clean->at_one_place)
        plan_at_one_place(f, clean, sender, behind_last, key);
    else
        plan_along(f, clean, sender, behind_last, key);
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

cw_span cw_clean_end_of_slot(const cw_clean *clean, unsigned slots, const cw_clean_node *c)
{
    const cw_span behind = cw_clean_behind(clean, slots, c);
    const cw_span end = c->slot[slots].ack + c->bit;
    const bool hard = clean->away >> c->node & 1u;
    if (behind < 0)
        return end - early_by(c, -behind, hard);
    return clean->slots[slots].drivers >> c->node & 1u ? end : end + later_by(c, behind, hard);
}

/* Returns true when the edge comes at a right time for a node. */
static bool comes_right(const cw_clean *clean, const cw_clean_frame *f, const cw_clean_node *c)
{
    const cw_span behind = cw_clean_behind(clean, f->slots, c);
    const bool drives = f->drivers >> c->node & 1u;
    return behind >= c->to_sample - c->bit && (drives || behind < c->to_first_look);
}

/* Returns true when a node sees the slot dominant and the bit behind it recessive. */
static bool reads_slot(const cw_clean_frame *f, const cw_clean_node *c, cw_span end)
{
    const bool seen = (f->drivers >> c->node & 1u) || f->least_end >= end - c->bit + c->to_sample;
    return seen && f->released < end + c->to_first_look;
}

/* Returns true when all nodes read it that do not drive it. */
static bool others_read_slot(const cw_bus *bus, cw_clean_frame *f)
{
    const cw_clean *clean = &bus->timed.clean;
    for (uint64_t rest = bus->all & ~f->drivers; rest; rest &= rest - 1) {
        const cw_clean_node *c = cw_clean_at(clean, cw_lowest_node(rest));
        const cw_span end = cw_clean_end_of_slot(clean, f->slots, c);
        if (!comes_right(clean, f, c) || !reads_slot(f, c, end))
            return false;
        f->most_end = end > f->most_end ? end : f->most_end;
    }
    return true;
}

/* Finds limits of the ends of the drivers' slots, and what follows of them. Slots begin up to a
 * quantum before the sender's bit comes, and early edges move them by up to a quantum. */
static void find_limits(const cw_bus *bus, cw_clean_frame *f)
{
    const cw_clean *clean = &bus->timed.clean;
    const cw_clean_node *sender = cw_clean_at(clean, f->sender);
    const cw_span slot = f->begin + f->slot * f->bit;
    const cw_span least = slot - 2 * clean->most_quantum - clean->drift + clean->least_bit;
    const cw_span most = slot + clean->drift + clean->most_bit;
    const bool all = f->drivers == (bus->all & ~cw_node_bit(f->sender));
    f->least_end = least + sender->near;
    f->late_end = least + sender->far;
    f->most_end = most + sender->far;
    f->leaves = all ? least + sender->round : f->least_end;
    f->released = most + sender->round;
    f->begun = cw_clean_begun(clean, f->released);
}

/* Makes the limits closer where all nodes are at one place. There the first driver, which begins as
 * planned, ends last, but for differences of delays and clocks. All others begin so early that
 * they are a quantum ahead, or hardly behind it. */
static void find_near_limits(const cw_bus *bus, cw_clean_frame *f)
{
    const cw_clean *clean = &bus->timed.clean;
    const cw_clean_node *sender = cw_clean_at(clean, f->sender);
    const cw_span first = clean->slots[f->slots].seen + sender->place;
    const cw_span early = f->most_end - clean->most_bit - clean->least_quantum;
    const cw_span on_time = first + bus->timed.longest;
    f->late_end = f->leaves = first - clean->most_out + clean->least_bit;
    f->most_end = (on_time > early ? on_time : early) + clean->most_bit;
    f->released = f->most_end + bus->timed.longest;
    f->begun = first + bus->timed.longest;
}

/* Looks at the slots of all nodes. Not inlined, since mostly it is sure that they read them
 * right. */
__attribute__((noinline)) static bool all_read_slot(const cw_bus *bus, cw_clean_frame *f)
{
    const cw_clean *clean = &bus->timed.clean;
    f->least_end = CW_SPAN_MAX;
    f->released = 0;
    for (uint64_t rest = f->drivers; rest; rest &= rest - 1) {
        const cw_clean_node *c = cw_clean_at(clean, cw_lowest_node(rest));
        const cw_span end = cw_clean_end_of_slot(clean, f->slots, c), gone = end + c->last_arrival;
        f->least_end = end < f->least_end ? end : f->least_end;
        f->released = gone > f->released ? gone : f->released;
    }
    for (uint64_t rest = f->drivers; rest; rest &= rest - 1) {
        const cw_clean_node *c = cw_clean_at(clean, cw_lowest_node(rest));
        const cw_span end = cw_clean_end_of_slot(clean, f->slots, c);
        if (!comes_right(clean, f, c) || !reads_slot(f, c, end))
            return false;
    }
    return true;
}

bool cw_clean_acknowledge(cw_bus *bus, cw_clean_frame *f)
{
    const cw_clean *clean = &bus->timed.clean;
    f->drivers = clean->drivers & ~cw_node_bit(f->sender);
    f->slots = !clean->last;
    if (!f->drivers)
        return false;
    plan(bus, f);
    find_limits(bus, f);
    if (clean->at_one_place)
        find_near_limits(bus, f);
    return (cw_clean_at(clean, f->sender)->sure || all_read_slot(bus, f)) &&
           others_read_slot(bus, f);
}
