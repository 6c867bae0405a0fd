/* SPDX-License-Identifier: MIT
 *
 * test_clocks.c - a bus whose nodes have clocks of their own, against the same nodes quantum by
 * quantum (quanta.h). Random clocks, bit timings, delays and frames must give the same events at
 * the same ticks.
 */
#include "quanta.h"

#include <inttypes.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define SEEDS 100u
#define BIT_TIMES 4000u
#define FRAMES 24u  /* of each node */
#define EVENTS 20000u
#define BIT_TICKS 160u

/* ---- Random buses ---------------------------------------------------------------------------- */

static uint64_t state;

static uint64_t draw(void)
{
    state += 0x9E3779B97F4A7C15u;
    uint64_t x = state;
    x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9u;
    x = (x ^ x >> 27) * 0x94D049BB133111EBu;
    return x ^ x >> 31;
}

/* Returns a number from least to most. */
static int64_t between(int64_t least, int64_t most)
{
    return least + (int64_t)(draw() % (uint64_t)(most - least + 1));
}

static unsigned least_of(unsigned a, unsigned b)
{
    return a < b ? a : b;
}

typedef struct scenario {
    unsigned node_count;
    cw_node_config nodes[QUANTA_NODES_MAX];
    cw_frame frames[QUANTA_NODES_MAX][FRAMES];
    unsigned frame_count[QUANTA_NODES_MAX];
    uint64_t at_tick[QUANTA_NODES_MAX][FRAMES]; /* of which on a frame can be sent */
    bool counts; /* synchronisations: then no frame passes at once */
} scenario;

static scenario now_tested;

/* Draws the segments of a bit, and a quantum with which a bit lasts about BIT_TICKS. */
static cw_bit_timing draw_timing(int64_t ppm)
{
    cw_bit_timing t = {.prop_seg = (uint16_t)between(1, 8), .phase_seg1 = (uint16_t)between(1, 8),
                       .phase_seg2 = (uint16_t)between(2, 8)};
    t.sjw = (uint16_t)between(1, least_of(4, least_of(t.phase_seg1, t.phase_seg2)));
    t.quantum = CW_TICK * BIT_TICKS / cw_bit_timing_quanta(&t);
    t.quantum += t.quantum / 1000000 * between(-ppm, ppm);
    return t;
}

static void draw_delays(cw_node_timing *t, cw_span most)
{
    for (unsigned level = 0; level < 2; level++) {
        t->tx_delay[level] = between(0, most / 4);
        t->rx_delay[level] = between(0, most / 4);
    }
    if (draw() % 2) {
        t->tx_delay[1] = t->tx_delay[0];
        t->rx_delay[1] = t->rx_delay[0];
    }
    t->place = between(0, most);
    t->stub = between(0, most / 8);
}

static cw_frame draw_frame(unsigned node)
{
    cw_frame f = {.id = (uint32_t)(draw() % CW_BASE_ID_MAX) << 3, .dlc = (uint8_t)between(0, 8)};
    if (draw() % 4 == 0)
        f.flags = CW_FRAME_EXTENDED;
    f.id = (f.id | node) & (f.flags ? CW_EXTENDED_ID_MAX : CW_BASE_ID_MAX);
    for (unsigned i = 0; i < 8; i++)
        f.data[i] = (uint8_t)(draw() % 3 ? 0 : draw());
    return f;
}

