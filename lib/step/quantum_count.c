/* SPDX-License-Identifier: MIT
 *
 * quantum_count.c - counts the synchronisations and margins of clean frames (T3 to T5).
 *
 * The offset of an edge is the time from the start of a receiver's bit to it. It rises or falls from
 * bit to bit, by the difference of the clocks. An edge to dominant in another quantum than Sync_Seg
 * moves the bits of the node by these quanta: they turn. Between two turns offsets go evenly. So
 * of all edges the first and the last ones have the margins.
 */
#include "step/quantum.h"

#include "format/bits.h"

#define EDGE_WORDS 3u /* of the longest classical frame */
#define NO_KEY (INT64_MIN / 2) /* no edge comes so early */

/* The edges of a frame from SOF to the CRC delimiter, as sets of the bits that begin with them. */
typedef struct frame_edges {
    uint64_t to[2][EDGE_WORDS]; /* by their level */
} frame_edges;

/* The offsets of edges of each level to a receiver. */
typedef struct offsets {
    cw_span least;
    cw_span most;
} offsets;

/* The last recessive edge behind ACK slots, for each end of the line: when it would come to place 0
 * if it went on so far. Then its node, and the last edge of others. */
typedef struct last_release {
    cw_span key[2];
    cw_span other[2];
    unsigned node[2];
} last_release;

/* ---- Edges of the frame ---------------------------------------------------------------------- */

/* Returns the edges of a frame, without the one of SOF, at which receivers synchronise hard. */
static frame_edges find_edges(const cw_frame *frame)
{
    cw_bits bits;
    frame_edges e;
    uint64_t before = 1; /* SOF follows on recessive */
    (void)cw_bits_encode(&bits, frame);
    for (unsigned w = 0; w < EDGE_WORDS; w++) {
        const uint64_t level = bits.level[w], shifted = level << 1 | before;
        e.to[CW_DOMINANT][w] = ~level & shifted;
        e.to[CW_RECESSIVE][w] = level & ~shifted;
        before = level >> 63;
    }
    e.to[CW_DOMINANT][0] &= ~UINT64_C(1);
    for (unsigned n = bits.length; n < EDGE_WORDS * 64; n++)
        e.to[CW_DOMINANT][n / 64] &= ~(UINT64_C(1) << n % 64);
    return e;
}

/* Returns the first edge from a bit on. There must be one. */
static unsigned next_edge(const uint64_t set[EDGE_WORDS], unsigned n)
{
    unsigned w = n / 64;
    uint64_t word = set[w] & UINT64_MAX << n % 64;
    while (word == 0)
        word = set[++w];
    return 64 * w + (unsigned)__builtin_ctzll(word);
}

/* Returns the last edge up to a bit; 0: there is none. */
static unsigned last_edge(const uint64_t set[EDGE_WORDS], unsigned n)
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

static void widen(offsets *o, cw_span offset)
{
    o->least = offset < o->least ? offset : o->least;
    o->most = offset > o->most ? offset : o->most;
}

/* Returns the first edge at which a receiver turns that has turned before; 0: there is none. */
static unsigned next_turn(const frame_edges *e, const cw_clean_node *c, cw_span drift,
                          cw_span turns, unsigned from, unsigned last)
{
    const cw_span here = c->phase - turns * c->quantum; /* offset at SOF by the present turns */
    cw_span bit;
    if (drift == 0)
        return 0;
    if (drift > 0)
        bit = (c->quantum - here + drift - 1) / drift;
    else
        bit = here / -drift + 1;
    if (bit > last)
        return 0;
    return next_edge(e->to[CW_DOMINANT], bit > from ? (unsigned)bit : from + 1);
}

/* Takes the first and the last one of the edges to a level, behind a bit and up to another one. */
static void take_edges(offsets *o, const uint64_t set[EDGE_WORDS], cw_span at_sof, cw_span drift,
                       unsigned from, unsigned to)
{
    const unsigned last = last_edge(set, to);
    if (last <= from)
        return;
    widen(o, at_sof + drift * (cw_span)next_edge(set, from + 1));
    widen(o, at_sof + drift * (cw_span)last);
}

/* Counts the turns of a receiver in a frame, and finds the offsets of all edges. */
static offsets follow_frame(const cw_clean_frame *f, const frame_edges *e, const cw_clean_node *c,
                            cw_span drift, cw_span skew, cw_sync_stats *s)
{
    offsets o = {.least = CW_SPAN_MAX, .most = INT64_MIN};
    cw_span turns = 0;
    for (unsigned from = 0;;) {
        const cw_span at_sof = c->phase - turns * c->quantum;
        const unsigned turn = next_turn(e, c, drift, turns, from, f->edge);
        const unsigned to = turn ? turn - 1 : f->slot;
        take_edges(&o, e->to[CW_DOMINANT], at_sof, drift, from, to);
        take_edges(&o, e->to[CW_RECESSIVE], at_sof + skew, drift, from, to);
        if (!turn)
            return o;
        const cw_span before = at_sof + drift * (cw_span)turn, by = floor_of(before, c->quantum);
        count_turn(s, by, c->quantum);
        o.least = before < o.least ? before : o.least;
        o.most = before - by * c->quantum > o.most ? before - by * c->quantum : o.most;
        turns += by;
        from = turn;
    }
}

