/* SPDX-License-Identifier: MIT
 *
 * quanta.h - controllers with clocks of their own, time quantum by time quantum.
 *
 * For tests only: slow and obvious, written from the rules of bit timing (T1 to T9, T12 and D10 to
 * D13 of RULES.md). Each node looks at the wire at the end of each of its quanta. It sees the
 * levels that all nodes have driven before that moment, each as late as its delays say.
 */
#ifndef CANWIRE_TEST_QUANTA_H
#define CANWIRE_TEST_QUANTA_H

#include "canwire.h"
#include "mac/mac.h"

#include <assert.h>
#include <stdbool.h>
#include <stdint.h>

#define QUANTA_NODES_MAX 8u
#define QUANTA_EDGES 256u /* of each node that are remembered */
#define QUANTA_FAULTS 8u
#define QUANTA_SPANS 16u  /* of each fault that are remembered */
#define QUANTA_NOBODY QUANTA_NODES_MAX

/* Times are in femtoseconds, or in any other unit of the test. */
#define FS_PER_NS INT64_C(1000000)

typedef struct quanta_timing {
    int64_t quantum;
    unsigned prop, seg1, seg2, sjw; /* in quanta; Sync_Seg has one (T1) */
    bool triple; /* T7 */
} quanta_timing;

#define QUANTA_LATE 64u /* bits of a transmitter that are remembered for later comparisons */

/* The data phase of a node that knows FD frames. */
typedef struct quanta_data {
    quanta_timing timing;
    int64_t clock;      /* of which delays are made */
    cw_tdc tdc;
    int64_t res_at;     /* begin of the own res bit; -1: the delay is known */
    int64_t delay;
    int64_t begun_at[QUANTA_LATE]; /* own bits of the data phase that are not compared yet */
    bool sent[QUANTA_LATE];
    cw_error_type error[QUANTA_LATE]; /* if it differs: form for fixed stuff bits (D14) */
    unsigned count;
} quanta_data;

typedef struct quanta_node {
    cw_mac mac;
    cw_fd_part fd;
    bool knows_fd;
    bool fast;          /* the bit goes by data.timing (D10) */
    quanta_data data;
    quanta_timing nominal;
    quanta_timing timing; /* the present one */
    int64_t now;        /* end of the quantum that has just passed */
    unsigned count;     /* quanta of this bit that have passed */
    unsigned sample_at; /* ... at the sample point, as synchronisation has moved it */
    unsigned end_at;    /* ... at the end of the bit */
    bool sampled;       /* this bit has been */
    bool last_sample;
    bool before;        /* level seen at the end of the quantum before ... */
    bool first;         /* ... and of the one before that */
    bool synchronised;  /* since the last sample point */
    bool driven;
    bool scripted; /* no controller: the test writes its edges */
    int64_t edge_at[QUANTA_EDGES]; /* ring of own edges; odd ones are dominant */
    int64_t edge_delay[QUANTA_EDGES][QUANTA_NODES_MAX]; /* to each node's look, when not scripted */
    unsigned edges;
    int64_t ringing; /* of the wire at the node, after edges to recessive ... */
    int64_t ringing_since; /* ... that come after this moment */
    unsigned frames;    /* that the test wants to be sent */
    unsigned received, sent, errors;
    cw_error first_error;
    cw_mac_report report; /* of the last sample */
    cw_sync_stats sync;   /* its margin is in the unit of the test; 0: none yet */
    int64_t sampled_at;
    bool measures;        /* edges after the last sample have a margin */
} quanta_node;

/* A fault changes levels from one moment to another. */
typedef struct quanta_span {
    int64_t begin, end;
    int64_t delay[QUANTA_NODES_MAX]; /* until it comes to a node; it keeps its length */
} quanta_span;

typedef struct quanta_fault {
    unsigned lines, wires, samples; /* of these nodes, as bits */
    bool inverts;
    bool level; /* if it does not invert */
    unsigned count;
    quanta_span spans[QUANTA_SPANS];
} quanta_fault;

typedef struct quanta quanta;

struct quanta {
    quanta_node nodes[QUANTA_NODES_MAX];
    unsigned node_count;
    int64_t delay[QUANTA_NODES_MAX][QUANTA_NODES_MAX][2]; /* from a node's edge to that level, to
                                                             another's look */
    unsigned fault_count;
    quanta_fault faults[QUANTA_FAULTS]; /* the later ones change what the earlier ones have left */
    bool (*next_frame)(cw_frame *frame, unsigned node, unsigned number);
    /* Returns how late an edge comes that a node drives now, if not NULL. */
    int64_t (*jitter)(const quanta *q, unsigned node);
    /* Called when a node has begun a bit, and drives it, if not NULL. */
    void (*bit_begun)(quanta *q, unsigned node);
    /* Called at the end of each bit with the report of its sample, if not NULL. */
    void (*bit_ended)(const struct quanta *q, unsigned node);
};