/* Clocks are the same, near, or far from each other; so are delays. */
static void draw_scenario(uint64_t seed)
{
    static const int64_t clocks[] = {0, 100, 1000, 3000, 50000}; /* ppm */
    static const unsigned delays[] = {0, 5, 20, 300}; /* percent of a bit */
    state = seed;
    scenario *s = &now_tested;
    *s = (scenario){.node_count = (unsigned)between(2, QUANTA_NODES_MAX), .counts = seed % 2};
    const int64_t ppm = clocks[draw() % 5];
    const cw_span most = CW_TICK * BIT_TICKS / 100 * delays[draw() % 4];
    const bool same = draw() % 3, gaps = draw() % 2, one = draw() % 2;
    const unsigned sender = (unsigned)between(0, s->node_count - 1);
    const cw_bit_timing common = draw_timing(0);
    for (unsigned i = 0; i < s->node_count; i++) {
        cw_node_config *n = &s->nodes[i];
        *n = (cw_node_config){.order = CW_ORDER_FIFO, .queue = FRAMES, .warning_limit = 96};
        n->timing.bit = same ? common : draw_timing(ppm);
        n->timing.bit.quantum += n->timing.bit.quantum / 1000000 * between(-ppm, ppm);
        n->timing.bit.triple_sampling = draw() % 8 == 0;
        draw_delays(&n->timing, most);
        s->frame_count[i] = draw() % 3 ? (unsigned)between(0, FRAMES) : 0;
        if (one)
            s->frame_count[i] = i == sender ? FRAMES : 0;
        for (unsigned k = 0; k < s->frame_count[i]; k++)
            s->frames[i][k] = draw_frame(i);
        for (unsigned k = 1; gaps && k < s->frame_count[i]; k++)
            s->at_tick[i][k] = s->at_tick[i][k - 1] + (uint64_t)between(0, 600 * BIT_TICKS);
    }
}

/* ---- Events ---------------------------------------------------------------------------------- */

typedef struct event {
    uint64_t tick;
    unsigned node;
    cw_event_kind kind;
    uint64_t details;
} event;

typedef struct events {
    unsigned count;
    event list[EVENTS];
} events;

static events of_quanta, of_bus;

static void add_event(events *all, uint64_t tick, unsigned node, cw_event_kind kind,
                      uint64_t details)
{
    assert_true(all->count < EVENTS);
    unsigned place = all->count++;
    for (; place > 0; place--) {
        const event *before = &all->list[place - 1];
        if (before->tick < tick || (before->tick == tick && before->node < node) ||
            (before->tick == tick && before->node == node && before->kind <= kind))
            break;
        all->list[place] = *before;
    }
    all->list[place] = (event){tick, node, kind, details};
}

static uint64_t details_of_error(const cw_error *e, unsigned tec, unsigned rec)
{
    return (uint64_t)e->type << 56 | (uint64_t)e->role << 52 | (uint64_t)e->place.field << 40 |
           (uint64_t)e->place.index << 32 | (uint64_t)e->flag << 28 | (uint64_t)tec << 12 | rec;
}

static uint64_t details_of_frame(const cw_frame *f)
{
    uint64_t sum = f->id | (uint64_t)f->flags << 32 | (uint64_t)f->dlc << 40;
    for (unsigned i = 0; i < cw_frame_length(f); i++)
        sum = sum * 31 + f->data[i];
    return sum;
}

static cw_span begin_of_bit; /* that a controller of quanta begins now */

static void note_report(const quanta *q, unsigned i)
{
    const quanta_node *n = &q->nodes[i];
    const cw_mac_report *r = &n->report;
    begin_of_bit = n->now;
    const uint64_t tick = (uint64_t)((n->now + CW_TICK - 1) / CW_TICK);
    if (r->what & CW_REPORT_ARBITRATION_LOST)
        add_event(&of_quanta, tick, i, CW_EVENT_ARBITRATION_LOST, r->lost_bit);
    if (r->what & CW_REPORT_ERROR)
        add_event(&of_quanta, tick, i, CW_EVENT_ERROR,
                  details_of_error(&r->error, cw_mac_tec(&n->mac), cw_mac_rec(&n->mac)));
    if (r->what & CW_REPORT_OVERLOAD)
        add_event(&of_quanta, tick, i, CW_EVENT_OVERLOAD, 0);
    if (r->what & CW_REPORT_RX)
        add_event(&of_quanta, tick, i, CW_EVENT_RX, details_of_frame(cw_mac_received(&n->mac)));
    if (r->what & CW_REPORT_TX)
        add_event(&of_quanta, tick, i, CW_EVENT_TX, n->sent);
}

