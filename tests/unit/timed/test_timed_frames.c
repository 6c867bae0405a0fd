/* SPDX-License-Identifier: MIT
 *
 * test_timed_frames.c - clean frames of nodes with clocks of their own: they pass at once, with the
 * events and statistics of single bits.
 */
#include "cases.h"
#include "canwire.h"

#define BIT_TICKS 160u
#define NODES 4u
#define FRAMES 40u
#define FRAME_SPACE 200u /* bits from one frame to the next */
#define WORK_OF_A_FRAME 20u /* with the idle time around it; bit by bit it is more than 100 */

/* ---- Two buses, of which one takes single bits ----------------------------------------------- */

typedef struct pair {
    cw_node_config nodes[NODES];
    cw_bus_config config;
    cw_bus *fast, *single;
    cw_sync_record records[2][NODES];
} pair;

static cw_bus *make_bus(const cw_bus_config *config)
{
    cw_bus *bus = cw_bus_init(malloc(cw_bus_size(config)), config);
    assert_non_null(bus);
    return bus;
}

/* Clocks are 100 ppm apart, and the nodes 10 ns. */
static void set_up(pair *p)
{
    *p = (pair){.config = {.bit_ticks = BIT_TICKS, .node_count = NODES, .inbox = FRAMES,
                           .events = 4096}};
    for (unsigned i = 0; i < NODES; i++) {
        cw_node_timing *t = &p->nodes[i].timing;
        p->nodes[i].queue = FRAMES;
        p->nodes[i].warning_limit = 96;
        t->bit = (cw_bit_timing){.quantum = CW_TICK * 10, .prop_seg = 6, .phase_seg1 = 7,
                                 .phase_seg2 = 2, .sjw = 1};
        t->bit.quantum += t->bit.quantum / 10000 * (cw_span)i;
        t->place = CW_TICK * (cw_span)i;
    }
}

static void begin(pair *p)
{
    p->config.nodes = p->nodes;
    p->fast = make_bus(&p->config);
    p->single = make_bus(&p->config);
    cw_bus_set_stepping(p->single, true);
    cw_bus_set_sync_records(p->fast, p->records[0]);
    cw_bus_set_sync_records(p->single, p->records[1]);
}

static void end(pair *p)
{
    free(p->fast);
    free(p->single);
}

static void send_frames(pair *p, unsigned first, unsigned senders)
{
    for (unsigned k = 0; k < FRAMES; k++) {
        const cw_frame frame = {.id = 0x100 + k, .dlc = (uint8_t)(k % 9),
                                .data = {0, 0, (uint8_t)(37 * k), 0xFF, 0xFF, (uint8_t)k}};
        const uint64_t tick = (100 + (uint64_t)k * FRAME_SPACE) * BIT_TICKS + 13 * k;
        assert_int_equal(cw_node_send(p->fast, first + k % senders, &frame, tick), CW_OK);
        assert_int_equal(cw_node_send(p->single, first + k % senders, &frame, tick), CW_OK);
    }
}

static void compare_events(pair *p)
{
    cw_event a, b;
    while (cw_bus_poll(p->fast, &a)) {
        assert_true(cw_bus_poll(p->single, &b));
        assert_int_equal(a.tick, b.tick);
        assert_int_equal(a.kind, b.kind);
        assert_int_equal(a.nodes, b.nodes);
        assert_int_equal(a.handed_in, b.handed_in);
        assert_int_equal(a.from, b.from);
    }
    assert_false(cw_bus_poll(p->single, &b));
}

static void compare_syncs(const pair *p, unsigned i)
{
    cw_sync_stats a, b;
    assert_int_equal(cw_node_get_sync_stats(p->fast, i, &a), CW_OK);
    assert_int_equal(cw_node_get_sync_stats(p->single, i, &b), CW_OK);
    assert_int_equal(a.hard_syncs, b.hard_syncs);
    assert_int_equal(a.resyncs, b.resyncs);
    assert_int_equal(a.phase_error_tq, b.phase_error_tq);
    assert_int_equal(a.phase_error, b.phase_error);
    assert_int_equal(a.margin, b.margin);
}

static void compare_stats(const pair *p)
{
    cw_bus_stats a, b;
    cw_node_stats c, d;
    memset(&a, 0, sizeof a);
    memset(&b, 0, sizeof b);
    cw_bus_get_stats(p->fast, &a);
    cw_bus_get_stats(p->single, &b);
    assert_memory_equal(&a, &b, sizeof a);
    for (unsigned i = 0; i < p->config.node_count; i++) {
        memset(&c, 0, sizeof c);
        memset(&d, 0, sizeof d);
        assert_int_equal(cw_node_get_stats(p->fast, i, &c), CW_OK);
        assert_int_equal(cw_node_get_stats(p->single, i, &d), CW_OK);
        assert_memory_equal(&c, &d, sizeof c);
        compare_syncs(p, i);
    }
}