static inline unsigned quanta_bit(const quanta_timing *t)
{
    return 1 + t->prop + t->seg1 + t->seg2;
}

static inline void quanta_add(quanta *q, const quanta_timing *timing, int64_t phase)
{
    quanta_node *n = &q->nodes[q->node_count++];
    *n = (quanta_node){.timing = *timing, .now = phase,
                       .nominal = *timing, .before = CW_RECESSIVE, .first = CW_RECESSIVE,
                       .last_sample = CW_RECESSIVE, .driven = CW_RECESSIVE,
                       .ringing_since = INT64_MIN / 2,
                       .sample_at = 1 + timing->prop + timing->seg1, .end_at = quanta_bit(timing)};
    cw_mac_init(&n->mac, 0, 96);
    (void)cw_mac_drive(&n->mac);
}

/* Lets the last node know FD frames, with that data phase. */
static inline void quanta_add_data(quanta *q, unsigned protocol, const quanta_timing *timing,
                                   int64_t clock, const cw_tdc *tdc)
{
    quanta_node *n = &q->nodes[q->node_count - 1];
    n->knows_fd = true;
    n->data = (quanta_data){.timing = *timing, .clock = clock, .tdc = *tdc, .res_at = -1};
    (void)cw_mac_set_protocol(&n->mac, protocol, &n->fd);
    n->fd.compares_late = tdc->mode != CW_TDC_OFF;
    (void)cw_mac_drive(&n->mac);
}

/* Returns the moment at which the k-th edge of a node arrives at another one, or at itself. */
static inline int64_t quanta_arrival(const quanta *q, unsigned from, unsigned to, unsigned k)
{
    const quanta_node *n = &q->nodes[from];
    const unsigned place = k % QUANTA_EDGES;
    return n->edge_at[place] +
           (n->scripted ? q->delay[from][to][k % 2 ? 1 : 0] : n->edge_delay[place][to]);
}

/* Returns the level of a node that another one sees at a moment: that of the last edge that has
 * come there before. */
static inline bool quanta_level_before(const quanta *q, unsigned from, unsigned to, int64_t moment)
{
    unsigned k = q->nodes[from].edges;
    while (k > 0 && quanta_arrival(q, from, to, k - 1) >= moment) {
        k--;
        assert(q->nodes[from].edges - k < QUANTA_EDGES);
    }
    return k % 2 ? CW_DOMINANT : CW_RECESSIVE;
}

/* Lets a fault act on levels that come from a node as its edges do, or on all at once. It comes as
 * late as edges to its level; one that inverts as late as those to recessive. */
static inline quanta_span *quanta_disturb(const quanta *q, quanta_fault *f, unsigned source,
                                          int64_t begin, int64_t end)
{
    quanta_span *span = &f->spans[f->count++ % QUANTA_SPANS];
    span->begin = begin;
    span->end = end;
    for (unsigned to = 0; to < q->node_count; to++)
        span->delay[to] =
            source == QUANTA_NOBODY ? 0 : q->delay[source][to][f->inverts || f->level];
    return span;
}

/* Returns what a fault makes of a level that a node sees. */
static inline bool quanta_faulty(const quanta_fault *f, unsigned self, int64_t moment, bool level)
{
    const unsigned kept = f->count < QUANTA_SPANS ? f->count : QUANTA_SPANS;
    for (unsigned k = 0; k < kept; k++) {
        const int64_t there = moment - f->spans[k].delay[self];
        if (f->spans[k].begin < there && there <= f->spans[k].end)
            level = f->inverts ? !level : f->level;
    }
    return level;
}

/* Returns the level of a node's wire: the AND of what all drive, with what faults do to it. */
static inline bool quanta_calm_wire(const quanta *q, unsigned self, int64_t moment)
{
    bool wire = CW_RECESSIVE;
    for (unsigned i = 0; i < q->node_count; i++) {
        bool level = quanta_level_before(q, i, self, moment);
        for (unsigned f = 0; f < q->fault_count; f++)
            if (q->faults[f].lines >> i & 1u)
                level = quanta_faulty(&q->faults[f], self, moment, level);
        wire = wire && level;
    }
    for (unsigned f = 0; f < q->fault_count; f++)
        if (q->faults[f].wires >> self & 1u)
            wire = quanta_faulty(&q->faults[f], self, moment, wire);
    return wire;
}

