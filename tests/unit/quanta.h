/* SPDX-License-Identifier: MIT
 *
 * quanta.h - controllers with clocks of their own, time quantum by time quantum.
 *
 * For tests only: slow and obvious, written from the rules of bit timing (T1 to T9 and T12 of
 * RULES.md). Each node looks at the wire at the end of each of its quanta. It sees the levels that
 * all nodes have driven before that moment, each as late as its delays say.
 */
#ifndef CANWIRE_TEST_QUANTA_H
#define CANWIRE_TEST_QUANTA_H

#include "canwire.h"

#include <assert.h>
#include <stdbool.h>
#include <stdint.h>

#define QUANTA_NODES_MAX 8u
#define QUANTA_EDGES 256u /* of each node that are remembered */

/* Times are in femtoseconds, or in any other unit of the test. */
#define FS_PER_NS INT64_C(1000000)

typedef struct quanta_timing {
    int64_t quantum;
    unsigned prop, seg1, seg2, sjw; /* in quanta; Sync_Seg has one (T1) */
    bool triple; /* T7 */
} quanta_timing;

typedef struct quanta_node {
    cw_mac mac;
    quanta_timing timing;
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
    unsigned edges;
    unsigned frames;    /* that the test wants to be sent */
    unsigned received, sent, errors;
    cw_error first_error;
    cw_mac_report report; /* of the last sample */
    cw_sync_stats sync;   /* its margin is in the unit of the test; 0: none yet */
    int64_t sampled_at;
    bool measures;        /* edges after the last sample have a margin */
} quanta_node;

typedef struct quanta quanta;

struct quanta {
    quanta_node nodes[QUANTA_NODES_MAX];
    unsigned node_count;
    int64_t delay[QUANTA_NODES_MAX][QUANTA_NODES_MAX][2]; /* from a node's edge to that level, to
                                                             another's look */
    bool (*next_frame)(cw_frame *frame, unsigned node, unsigned number);
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
                       .before = CW_RECESSIVE, .first = CW_RECESSIVE,
                       .last_sample = CW_RECESSIVE, .driven = CW_RECESSIVE,
                       .sample_at = 1 + timing->prop + timing->seg1, .end_at = quanta_bit(timing)};
    cw_mac_init(&n->mac, 0, 96);
    (void)cw_mac_drive(&n->mac);
}

/* Returns the level of a node that another one sees at a moment: that of the last edge that has
 * come there before. */
static inline bool quanta_level_before(const quanta_node *n, const int64_t delay[2],
                                       int64_t moment)
{
    unsigned k = n->edges;
    while (k > 0 && n->edge_at[(k - 1) % QUANTA_EDGES] + delay[k % 2 ? 0 : 1] >= moment) {
        k--;
        assert(n->edges - k < QUANTA_EDGES);
    }
    return k % 2 ? CW_DOMINANT : CW_RECESSIVE;
}

/* A level is seen by what looks after it, not at it (T12). */
static inline bool quanta_look(const quanta *q, unsigned self)
{
    bool level = CW_RECESSIVE;
    for (unsigned i = 0; i < q->node_count; i++)
        level = level &&
                quanta_level_before(&q->nodes[i], q->delay[i][self], q->nodes[self].now);
    return level;
}

/* T4: idle, suspend, bits 2 and 3 of the intermission, integration, bus-off. */
static inline bool quanta_synchronises_hard(const quanta_node *n)
{
    const cw_mac_phase phase = cw_mac_get_phase(&n->mac);
    const bool rests = phase == CW_MAC_IDLE || phase == CW_MAC_SUSPEND;
    const bool late = phase == CW_MAC_INTERMISSION && n->mac.count > 0;
    const bool off = phase == CW_MAC_BUS_OFF || phase == CW_MAC_RECOVERING;
    return rests || late || off || phase == CW_MAC_INTEGRATING;
}

static inline void quanta_drive(quanta *q, unsigned i)
{
    quanta_node *n = &q->nodes[i];
    cw_frame frame;
    if (cw_mac_can_start(&n->mac) && q->next_frame(&frame, i, n->sent))
        (void)cw_mac_offer(&n->mac, &frame);
    const bool level = cw_mac_drive(&n->mac);
    if (level != n->driven)
        n->edge_at[n->edges++ % QUANTA_EDGES] = n->now;
    n->driven = level;
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
    if (!edge || n->synchronised || n->last_sample == CW_DOMINANT)
        return;
    if (n->sampled)
        quanta_synchronise_early(q, i, n->end_at - in);
    else
        quanta_synchronise_late(n, in);
}

static inline void quanta_sample(quanta_node *n, bool level)
{
    cw_mac_report report;
    cw_mac_sample(&n->mac, level, &report);
    n->report = report;
    n->sampled = true;
    n->synchronised = false;
    n->last_sample = level;
    n->received += (report.what & CW_REPORT_RX) != 0;
    n->sent += (report.what & CW_REPORT_TX) != 0;
    if (report.what & CW_REPORT_ERROR && n->errors++ == 0)
        n->first_error = report.error;
}

static inline bool quanta_level_at(const quanta *q, unsigned self, int64_t moment)
{
    bool level = CW_RECESSIVE;
    for (unsigned i = 0; i < q->node_count; i++)
        level = level && quanta_level_before(&q->nodes[i], q->delay[i][self], moment);
    return level;
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
            const int64_t at = n->edge_at[k % QUANTA_EDGES] + q->delay[i][self][(k + 1) % 2 == 0];
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
