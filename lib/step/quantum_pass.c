/* SPDX-License-Identifier: MIT
 *
 * quantum_pass.c - counts the synchronisations and margins of clean frames, for all nodes.
 *
 * A frame that comes once more brings nearly the same margins. So mostly none of them is the least
 * so far, which limits of them are enough to say. Then only synchronisations are counted. Records
 * get these when nodes leave their parking places, or when somebody reads them.
 */
#include "step/quantum_clean.h"

/* Returns true when nodes count their synchronisations. */
static bool are_counted(const cw_bus *bus)
{
    return bus->timed.records && !bus->timed.uniform;
}

/* Returns the most by which an edge of a frame may come before the start of a node's bit, or behind
 * its Sync_Seg. It is not for the acknowledgement. */
static cw_span reach_of(const cw_clean *clean)
{
    return CW_EDGE_GAP * (clean->most_bit - clean->least_bit) + clean->most_skew;
}

/* ---- Margins that are not the least ---------------------------------------------------------- */

/* Returns the quanta by which a frame turns a receiver up to the ACK slot, without their sign.
 * offset: cw_clean_offset_at_sof(), not in the first quantum. Mostly it is in one beside it. */
static inline uint64_t turns_by(cw_span offset, cw_span quantum)
{
    if ((uint64_t)(offset + quantum) < 3 * (uint64_t)quantum)
        return 1;
    return (uint64_t)(offset < 0 ? (quantum - 1 - offset) / quantum : offset / quantum);
}

/* Returns limits of the offsets of all edges of a frame at a receiver, up to the ACK slot. */
static cw_offsets find_range(const cw_bus *bus, const cw_clean_frame *f, const cw_clean_node *c)
{
    const cw_span offset = cw_clean_offset_at_sof(bus, f, c), skew = bus->timed.clean.most_skew;
    const cw_span drift = f->bit - c->bit;
    const bool turned_at_all = offset < 0 || offset >= c->quantum;
    const cw_span turns = turned_at_all ? (cw_span)turns_by(offset, c->quantum) : 0;
    const cw_span phase = offset + (drift > 0 ? turns : -turns) * c->quantum;
    const cw_span last = phase + drift * f->slot;
    cw_offsets o = {.least = phase < last ? phase : last, .most = phase < last ? last : phase};
    if (turns && drift > 0) { /* behind the turn it is at least that of the next bit */
        const cw_span bits = (c->quantum - phase + drift - 1) / drift;
        const cw_span turned = phase + drift * bits - c->quantum;
        o.least = turns > 1 ? 0 : turned < phase ? turned : phase;
        o.most = c->quantum + CW_EDGE_GAP * drift;
    } else if (turns) {
        o.least = CW_EDGE_GAP * drift;
        o.most = c->quantum;
    }
    return (cw_offsets){.least = o.least - skew, .most = o.most + skew};
}

/* Returns the largest phase error so far in whole quanta of the present bit timing, without its
 * sign. */
static cw_span whole_quanta(const cw_sync_stats *s, cw_span quantum)
{
    const cw_span error = s->phase_error < 0 ? -s->phase_error : s->phase_error;
    return error - error % quantum;
}

/* Returns true when the acknowledgement has no margin less than those before, nor a phase error
 * that is more. The driver that comes first to a node ends its slot as it has planned, so that
 * the level cannot change back before. */
static bool slot_is_usual(const cw_bus *bus, const cw_clean_frame *f, const cw_clean_node *c,
                          cw_offsets usual)
{
    const cw_clean *clean = &bus->timed.clean;
    const bool drives = f->drivers >> c->node & 1u;
    const cw_span error = whole_quanta(&bus->timed.records[c->node].stats, c->quantum);
    const cw_span behind = cw_clean_behind(clean, f->slots, c), ack = c->slot[f->slots].ack;
    const cw_span comes = drives && c->own[CW_DOMINANT] < behind ? c->own[CW_DOMINANT] : behind;
    const cw_span end = cw_clean_end_of_slot(clean, f->slots, c), moved = end - c->bit - ack;
    const cw_span left = ack + behind + clean->least_bit - clean->most_skew;
    return error > 0 && behind >= -error && (drives || behind < error + c->quantum) &&
           comes >= usual.least && comes - moved <= usual.most && left - end >= usual.least &&
           f->released - end <= usual.most;
}

/* Returns true when a frame brings a node nothing but synchronisations like those before. */
static bool is_usual(const cw_bus *bus, const cw_clean_frame *f, const cw_clean_node *c)
{
    const cw_span margin = bus->timed.records[c->node].stats.margin;
    const cw_offsets usual = {.least = margin - (c->bit - c->to_sample),
                              .most = c->to_sample - margin};
    cw_offsets o = {.least = c->own[0] < c->own[1] ? c->own[0] : c->own[1],
                    .most = c->own[0] < c->own[1] ? c->own[1] : c->own[0]};
    if (!slot_is_usual(bus, f, c, usual))
        return false;
    if (c->node != f->sender)
        o = find_range(bus, f, c);
    return o.least >= usual.least && o.most <= usual.most;
}