static uint64_t details_of(const cw_event *e, unsigned *sent)
{
    if (e->kind == CW_EVENT_ARBITRATION_LOST)
        return e->lost_bit;
    if (e->kind == CW_EVENT_ERROR)
        return details_of_error(&e->error, e->tec, e->rec);
    if (e->kind == CW_EVENT_RX)
        return details_of_frame(&e->frame);
    return e->kind == CW_EVENT_TX ? ++*sent : 0;
}

static void note_event(const cw_event *e)
{
    static unsigned sent[QUANTA_NODES_MAX];
    if (of_bus.count == 0)
        for (unsigned i = 0; i < QUANTA_NODES_MAX; i++)
            sent[i] = 0;
    if (e->kind == CW_EVENT_STATE || e->kind == CW_EVENT_DROP || e->kind == CW_EVENT_TOLERATED)
        return;
    for (unsigned i = 0; i < QUANTA_NODES_MAX; i++)
        if (e->nodes >> i & 1u)
            add_event(&of_bus, e->tick, i, e->kind, details_of(e, &sent[i]));
}

/* ---- Both ------------------------------------------------------------------------------------ */

static bool next_frame(cw_frame *frame, unsigned node, unsigned number)
{
    const cw_span due = (cw_span)now_tested.at_tick[node][number % FRAMES] * CW_TICK;
    if (number >= now_tested.frame_count[node] || begin_of_bit < due)
        return false;
    *frame = now_tested.frames[node][number];
    return true;
}

static void set_delays(quanta *q, const scenario *s)
{
    for (unsigned a = 0; a < s->node_count; a++)
        for (unsigned b = 0; b < s->node_count; b++)
            for (unsigned level = 0; level < 2; level++) {
                const cw_node_timing *from = &s->nodes[a].timing, *to = &s->nodes[b].timing;
                const cw_span stubs = a == b ? 0 : from->stub + to->stub;
                const cw_span line = from->place - to->place;
                q->delay[a][b][level] = from->tx_delay[level] + to->rx_delay[level] + stubs +
                                        (line < 0 ? -line : line);
            }
}

static quanta_timing timing_of(const cw_bit_timing *t)
{
    return (quanta_timing){.quantum = t->quantum, .prop = t->prop_seg, .seg1 = t->phase_seg1,
                           .seg2 = t->phase_seg2, .sjw = t->sjw,
                           .triple = t->triple_sampling};
}

static quanta q;
static cw_sync_record records[QUANTA_NODES_MAX];

static void run_quanta(const scenario *s)
{
    q = (quanta){.next_frame = next_frame, .bit_ended = note_report};
    set_delays(&q, s);
    for (unsigned i = 0; i < s->node_count; i++) {
        const quanta_timing timing = timing_of(&s->nodes[i].timing.bit);
        quanta_add(&q, &timing, 0);
    }
    while (quanta_next(&q) <= (int64_t)BIT_TIMES * BIT_TICKS * CW_TICK)
        quanta_step(&q);
}

static void run_bus(const scenario *s)
{
    const cw_bus_config config = {.bit_ticks = BIT_TICKS, .node_count = (uint8_t)s->node_count,
                                  .inbox = QUANTA_NODES_MAX * FRAMES, .events = 8192,
                                  .nodes = s->nodes};
    cw_bus *bus = cw_bus_init(malloc(cw_bus_size(&config)), &config);
    cw_event e;
    assert_non_null(bus);
    cw_bus_set_own_clocks(bus, true);
    cw_bus_set_sync_records(bus, s->counts ? records : NULL);
    for (unsigned i = 0; i < s->node_count; i++)
        for (unsigned k = 0; k < s->frame_count[i]; k++)
            assert_int_equal(cw_node_send(bus, i, &s->frames[i][k], s->at_tick[i][k]),
                             CW_OK);
    while (cw_bus_advance(bus, (uint64_t)BIT_TIMES * BIT_TICKS) != CW_OK)
        while (cw_bus_poll(bus, &e))
            note_event(&e);
    while (cw_bus_poll(bus, &e))
        note_event(&e);
    free(bus);
}

static void write_event(const char *of, const event *e)
{
    print_error("%s: tick %" PRIu64 " node %u %s %" PRIx64 "\n", of, e->tick, e->node,
                cw_event_name(e->kind), e->details);
}