/* Goes on up to the end, with looks in between. Returns the work of the fast bus. */
static uint64_t run(pair *p)
{
    const uint64_t before = cw_bus_work(p->fast);
    for (unsigned k = 1; k <= 4; k++) {
        const uint64_t tick = (uint64_t)FRAMES * (FRAME_SPACE + 10) * BIT_TICKS / 4 * k;
        assert_int_equal(cw_bus_advance(p->fast, tick), CW_OK);
        assert_int_equal(cw_bus_advance(p->single, tick), CW_OK);
        assert_int_equal(cw_bus_now(p->fast), cw_bus_now(p->single));
        compare_events(p);
        compare_stats(p);
    }
    return cw_bus_work(p->fast) - before;
}

static cw_bus_stats stats_of(const pair *p)
{
    cw_bus_stats stats;
    cw_bus_get_stats(p->fast, &stats);
    return stats;
}

/* ---- Tests ----------------------------------------------------------------------------------- */

TEST(clean_frames_pass_at_once)
{
    pair p;
    set_up(&p);
    begin(&p);
    send_frames(&p, 0, NODES);
    assert_true(run(&p) < FRAMES * WORK_OF_A_FRAME);
    assert_int_equal(stats_of(&p).frames, FRAMES);
    end(&p);
}

/* Node 3 acknowledges nothing, node 2 is off the bus, and node 1 takes three samples a bit. */
TEST(nodes_that_only_listen_or_are_away_change_nothing)
{
    pair p;
    set_up(&p);
    p.nodes[3].modes = CW_MODE_LISTEN_ONLY;
    p.nodes[1].timing.bit.triple_sampling = true;
    begin(&p);
    assert_int_equal(cw_node_attach(p.fast, 2, false), CW_OK);
    assert_int_equal(cw_node_attach(p.single, 2, false), CW_OK);
    send_frames(&p, 0, 2);
    assert_true(run(&p) < FRAMES * WORK_OF_A_FRAME);
    assert_int_equal(stats_of(&p).frames, FRAMES);
    end(&p);
}

/* Node 2 is in bus-off, where it counts each edge to dominant. */
TEST(a_node_in_bus_off_counts_the_edges_of_all_frames)
{
    pair p;
    set_up(&p);
    const cw_rule rule = {.name = "off", .action = CW_ACTION_BUS_OFF, .trigger = CW_TRIGGER_TIME,
                          .nodes = 4, .time_begin = 5000, .time_end = CW_NEVER, .every = 1,
                          .probability = UINT64_MAX};
    p.config.rules = &rule;
    p.config.rule_count = 1;
    begin(&p);
    send_frames(&p, 0, 2);
    assert_true(run(&p) < FRAMES * WORK_OF_A_FRAME);
    assert_int_equal(stats_of(&p).frames, FRAMES);
    assert_true(p.records[1][2].stats.hard_syncs > 4 * FRAMES);
    end(&p);
}

/* The frames have counters, so they are not yet what they will be when they are handed in. */
TEST(frames_with_counters_are_as_long_as_they_are_with_them)
{
    pair p;
    set_up(&p);
    cw_protection protections[NODES];
    for (unsigned i = 0; i < NODES; i++)
        protections[i] = (cw_protection){.node = (uint8_t)i, .id = 0x100 + i,
                                         .counter = {.bits = 8, .max = 255}};
    p.config.protections = protections;
    p.config.protection_count = NODES;
    begin(&p);
    for (unsigned k = 0; k < FRAMES; k++) {
        const cw_frame frame = {.id = 0x100 + k % NODES, .dlc = 8};
        const uint64_t tick = (100 + (uint64_t)k * FRAME_SPACE) * BIT_TICKS + 13 * k;
        assert_int_equal(cw_node_send(p.fast, k % NODES, &frame, tick), CW_OK);
        assert_int_equal(cw_node_send(p.single, k % NODES, &frame, tick), CW_OK);
    }
    (void)run(&p);
    assert_int_equal(stats_of(&p).frames, FRAMES);
    end(&p);
}

/* Edges to dominant come to the line later than others, by nearly a tick. So no bit time ends while
 * the ACK slot is dominant, and the last dominant one is before. */
TEST(bit_times_are_recessive_whose_ends_are_recessive)
{
    pair p;
    set_up(&p);
    p.config.node_count = 2;
    p.config.bit_ticks = 100;
    p.nodes[0].timing = (cw_node_timing){
        .bit = {.quantum = 39045157284, .prop_seg = 4, .phase_seg1 = 3, .phase_seg2 = 3, .sjw = 2},
        .place = 328415};
    p.nodes[1].timing = (cw_node_timing){
        .bit = {.quantum = 17885804384, .prop_seg = 13, .phase_seg1 = 5, .phase_seg2 = 5, .sjw = 4},
        .tx_delay = {4210186867, 0}, .rx_delay = {1367945968, 0}};
    begin(&p);
    const cw_frame frame = {.id = 0x740};
    assert_int_equal(cw_node_send(p.fast, 0, &frame, 5000), CW_OK);
    assert_int_equal(cw_node_send(p.single, 0, &frame, 5000), CW_OK);
    assert_int_equal(cw_bus_advance(p.fast, 10000), CW_OK);
    assert_int_equal(cw_bus_advance(p.single, 10000), CW_OK);
    assert_int_equal(cw_bus_recessive_bits(p.single), 14);
    assert_int_equal(cw_bus_recessive_bits(p.fast), 14);
    assert_true(cw_bus_work(p.fast) < 40);
    end(&p);
}