/* In the second half of the time that it rings, a recessive wire is dominant once more. */
static inline bool quanta_level_at(const quanta *q, unsigned self, int64_t moment)
{
    const int64_t ringing = q->nodes[self].ringing;
    bool level = quanta_calm_wire(q, self, moment);
    if (level == CW_RECESSIVE && moment - ringing > q->nodes[self].ringing_since)
        level = quanta_calm_wire(q, self, moment - ringing / 2) == CW_DOMINANT ||
                quanta_calm_wire(q, self, moment - ringing) == CW_RECESSIVE;
    for (unsigned f = 0; f < q->fault_count; f++)
        if (q->faults[f].samples >> self & 1u)
            level = quanta_faulty(&q->faults[f], self, moment, level);
    return level;
}

/* A level is seen by what looks after it, not at it (T12). */
static inline bool quanta_look(const quanta *q, unsigned self)
{
    return quanta_level_at(q, self, q->nodes[self].now);
}

/* T4: idle, suspend, bits 2 and 3 of the intermission, integration, bus-off. */
static inline bool quanta_synchronises_hard(const quanta_node *n)
{
    const cw_mac_phase phase = cw_mac_get_phase(&n->mac);
    const bool rests = phase == CW_MAC_IDLE || phase == CW_MAC_SUSPEND;
    const bool late = phase == CW_MAC_INTERMISSION && n->mac.count > 0;
    const bool off = phase == CW_MAC_BUS_OFF || phase == CW_MAC_RECOVERING;
    const cw_place place = cw_mac_place(&n->mac);
    const bool res = phase == CW_MAC_FRAME && place.field == CW_FIELD_RES && !place.stuff &&
                     cw_mac_role(&n->mac) == CW_ROLE_RECEIVER; /* D12 */
    return rests || late || off || res || phase == CW_MAC_INTEGRATING;
}

/* An edge keeps the delays of the moment at which it is driven. */
static inline void quanta_put_edge(quanta *q, unsigned i, bool level)
{
    quanta_node *n = &q->nodes[i];
    const unsigned place = n->edges++ % QUANTA_EDGES;
    const int64_t late = q->jitter ? q->jitter(q, i) : 0;
    n->edge_at[place] = n->now;
    for (unsigned to = 0; to < q->node_count; to++)
        n->edge_delay[place][to] = q->delay[i][to][level] + late;
}

/* Remembers when the transmitter began res, and bits that it compares later (D13). */
static inline void quanta_remember(quanta_node *n)
{
    const cw_place place = cw_mac_place(&n->mac);
    quanta_data *d = &n->data;
    if (!n->knows_fd || d->tdc.mode == CW_TDC_OFF || !cw_mac_is_sending(&n->mac))
        return;
    if (place.field == CW_FIELD_SOF)
        d->res_at = -1;
    if (place.field == CW_FIELD_RES && (n->fd.offer.flags & CW_FRAME_BRS)) {
        d->res_at = d->tdc.mode == CW_TDC_AUTO ? n->now : -1;
        d->delay = d->tdc.mode == CW_TDC_AUTO ? d->delay : d->tdc.tdcv * d->clock;
    }
    if (!n->fast)
        d->count = 0;
    if (!n->fast || place.field == CW_FIELD_CRC_DELIMITER)
        return;
    assert(d->count < QUANTA_LATE);
    d->begun_at[d->count] = n->now;
    d->error[d->count] = place.field == CW_FIELD_FIXED_STUFF ? CW_ERROR_FORM : CW_ERROR_BIT;
    d->sent[d->count++] = n->mac.driven;
}

static inline void quanta_drive(quanta *q, unsigned i)
{
    quanta_node *n = &q->nodes[i];
    cw_frame frame;
    if (cw_mac_can_start(&n->mac) && q->next_frame(&frame, i, n->sent))
        (void)cw_mac_offer(&n->mac, &frame);
    const bool level = cw_mac_drive(&n->mac);
    if (level != n->driven)
        quanta_put_edge(q, i, level);
    n->driven = level;
    quanta_remember(n);
    if (q->bit_begun)
        q->bit_begun(q, i);
}

