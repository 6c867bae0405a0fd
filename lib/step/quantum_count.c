/* SPDX-License-Identifier: MIT
 *
 * quantum_count.c - counts the synchronisations and margins of clean frames (T3 to T5).
 *
 * The offset of an edge is the time from the start of a receiver's bit to it. It rises or falls
 * from bit to bit, by the difference of the clocks. An edge to dominant in another quantum than
 * Sync_Seg moves the bits of the node by these quanta: they turn. Between two turns offsets go
 * evenly. So of all edges the first and the last ones have the margins.
 */
#include "step/quantum_clean.h"

#include "format/bits.h"

/* ---- Edges of the frame ---------------------------------------------------------------------- */

/* Finds the edges, without the one of SOF, at which receivers synchronise hard. */
static void find_edges(cw_frame_edges *e, const cw_frame *frame)
{
    cw_bits bits;
    uint64_t before = 1; /* SOF follows on recessive */
    (void)cw_bits_encode(&bits, frame);
    for (unsigned w = 0; w < CW_EDGE_WORDS; w++) {
        const uint64_t level = bits.level[w], shifted = level << 1 | before;
        e->to[CW_DOMINANT][w] = ~level & shifted;
        e->to[CW_RECESSIVE][w] = level & ~shifted;
        before = level >> 63;
    }
    e->to[CW_DOMINANT][0] &= ~UINT64_C(1);
    for (unsigned n = bits.length; n < CW_EDGE_WORDS * 64; n++)
        e->to[CW_DOMINANT][n / 64] &= ~(UINT64_C(1) << n % 64);
    e->found = true;
}

/* Returns the first edge from a bit on. There must be one. */
static unsigned next_edge(const uint64_t set[CW_EDGE_WORDS], unsigned n)
{
    unsigned w = n / 64;
    uint64_t word = set[w] & UINT64_MAX << n % 64;
    while (word == 0)
        word = set[++w];
    return 64 * w + (unsigned)__builtin_ctzll(word);
}

/* Returns the last edge up to a bit; 0: there is none. */
static unsigned last_edge(const uint64_t set[CW_EDGE_WORDS], unsigned n)
{
    unsigned w = n / 64;
    uint64_t word = set[w] & UINT64_MAX >> (63 - n % 64);
    while (word == 0 && w > 0)
        word = set[--w];
    return word ? 64 * w + 63 - (unsigned)__builtin_clzll(word) : 0;
}

/* ---- Synchronisations and margins ------------------------------------------------------------ */

static cw_span floor_of(cw_span span, cw_span unit)
{
    return span < 0 ? -((unit - 1 - span) / unit) : span / unit;
}

/* Counts a resynchronisation. */
static void count_turn(cw_sync_stats *s, cw_span turn, cw_span quantum)
{
    const cw_span error = turn * quantum;
    const cw_span size = error < 0 ? -error : error;
    s->resyncs++;
    if (size <= (s->phase_error < 0 ? -s->phase_error : s->phase_error))
        return;
    s->phase_error_tq = (int32_t)turn;
    s->phase_error = error;
}

static void quantum_count_margin(cw_sync_stats *s, cw_span margin)
{
    if (margin < s->margin)
        s->margin = margin;
}

static void widen(cw_offsets *o, cw_span offset)
{
    o->least = offset < o->least ? offset : o->least;
    o->most = offset > o->most ? offset : o->most;
}

/* Returns the first edge at which a receiver turns; 0: there is none. at_sof: the offset of SOF by
 * the turns up to now. */
static unsigned next_turn(const cw_frame_edges *e, cw_span at_sof, cw_span drift, cw_span quantum,
                          unsigned from, unsigned last)
{
    cw_span bit;
    if (drift == 0)
        return 0;
    if (drift > 0)
        bit = (quantum - at_sof + drift - 1) / drift;
    else
        bit = at_sof / -drift + 1;
    if (bit > last)
        return 0;
    return next_edge(e->to[CW_DOMINANT], bit > from ? (unsigned)bit : from + 1);
}

/* Takes the first and the last one of the edges to a level, behind a bit and up to another one. */
static void take_edges(cw_offsets *o, const uint64_t set[CW_EDGE_WORDS], cw_span at_sof,
                       cw_span drift, unsigned from, unsigned to)
{
    const unsigned last = last_edge(set, to);
    if (last <= from)
        return;
    widen(o, at_sof + drift * (cw_span)next_edge(set, from + 1));
    widen(o, at_sof + drift * (cw_span)last);
}