/* ---- The acknowledgement --------------------------------------------------------------------- */

/* Takes an edge for the last one that goes to an end of the line, if it is. */
static void take_release(last_release *r, unsigned end, cw_span key, unsigned node)
{
    if (key > r->key[end]) {
        r->other[end] = r->key[end];
        r->key[end] = key;
        r->node[end] = node;
    } else if (key > r->other[end]) {
        r->other[end] = key;
    }
}

/* Finds the last edges behind the ACK slots of all nodes that acknowledge. */
static last_release find_release(const cw_bus *bus, unsigned sender)
{
    const cw_clean *clean = &bus->timed.clean;
    last_release r = {.key = {NO_KEY, NO_KEY}, .other = {NO_KEY, NO_KEY}};
    for (unsigned i = 0; i < bus->node_count; i++) {
        const cw_clean_node *c = &clean->nodes[i];
        if (!c->acknowledges || i == sender)
            continue;
        const cw_span key = c->delimiter[!clean->last] + c->out[CW_RECESSIVE];
        take_release(&r, 0, key - c->place, i);
        take_release(&r, 1, key + c->place, i);
    }
    return r;
}

/* Returns the arrival of the last recessive edge behind the ACK slot at a node. */
static cw_span release_at(const last_release *r, const cw_clean_node *c, unsigned i, bool drives,
                          cw_span end)
{
    const cw_span up = (r->node[0] == i ? r->other[0] : r->key[0]) + c->place;
    const cw_span down = (r->node[1] == i ? r->other[1] : r->key[1]) - c->place;
    const cw_span others = (up > down ? up : down) + c->in[CW_RECESSIVE];
    const cw_span own = drives ? end + c->own[CW_RECESSIVE] : INT64_MIN;
    return own > others ? own : others;
}

/* Counts what the acknowledgement brings to a node. */
static void count_acknowledgement(const cw_clean_node *c, bool drives, cw_span end,
                                  cw_span released, cw_sync_stats *s)
{
    const cw_span turn = floor_of(c->arrival - c->ack, c->quantum);
    const cw_span own = drives ? c->ack + c->own[CW_DOMINANT] : CW_SPAN_MAX;
    const cw_span comes = own < c->arrival ? own : c->arrival;
    const cw_span sample = end - c->bit + c->to_sample;
    if (turn < 0 || (turn > 0 && !drives))
        count_turn(s, turn, c->quantum);
    quantum_count_margin(s, comes - (c->ack - c->bit + c->to_sample));
    quantum_count_margin(s, sample - comes);
    quantum_count_margin(s, released - sample);
    quantum_count_margin(s, end + c->to_sample - released);
}

/* ---- All nodes ------------------------------------------------------------------------------- */

/* Counts the margins of a sender, which sees its own edges. */
static void count_sent(const cw_clean_node *c, cw_sync_stats *s)
{
    for (unsigned level = 0; level < 2; level++) {
        quantum_count_margin(s, c->bit - c->to_sample + c->own[level]);
        quantum_count_margin(s, c->to_sample - c->own[level]);
    }
}

/* Counts what a frame brings to a receiver, up to the ACK slot. */
static void count_received(const cw_clean_frame *f, const frame_edges *e, const cw_clean_node *c,
                           const cw_clean_node *sender, cw_sync_stats *s)
{
    const cw_span skew = sender->out[CW_RECESSIVE] + c->in[CW_RECESSIVE] -
                         sender->out[CW_DOMINANT] - c->in[CW_DOMINANT];
    const offsets o = follow_frame(f, e, c, sender->bit - c->bit, skew, s);
    s->hard_syncs++;
    quantum_count_margin(s, c->bit - c->to_sample + o.least);
    quantum_count_margin(s, c->to_sample - o.most);
}

/* Nodes in bus-off synchronise hard at each edge. */
static void count_away(const cw_bus *bus, const frame_edges *e, unsigned i)
{
    if (bus->nodes[i].mac.phase != CW_MAC_BUS_OFF)
        return;
    unsigned count = 2; /* SOF and the acknowledgement */
    for (unsigned w = 0; w < EDGE_WORDS; w++)
        count += cw_count_bits(e->to[CW_DOMINANT][w]);
    bus->timed.records[i].stats.hard_syncs += count;
}

void cw_clean_count_syncs(cw_bus *bus, const cw_clean_frame *f)
{
    const cw_clean *clean = &bus->timed.clean;
    const frame_edges edges = find_edges(f->frame);
    const last_release release = find_release(bus, f->sender);
    for (unsigned i = 0; i < bus->node_count; i++) {
        const cw_clean_node *c = &clean->nodes[i];
        cw_sync_stats *s = &bus->timed.records[i].stats;
        const cw_span end = c->delimiter[!clean->last];
        const bool drives = c->acknowledges && i != f->sender;
        if (clean->away >> i & 1u) {
            count_away(bus, &edges, i);
            continue;
        }
        if (i == f->sender)
            count_sent(c, s);
        else
            count_received(f, &edges, c, &clean->nodes[f->sender], s);
        count_acknowledgement(c, drives, end, release_at(&release, c, i, drives, end), s);
    }
}