/* Begins the next bit, of which some quanta have passed already. */
static inline void quanta_begin_bit(quanta *q, unsigned i, unsigned passed)
{
    quanta_node *n = &q->nodes[i];
    assert(n->sampled);
    if (q->bit_ended)
        q->bit_ended(q, i);
    n->count = passed;
    n->sample_at = 1 + n->timing.prop + n->timing.seg1;
    n->end_at = quanta_bit(&n->timing);
    n->sampled = false;
    quanta_drive(q, i);
}

/* Counts a synchronisation with a phase error in quanta. */
static inline void quanta_count_sync(quanta_node *n, int e)
{
    const int64_t error = e * n->timing.quantum, most = n->sync.phase_error;
    const bool hard = quanta_synchronises_hard(n);
    n->sync.hard_syncs += hard;
    n->sync.resyncs += !hard && e != 0;
    if (hard || (error < 0 ? -error : error) <= (most < 0 ? -most : most))
        return;
    n->sync.phase_error = error;
    n->sync.phase_error_tq = e;
}

/* An edge before the sample point: it belongs to this bit, and came in quantum e. */
static inline void quanta_synchronise_late(quanta_node *n, unsigned e)
{
    if (n->driven == CW_DOMINANT && e > 0) /* T6 */
        return;
    n->synchronised = true;
    quanta_count_sync(n, (int)e);
    cw_mac_note_edge(&n->mac);
    if (quanta_synchronises_hard(n)) {
        n->count = 1;
        return;
    }
    const unsigned longer = e < n->timing.sjw ? e : n->timing.sjw; /* T5 */
    n->sample_at += longer;
    n->end_at += longer;
}

/* An edge after the sample point, so many quanta before the end: it belongs to the next bit. */
static inline void quanta_synchronise_early(quanta *q, unsigned i, unsigned early)
{
    quanta_node *n = &q->nodes[i];
    n->synchronised = true;
    quanta_count_sync(n, -(int)early);
    cw_mac_note_edge(&n->mac);
    if (quanta_synchronises_hard(n) || early <= n->timing.sjw)
        quanta_begin_bit(q, i, 1);
    else
        n->end_at -= n->timing.sjw; /* T5 */
}

/* T3: recessive to dominant, once between sample points, after a recessive sample. */
static inline void quanta_watch_edge(quanta *q, unsigned i, bool level)
{
    quanta_node *n = &q->nodes[i];
    const bool edge = n->before == CW_RECESSIVE && level == CW_DOMINANT;
    const unsigned in = n->count - 1; /* the quantum that the edge came in */
    n->before = level;
    const bool sends_fast = n->fast && cw_mac_role(&n->mac) == CW_ROLE_TRANSMITTER; /* D12 */
    if (!edge || n->synchronised || n->last_sample == CW_DOMINANT || sends_fast)
        return;
    if (n->sampled)
        quanta_synchronise_early(q, i, n->end_at - in);
    else
        quanta_synchronise_late(n, in);
}

/* Looks for the own edge to res, clock by clock, up to now. */
static inline void quanta_measure_delay(const quanta *q, unsigned i)
{
    quanta_data *d = &((quanta *)(uintptr_t)q)->nodes[i].data;
    for (int64_t k = 0; d->res_at >= 0; k++) {
        const int64_t end = d->res_at + (k + 1) * d->clock;
        if (end > q->nodes[i].now)
            return;
        if (quanta_level_at(q, i, end) == CW_DOMINANT) {
            d->delay = k * d->clock;
            d->res_at = -1;
        }
    }
}

/* Compares the own bits whose secondary sample points have passed (D13). */
static inline void quanta_compare_late(quanta *q, unsigned i)
{
    quanta_node *n = &q->nodes[i];
    quanta_data *d = &n->data;
    if (!n->knows_fd || d->tdc.mode == CW_TDC_OFF || !cw_mac_is_sending(&n->mac))
        return;
    quanta_measure_delay(q, i);
    unsigned left = 0;
    for (unsigned k = 0; k < d->count; k++) {
        const int64_t after = d->delay + d->tdc.tdco * d->clock;
        const int64_t at = d->begun_at[k] + (after > 0 ? after : d->clock);
        if (n->fast && at <= n->now) {
            if (quanta_level_at(q, i, at) != d->sent[k])
                cw_mac_note_late_error(&n->mac, d->error[k]);
            continue;
        }
        d->begun_at[left] = d->begun_at[k];
        d->error[left] = d->error[k];
        d->sent[left++] = d->sent[k];
    }
    d->count = left;
}