/* Counts the turns of a receiver in a frame, and finds the offsets of all edges. */
static cw_offsets follow_frame(const cw_clean_frame *f, const cw_frame_edges *e,
                               const cw_clean_node *c, cw_span phase, cw_span skew,
                               cw_sync_stats *s)
{
    const cw_span drift = f->bit - c->bit;
    cw_offsets o = {.least = CW_SPAN_MAX, .most = INT64_MIN};
    cw_span at_sof = phase;
    for (unsigned from = 0;;) {
        const unsigned turn = next_turn(e, at_sof, drift, c->quantum, from, f->edge);
        const unsigned to = turn ? turn - 1 : f->slot;
        take_edges(&o, e->to[CW_DOMINANT], at_sof, drift, from, to);
        take_edges(&o, e->to[CW_RECESSIVE], at_sof + skew, drift, from, to);
        if (!turn)
            return o;
        const cw_span before = at_sof + drift * (cw_span)turn, by = floor_of(before, c->quantum);
        count_turn(s, by, c->quantum);
        o.least = before < o.least ? before : o.least;
        o.most = before - by * c->quantum > o.most ? before - by * c->quantum : o.most;
        at_sof -= by * c->quantum;
        from = turn;
    }
}

/* ---- The acknowledgement --------------------------------------------------------------------- */

/* Counts what the acknowledgement brings to a node. Moments count from the planned start of its
 * slot. */
static void count_acknowledgement(const cw_clean *clean, const cw_frame_count *count,
                                  const cw_clean_node *c, cw_sync_stats *s)
{
    const unsigned slots = count->frame->slots;
    const bool drives = count->frame->drivers >> c->node & 1u;
    const cw_span ack = c->slot[slots].ack, end = cw_clean_end_of_slot(clean, slots, c);
    const cw_span behind = cw_clean_behind(clean, slots, c);
    const cw_span turn = floor_of(behind, c->quantum);
    const cw_span comes = drives && c->own[CW_DOMINANT] < behind ? c->own[CW_DOMINANT] : behind;
    const cw_span sample = end - ack - c->bit + c->to_sample;
    const cw_span released = cw_clean_released_at(clean, &count->release, slots, c) - ack;
    if (turn < 0 || (turn > 0 && !drives))
        count_turn(s, turn, c->quantum);
    quantum_count_margin(s, comes + c->bit - c->to_sample);
    quantum_count_margin(s, sample - comes);
    quantum_count_margin(s, released - sample);
    quantum_count_margin(s, sample + c->bit - released);
}

/* ---- One node -------------------------------------------------------------------------------- */

/* Counts the margins of a sender, which sees its own edges. */
static void count_sent(const cw_clean_node *c, cw_sync_stats *s)
{
    for (unsigned level = 0; level < 2; level++) {
        quantum_count_margin(s, c->bit - c->to_sample + c->own[level]);
        quantum_count_margin(s, c->to_sample - c->own[level]);
    }
}

cw_span cw_clean_offset_at_sof(const cw_bus *bus, const cw_clean_frame *f, const cw_clean_node *c)
{
    const cw_span delay = cw_cable_delay(&bus->timed.cable, f->sender, c->node, CW_DOMINANT);
    return f->begin + delay + f->slot * c->bit - c->slot[f->slots].ack;
}

/* Counts what a frame brings to a receiver, up to the ACK slot. */
static void count_received(const cw_bus *bus, const cw_frame_count *count, const cw_clean_node *c,
                           cw_sync_stats *s)
{
    const cw_clean_frame *f = count->frame;
    const cw_cable *cable = &bus->timed.cable;
    const cw_span skew = cw_cable_delay(cable, f->sender, c->node, CW_RECESSIVE) -
                         cw_cable_delay(cable, f->sender, c->node, CW_DOMINANT);
    const cw_span offset = cw_clean_offset_at_sof(bus, f, c);
    const cw_span phase = offset - floor_of(offset, c->quantum) * c->quantum;
    const cw_offsets o = follow_frame(f, &count->edges, c, phase, skew, s);
    quantum_count_margin(s, c->bit - c->to_sample + o.least);
    quantum_count_margin(s, c->to_sample - o.most);
}

/* Nodes in bus-off synchronise hard at each edge: at SOF, in the frame, and at the
 * acknowledgement. */
static void count_away(const cw_frame_edges *e, cw_sync_stats *s)
{
    s->hard_syncs += 2;
    for (unsigned w = 0; w < CW_EDGE_WORDS; w++)
        s->hard_syncs += cw_count_bits(e->to[CW_DOMINANT][w]);
}

void cw_clean_count(const cw_bus *bus, cw_frame_count *count, const cw_clean_node *c)
{
    const cw_clean *clean = &bus->timed.clean;
    const cw_clean_frame *f = count->frame;
    const bool sends = c->node == f->sender;
    cw_sync_stats *s = &bus->timed.records[c->node].stats;
    if (!count->edges.found && !sends)
        find_edges(&count->edges, f->frame);
    if (clean->away >> c->node & 1u) {
        if (bus->nodes[c->node].mac.phase == CW_MAC_BUS_OFF)
            count_away(&count->edges, s);
        return;
    }
    if (!count->release.found)
        cw_clean_find_release(&count->release, clean, f);
    if (sends)
        count_sent(c, s);
    else
        count_received(bus, count, c, s);
    count_acknowledgement(clean, count, c, s);
}