/* All margins but that of an early acknowledgement are sure to be usual then. */
cw_span cw_clean_quiet(const cw_bus *bus, const cw_clean_node *c)
{
    const cw_clean *clean = &bus->timed.clean;
    if (!(clean->drivers >> c->node & 1u) || !are_counted(bus))
        return CW_SPAN_MAX;
    const cw_sync_stats *s = &bus->timed.records[c->node].stats;
    const cw_span reach = reach_of(clean), least = s->margin - (c->bit - c->to_sample);
    const cw_span most = 2 * (bus->timed.longest + clean->most_quantum + reach);
    const cw_span error = whole_quanta(s, c->quantum);
    if (error == 0 || reach >= c->quantum || least > -reach || s->margin > c->to_sample - most)
        return CW_SPAN_MAX;
    return least > -error ? least : -error;
}

/* ---- All nodes ------------------------------------------------------------------------------- */

/* Counts for a node whose margins have to be looked at. Not inlined, since mostly they need not. */
__attribute__((noinline)) static void pass_node(cw_bus *bus, cw_frame_count *count,
                                                cw_clean_node *c)
{
    const cw_clean *clean = &bus->timed.clean;
    const cw_clean_frame *f = count->frame;
    const bool away = clean->away >> c->node & 1u, sends = c->node == f->sender;
    c->unheard += away || sends;
    if (away || reach_of(clean) >= c->quantum || !is_usual(bus, f, c)) {
        cw_clean_count(bus, count, c);
        c->quiet = cw_clean_quiet(bus, c);
        return;
    }
    const cw_span behind = cw_clean_behind(clean, f->slots, c);
    c->resyncs += behind < 0 || (behind >= c->quantum && !(f->drivers >> c->node & 1u));
    const cw_span offset = sends ? 0 : cw_clean_offset_at_sof(bus, f, c);
    if (offset < 0 || offset >= c->quantum)
        c->resyncs += turns_by(offset, c->quantum);
}

/* Counts for receivers in a row. key: of the edge of SOF. up: the receivers are above the sender.
 * along: edges have to go along the line. */
static inline __attribute__((always_inline)) void
pass_row(cw_bus *bus, cw_frame_count *count, cw_clean_node *c, const cw_clean_node *behind_last,
         cw_span key, bool up, bool along)
{
    const size_t slots = count->frame->slots;
    const cw_span seen = bus->timed.clean.slots[slots].seen, bits = count->frame->slot;
    for (; c < behind_last; c++) {
        const cw_span ack = c->slot[slots].ack;
        const cw_span behind = (along ? c->slot[slots].arrival : seen + c->from_below) - ack;
        if (behind < c->quiet) {
            pass_node(bus, count, c);
            continue;
        }
        const cw_span offset = key + (up ? c->from_below : c->from_above) + bits * c->bit - ack;
        c->resyncs += (uint64_t)behind >> 63; /* early */
        if ((uint64_t)offset >= (uint64_t)c->quantum)
            c->resyncs += turns_by(offset, c->quantum);
    }
}

void cw_clean_pass(cw_bus *bus, const cw_clean_frame *f)
{
    cw_clean *clean = &bus->timed.clean;
    cw_clean_node *sender = cw_clean_at(clean, f->sender);
    const cw_clean_node *behind_last = clean->nodes + bus->node_count;
    const cw_span key = f->begin + sender->out[CW_DOMINANT] - sender->place;
    cw_frame_count count;
    if (!are_counted(bus))
        return;
    count.frame = f;
    count.edges.found = count.release.found = false;
    bus->timed.counts = true;
    clean->heard++;
    if (clean->at_one_place) {
        pass_row(bus, &count, clean->nodes, sender, key, true, false);
        pass_row(bus, &count, sender + 1, behind_last, key, true, false);
    } else {
        pass_row(bus, &count, clean->nodes, sender, key + 2 * sender->place, false, true);
        pass_row(bus, &count, sender + 1, behind_last, key, true, true);
    }
    pass_node(bus, &count, sender);
}

/* ---- Records --------------------------------------------------------------------------------- */

void cw_clean_add_counts(const cw_bus *bus, unsigned i, cw_sync_stats *stats)
{
    const cw_clean *clean = &bus->timed.clean;
    if (!clean->parked || !are_counted(bus))
        return;
    stats->hard_syncs += clean->heard - cw_clean_at(clean, i)->unheard;
    stats->resyncs += cw_clean_at(clean, i)->resyncs;
}

void cw_clean_take_counts(cw_bus *bus)
{
    cw_clean *clean = &bus->timed.clean;
    for (unsigned i = 0; i < bus->node_count; i++) {
        cw_clean_node *c = cw_clean_at(clean, i);
        if (are_counted(bus))
            cw_clean_add_counts(bus, i, &bus->timed.records[i].stats);
        c->resyncs = c->unheard = 0;
    }
    clean->heard = 0;
}