/* Goes on with the bit as if it had been at the other rate since its begin (D10). */
static inline void quanta_change_rate(quanta_node *n)
{
    if (!n->knows_fd || n->fd.fast == n->fast)
        return;
    n->fast = n->fd.fast;
    n->timing = n->fast ? n->data.timing : n->nominal;
    n->count = 1 + n->timing.prop + n->timing.seg1;
    n->end_at = quanta_bit(&n->timing);
}

static inline void quanta_sample(quanta_node *n, bool level)
{
    cw_mac_report report;
    cw_mac_sample(&n->mac, level, &report);
    quanta_change_rate(n);
    n->report = report;
    n->sampled = true;
    n->synchronised = false;
    n->last_sample = level;
    n->received += (report.what & CW_REPORT_RX) != 0;
    n->sent += (report.what & CW_REPORT_TX) != 0;
    if (report.what & CW_REPORT_ERROR && n->errors++ == 0)
        n->first_error = report.error;
}

/* Returns when the level that a node sees became another one between two samples. That is the first
 * time to dominant, or the last time to recessive. -1: it did not. */
static inline int64_t quanta_change(const quanta *q, unsigned self, bool level, int64_t after,
                                    int64_t before)
{
    int64_t found = -1;
    for (unsigned i = 0; i < q->node_count; i++) {
        const quanta_node *n = &q->nodes[i];
        const unsigned oldest = n->edges > QUANTA_EDGES ? n->edges - QUANTA_EDGES : 0;
        for (unsigned k = oldest; k < n->edges; k++) {
            const int64_t at = quanta_arrival(q, i, self, k);
            if (at < after || at >= before || quanta_level_at(q, self, at) == level ||
                quanta_level_at(q, self, at + 1) != level)
                continue;
            if (found < 0 || (at < found) == (level == CW_DOMINANT))
                found = at;
        }
    }
    return found;
}

/* Measures how near to a sample point the level changed, where the levels of two samples differ. */
static inline void quanta_measure(quanta *q, unsigned i, bool level)
{
    quanta_node *n = &q->nodes[i];
    const int64_t change = n->measures && level != n->last_sample
                               ? quanta_change(q, i, level, n->sampled_at, n->now) : -1;
    const int64_t near = change - n->sampled_at < n->now - change ? change - n->sampled_at
                                                                  : n->now - change;
    if (change >= 0 && (n->sync.margin == 0 || near < n->sync.margin))
        n->sync.margin = near;
}

/* Ends a quantum: the edge first, then the sample, then the next bit. */
static inline void quanta_step_node(quanta *q, unsigned i)
{
    quanta_node *n = &q->nodes[i];
    n->now += n->timing.quantum;
    n->count++;
    const bool level = quanta_look(q, i);
    const bool majority = level + n->before + n->first >= 2;
    n->first = n->before;
    quanta_watch_edge(q, i, level);
    if (!n->sampled && n->count == n->sample_at) {
        const bool taken = n->timing.triple ? majority : level;
        quanta_measure(q, i, taken);
        quanta_compare_late(q, i);
        quanta_sample(n, taken);
        n->sampled_at = n->now;
        n->measures = !quanta_synchronises_hard(n);
    }
    if (n->sampled && n->count >= n->end_at)
        quanta_begin_bit(q, i, 0);
}

/* Adds a node without a controller. */
static inline quanta_node *quanta_add_script(quanta *q)
{
    quanta_node *n = &q->nodes[q->node_count++];
    *n = (quanta_node){.scripted = true};
    return n;
}

/* Puts a change of level into a script, later than all before. */
static inline void quanta_script(quanta_node *n, int64_t moment, bool level)
{
    const bool last = n->edges % 2 ? CW_DOMINANT : CW_RECESSIVE;
    assert(n->scripted && n->edges < QUANTA_EDGES);
    if (level != last)
        n->edge_at[n->edges++] = moment;
}

/* Returns the controller whose quantum ends first; node 0 has one. */
static inline unsigned quanta_first(const quanta *q)
{
    unsigned first = 0;
    for (unsigned i = 1; i < q->node_count; i++)
        if (!q->nodes[i].scripted && q->nodes[i].now + q->nodes[i].timing.quantum <
                                         q->nodes[first].now + q->nodes[first].timing.quantum)
            first = i;
    return first;
}

/* Returns the moment of the next step. */
static inline int64_t quanta_next(const quanta *q)
{
    const quanta_node *n = &q->nodes[quanta_first(q)];
    return n->now + n->timing.quantum;
}

/* Steps the controller whose quantum ends first. */
static inline void quanta_step(quanta *q)
{
    quanta_step_node(q, quanta_first(q));
}

#endif
