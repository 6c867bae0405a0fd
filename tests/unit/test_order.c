/* SPDX-License-Identifier: MIT
 *
 * test_order.c - arbitrations that are not won by the lowest pending identifier, against a list of
 * all frames that were handed in.
 */
#include "model.h"
#include "rig.h"

#define NODES 5u
#define FRAMES 60u
#define SEEDS 40u

typedef struct sent_frame {
    cw_frame frame;
    uint64_t tick;
    unsigned node;
    bool gone;
} sent_frame;

typedef struct plan {
    sent_frame frames[FRAMES];
    uint64_t seed;
    uint64_t draws;
} plan;

static unsigned draw(plan *p, unsigned below)
{
    return (unsigned)(cw_random(p->seed, "order", p->draws++) % below);
}

/* Returns a frame whose identifier tells which of the plan it is. */
static cw_frame random_frame(plan *p, unsigned n)
{
    const unsigned kind = draw(p, 4);
    cw_frame f = rig_frame(draw(p, 8) << 8 | n, 0, draw(p, 4));
    if (kind == 1)
        f.flags = CW_FRAME_REMOTE;
    if (kind == 2) { /* its base identifier is that of another frame */
        f.flags = CW_FRAME_EXTENDED;
        f.id = f.id << 18 | draw(p, 1u << 18);
    }
    return f;
}

/* They come in groups, so that many of them wait. */
static void make_plan(plan *p, uint64_t seed, unsigned nodes)
{
    uint64_t tick = JOIN * BIT;
    *p = (plan){.seed = seed};
    for (unsigned n = 0; n < FRAMES; n++) {
        tick += draw(p, 4) ? draw(p, 2) * BIT : draw(p, 600 * BIT);
        p->frames[n] = (sent_frame){.frame = random_frame(p, n), .tick = tick,
                                    .node = draw(p, nodes)};
    }
}

static unsigned find(const plan *p, const cw_frame *frame)
{
    for (unsigned n = 0; n < FRAMES; n++)
        if (cw_frame_equal(&p->frames[n].frame, frame))
            return n;
    fail();
    return 0;
}

/* Returns the identifier as a number: base identifiers, then IDE, then the rest. */
static uint64_t rank(const cw_frame *f)
{
    const uint64_t base = f->flags & CW_FRAME_EXTENDED ? f->id >> 18 : f->id;
    return f->flags & CW_FRAME_EXTENDED ? base << 19 | 1u << 18 | (f->id & 0x3FFFF) : base << 19;
}

/* Returns the lowest frame that should have been sent in place of another one, or that one. */
static unsigned should_win(const plan *p, unsigned winner, uint64_t sof)
{
    unsigned lowest = winner;
    for (unsigned n = 0; n < FRAMES; n++) {
        const sent_frame *s = &p->frames[n];
        if (!s->gone && s->tick <= sof && rank(&s->frame) < rank(&p->frames[lowest].frame))
            lowest = n;
    }
    return lowest;
}

/* Compares the event of a frame with the list of all. told: NULL: there is none. */
static void check_sent(plan *p, const cw_event *tx, const cw_event *told)
{
    const unsigned n = find(p, &tx->frame);
    const uint64_t sof = tx->tick - cw_frame_wire_bits(&tx->frame) * BIT;
    const unsigned lowest = should_win(p, n, sof);
    assert_int_equal(told != NULL, lowest != n);
    p->frames[n].gone = true;
    if (!told)
        return;
    const sent_frame *late = &p->frames[lowest];
    assert_int_equal(told->nodes, tx->nodes);
    assert_int_equal(told->from, NODE(late->node));
    assert_int_equal(told->pending & CW_EXTENDED_ID_MAX, late->frame.id);
    assert_true(cw_frame_equal(&told->frame, &tx->frame));
    assert_in_range(told->tick, sof + 14 * BIT, sof + 41 * BIT);
}

static size_t check(const rig *r, plan *p)
{
    const cw_event *told = NULL;
    size_t count = 0, sent = 0;
    for (size_t i = 0; i < r->count; i++) {
        const cw_event *e = &r->events[i];
        if (e->kind == CW_EVENT_IMPROPER) {
            assert_null(told);
            told = e;
            count++;
        }
        if (e->kind == CW_EVENT_TX) {
            check_sent(p, e, told);
            told = NULL;
            sent++;
        }
    }
    assert_int_equal(sent, FRAMES);
    assert_int_equal(rig_bus_stats(r).improper_arbitrations, count);
    return count;
}

/* Runs a plan where some nodes send first in, first out. Returns how often the order was wrong. */
static size_t run(uint64_t seed, uint64_t fifo, bool stepping, bool own)
{
    plan p;
    RIG *r = rig_new(NODES);
    make_plan(&p, seed, NODES - 1);
    for (unsigned i = 0; i < NODES; i++) {
        r->nodes[i].queue = FRAMES;
        r->nodes[i].order = fifo >> i & 1u ? CW_ORDER_FIFO : CW_ORDER_PRIORITY;
    }
    rig_start(r);
    cw_bus_set_stepping(r->bus, stepping);
    cw_bus_set_own_clocks(r->bus, own);
    for (unsigned n = 0; n < FRAMES; n++)
        rig_send(r, p.frames[n].node, &p.frames[n].frame, p.frames[n].tick);
    rig_run_bits(r, 60000);
    const size_t count = check(r, &p);
    return count;
}

TEST(queues_by_priority_never_win_improperly)
{
    for (uint64_t seed = 0; seed < SEEDS; seed++)
        assert_int_equal(run(seed, 0, seed % 4 == 1, seed % 4 == 2), 0);
}

TEST(each_frame_that_waits_in_the_wrong_place_is_told)
{
    size_t told = 0;
    for (uint64_t seed = 0; seed < SEEDS; seed++)
        told += run(seed, seed, seed % 4 == 1, seed % 4 == 2);
    assert_in_range(told, SEEDS, SEEDS * FRAMES);
}

/* It is counted also when nobody wants the event. */
TEST(an_unwanted_event_is_counted)
{
    RIG *r = rig_new(2);
    r->nodes[0].order = CW_ORDER_FIFO;
    rig_start(r);
    cw_bus_set_events(r->bus, CW_EVENTS_USUAL & ~(1u << CW_EVENT_IMPROPER));
    const cw_frame high = rig_frame(0x700, 0, 0), low = rig_frame(0x100, 0, 0);
    rig_send(r, 0, &high, 0);
    rig_send(r, 0, &low, 0);
    rig_run_bits(r, 200);
    assert_int_equal(rig_count(r, CW_EVENT_IMPROPER, -1), 0);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 2);
    assert_int_equal(rig_bus_stats(r).improper_arbitrations, 1);
}

/* Nodes on different wires do not compete. */
TEST(another_wire_has_its_own_order)
{
    RIG *r = rig_new(4);
    r->rules[r->config.rule_count++] =
        (cw_rule){.name = "cut", .action = CW_ACTION_PARTITION, .trigger = CW_TRIGGER_TIME,
                  .group = {0, 0, 1, 1}, .time_end = CW_NEVER, .probability = UINT64_MAX,
                  .every = 1};
    rig_start(r);
    rig_run_bits(r, JOIN + 1);
    const cw_frame high = rig_frame(0x700, 0, 0), low = rig_frame(0x100, 0, 0);
    rig_send(r, 0, &high, 20 * BIT);
    rig_send(r, 2, &low, 20 * BIT);
    rig_run_bits(r, 200);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 2);
    assert_int_equal(rig_count(r, CW_EVENT_IMPROPER, -1), 0);
}