/* Frames that come while others are on their way wait, and contend: all bits are simulated. */
TEST(frames_that_contend_go_bit_by_bit)
{
    pair p;
    set_up(&p);
    begin(&p);
    for (unsigned i = 0; i < NODES; i++) {
        const cw_frame frame = {.id = 0x100 + i, .dlc = 8};
        assert_int_equal(cw_node_send(p.fast, i, &frame, 5000), CW_OK);
        assert_int_equal(cw_node_send(p.single, i, &frame, 5000), CW_OK);
    }
    assert_true(run(&p) > 3 * 100);
    assert_int_equal(stats_of(&p).frames, NODES);
    assert_int_equal(stats_of(&p).arbitration_lost, NODES * (NODES - 1) / 2);
    end(&p);
}

/* A frame that comes while another one is on its way waits beside it, up to its last bit. */
TEST(frames_that_come_meanwhile_wait_as_they_do_bit_by_bit)
{
    pair p;
    for (unsigned k = 0; k < 180; k++) {
        set_up(&p);
        begin(&p);
        for (unsigned second = 0; second < 2; second++) {
            const cw_frame frame = {.id = 0x100 - second, .dlc = 1};
            const uint64_t tick = 5000 + second * k * BIT_TICKS / 2;
            assert_int_equal(cw_node_send(p.fast, 0, &frame, tick), CW_OK);
            assert_int_equal(cw_node_send(p.single, 0, &frame, tick), CW_OK);
        }
        (void)run(&p);
        assert_int_equal(stats_of(&p).frames, 2);
        end(&p);
    }
}

/* In 10 bits 2 % are 3.2 quanta, more than SJW. */
TEST(frames_without_proof_go_bit_by_bit)
{
    pair p;
    set_up(&p);
    p.nodes[1].timing.bit.quantum += p.nodes[1].timing.bit.quantum / 50;
    begin(&p);
    send_frames(&p, 0, 1);
    assert_true(run(&p) > FRAMES * 40);
    end(&p);
}

TEST(nobody_acknowledges_the_frame_of_a_node_alone)
{
    pair p;
    set_up(&p);
    p.nodes[0].timing.bit.quantum += p.nodes[0].timing.bit.quantum / 10000;
    p.config.node_count = 1;
    begin(&p);
    send_frames(&p, 0, 1);
    (void)run(&p);
    assert_int_equal(stats_of(&p).frames, 0);
    end(&p);
}

/* Moments are small numbers: 2^31 ticks are 26.8 s. A frame that comes later does not come now. */
TEST(a_frame_of_another_minute_comes_then)
{
    pair p;
    for (unsigned bits = 1; bits < 8; bits++) {
        const cw_frame frame = {.id = 0x123};
        cw_event e;
        set_up(&p);
        begin(&p);
        const uint64_t due = (UINT64_C(1) << 32) + 17 + bits * BIT_TICKS;
        assert_int_equal(cw_bus_advance(p.fast, 20 * BIT_TICKS), CW_OK);
        assert_int_equal(cw_node_send(p.fast, 0, &frame, due), CW_OK);
        assert_int_equal(cw_bus_advance(p.fast, due + 100 * BIT_TICKS), CW_OK);
        assert_true(cw_bus_poll(p.fast, &e));
        assert_true(e.kind == CW_EVENT_RX && e.tick > due + 44 * BIT_TICKS &&
                    e.tick < due + 60 * BIT_TICKS);
        end(&p);
    }
}

/* A frame of bits of half a second is too long for numbers of 64 bits: it goes bit by bit. */
TEST(frames_of_very_long_bits_come_in_time)
{
    pair p;
    for (unsigned slower = 0; slower < 16; slower++) {
        const uint64_t bit = CW_CLOCK_HZ >> slower;
        const cw_frame frame = {.id = 0x1BA5EA00, .flags = CW_FRAME_EXTENDED};
        cw_event e;
        set_up(&p);
        p.config.bit_ticks = (uint32_t)bit;
        for (unsigned i = 0; i < NODES; i++)
            p.nodes[i].timing = (cw_node_timing){.place = CW_TICK * (cw_span)(bit / 1000 * i)};
        begin(&p);
        assert_int_equal(cw_node_send(p.fast, 0, &frame, 20 * bit), CW_OK);
        assert_int_equal(cw_bus_advance(p.fast, 200 * bit), CW_OK);
        uint64_t nodes = 0;
        while (cw_bus_poll(p.fast, &e)) {
            assert_true(e.tick > 82 * bit && e.tick < 98 * bit); /* 64 bits and stuff */
            nodes |= e.nodes;
        }
        assert_int_equal(nodes, 0xF);
        end(&p);
    }
}