static void compare(uint64_t seed)
{
    for (unsigned i = 0; i < of_quanta.count && i < of_bus.count; i++) {
        const event *a = &of_quanta.list[i], *b = &of_bus.list[i];
        if (a->tick == b->tick && a->node == b->node && a->kind == b->kind &&
            a->details == b->details)
            continue;
        write_event("quanta", a);
        write_event("bus", b);
        fail_msg("seed %" PRIu64 ": event %u differs", seed, i);
    }
    if (of_quanta.count != of_bus.count)
        fail_msg("seed %" PRIu64 ": %u events by quanta, %u of the bus", seed, of_quanta.count,
                 of_bus.count);
}

/* The bus looks at edges when it samples: the last one may still be to come. Margins are those of
 * edges that do not overtake others. */
static unsigned compare_syncs(uint64_t seed, const scenario *s)
{
    unsigned resyncs = 0;
    for (unsigned i = 0; i < s->node_count; i++) {
        const cw_sync_stats *a = &q.nodes[i].sync, *b = &records[i].stats;
        const uint64_t by_quanta = a->hard_syncs + a->resyncs;
        const uint64_t of_it = b->hard_syncs + b->resyncs;
        if (of_it != by_quanta && of_it + 1 != by_quanta)
            fail_msg("seed %" PRIu64 " node %u: %" PRIu64 " synchronisations by quanta, %" PRIu64
                     " of the bus", seed, i, by_quanta, of_it);
        if (of_it == by_quanta && a->phase_error != b->phase_error)
            fail_msg("seed %" PRIu64 " node %u: phase error %d by quanta, %d of the bus", seed, i,
                     (int)a->phase_error_tq, (int)b->phase_error_tq);
        if (of_it == by_quanta && (a->margin ? a->margin : CW_NO_MARGIN) != b->margin)
            fail_msg("seed %" PRIu64 " node %u: margin %" PRId64 " by quanta, %" PRId64
                     " of the bus", seed, i, a->margin, b->margin);
        resyncs += (unsigned)b->resyncs;
    }
    return resyncs;
}

/* Returns true when all bits are common to all nodes, so that none synchronises. */
static bool is_on_grid(const scenario *s)
{
    const cw_node_timing *first = &s->nodes[0].timing;
    bool same = first->bit.quantum * cw_bit_timing_quanta(&first->bit) == CW_TICK * BIT_TICKS;
    for (unsigned a = 0; a < s->node_count; a++) {
        const cw_bit_timing *b = &s->nodes[a].timing.bit;
        same = same && memcmp(&first->bit, b, sizeof *b) == 0;
        for (unsigned to = 0; to < s->node_count; to++)
            same = same && q.delay[a][to][0] == 0 && q.delay[a][to][1] == 0;
    }
    return same;
}

static void a_bus_does_what_its_nodes_do_quantum_by_quantum(void **unused)
{
    (void)unused;
    unsigned kinds[CW_EVENT_COUNT] = {0}, resyncs = 0;
    for (uint64_t seed = 1; seed <= SEEDS; seed++) {
        draw_scenario(seed);
        of_quanta.count = of_bus.count = 0;
        run_quanta(&now_tested);
        run_bus(&now_tested);
        compare(seed);
        if (now_tested.counts && !is_on_grid(&now_tested))
            resyncs += compare_syncs(seed, &now_tested);
        for (unsigned i = 0; i < of_bus.count; i++)
            kinds[of_bus.list[i].kind]++;
    }
    assert_true(kinds[CW_EVENT_RX] > 1000 && kinds[CW_EVENT_TX] > 1000);
    assert_true(kinds[CW_EVENT_ERROR] > 1000 && kinds[CW_EVENT_ARBITRATION_LOST] > 1000);
    assert_true(kinds[CW_EVENT_OVERLOAD] > 10);
    assert_true(resyncs > 1000);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_bus_does_what_its_nodes_do_quantum_by_quantum),
    };
    return cmocka_run_group_tests_name("clocks of nodes", tests, NULL, NULL);
}
