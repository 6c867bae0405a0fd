/* SPDX-License-Identifier: MIT
 *
 * test_bus.c - nodes on one wire: arbitration, hand-in, events, time, modes, restart, flips.
 */
#include "model.h"
#include "rig.h"

#include "prng.h"

#define EXTENDED CW_FRAME_EXTENDED
#define REMOTE CW_FRAME_REMOTE
#define ACK_FROM_END 9u        /* the ACK slot is the ninth wire bit from the end */
#define ERROR_FRAME_BITS 14u   /* flag 6, delimiter 8 */
#define INTERMISSION_BITS 3u
#define SUSPEND_BITS 8u
#define RECOVERY_BITS (128u * 11u)

/* End of wire bit n of a frame whose SOF is the given bit. */
static uint64_t end_of(uint64_t sof, uint64_t n)
{
    return (sof + n + 1) * BIT;
}

/* ---- Medium access: M1, M9, M10 -------------------------------------------------------------- */

/* M10: eleven recessive bits, then SOF; a frame takes part in the first bit that starts at or after
 * its hand-in. */
static void first_sof_comes_after_eleven_bits(void **state)
{
    (void)state;
    static const struct {
        uint64_t tick;
        unsigned sof;
    } cases[] = {{0, 11},        {1, 11},        {11 * BIT, 11},     {11 * BIT + 1, 12},
                 {12 * BIT, 12}, {50 * BIT, 50}, {50 * BIT + 159, 51}};
    cw_frame f = rig_frame(0x123, 0, 1);
    unsigned length = model_encode(&f).length;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        rig *r = rig_new(2);
        rig_start(r);
        rig_send(r, 0, &f, cases[i].tick);
        rig_run_bits(r, cases[i].sof);
        assert_int_equal(cw_bus_recessive_bits(r->bus), cases[i].sof);
        rig_run_bits(r, cases[i].sof + 1);
        assert_int_equal(cw_bus_recessive_bits(r->bus), 0);
        rig_run_bits(r, 300);
        assert_int_equal(r->count, 2);
        assert_int_equal(rig_nth(r, CW_EVENT_RX, 0)->tick, end_of(cases[i].sof, length - 2));
        assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->tick, end_of(cases[i].sof, length - 1));
        rig_free(r);
    }
}

/* M1, M6: the next SOF comes right after three bits of intermission. */
static void frames_follow_after_three_bits(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    cw_frame f = rig_frame(0x123, 0, 3);
    unsigned length = model_encode(&f).length;
    rig_start(r);
    for (unsigned i = 0; i < 10; i++)
        rig_send(r, 0, &f, 0);
    rig_run_bits(r, 2000);
    for (unsigned i = 0; i < 10; i++)
        assert_int_equal(rig_nth(r, CW_EVENT_TX, i)->tick,
                         end_of(JOIN + i * (length + INTERMISSION_BITS), length - 1));
    rig_free(r);
}

/* M1: a frame handed in during the SOF of another joins with its first identifier bit and can win;
 * one bit later it waits. */
static void a_frame_joins_a_foreign_sof(void **state)
{
    (void)state;
    cw_frame low = rig_frame(0x400, 0, 0);
    cw_frame high = rig_frame(0x100, 0, 0);
    for (unsigned late = 0; late < 3; late++) {
        rig *r = rig_new(3);
        rig_start(r);
        rig_send(r, 0, &low, 0);
        rig_send(r, 1, &high, JOIN * BIT + 1 + late * (BIT - 1)); /* 1 and 160: end of SOF, 319 */
        rig_run_bits(r, 300);
        bool joins = late < 2;
        assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->nodes, joins ? NODE(1) : NODE(0));
        assert_int_equal(rig_count(r, CW_EVENT_ARBITRATION_LOST, 0), joins);
        assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
        assert_int_equal(rig_bus_stats(r).frames, 2);
        rig_free(r);
    }
}

/* M1: the choice is made at each start; a more urgent frame overtakes one that lost. */
static void the_most_urgent_frame_goes_at_each_start(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    cw_frame foreign = rig_frame(0x200, 0, 0);
    cw_frame mine = rig_frame(0x300, 0, 0);
    cw_frame urgent = rig_frame(0x100, 0, 0);
    rig_start(r);
    rig_send(r, 0, &foreign, 0);
    rig_send(r, 1, &mine, 0);
    rig_send(r, 1, &urgent, 40 * BIT);
    rig_run_bits(r, 500);
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->frame.id, 0x200);
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 1)->frame.id, 0x100);
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 2)->frame.id, 0x300);
    rig_free(r);
}

/* ---- Arbitration: M2, M3 --------------------------------------------------------------------- */

/* First bit in which two texts differ; both go on that far. */
static unsigned first_difference(const char *a, const char *b)
{
    unsigned n = 0;
    while (a[n] == b[n])
        n++;
    return n;
}

/* Two frames that start together: by their bits alone it is known who loses, where and when. */
static void check_pair(const cw_frame *a, const cw_frame *b)
{
    const model models[2] = {model_encode(a), model_encode(b)};
    const cw_frame *frames[2] = {a, b};
    unsigned bit = first_difference(models[0].plain, models[1].plain);
    unsigned loser = models[0].plain[bit] == '1' ? 0 : 1;
    unsigned winner = 1 - loser;
    rig *r = rig_new(3);
    rig_start(r);
    rig_send(r, 0, a, 0);
    rig_send(r, 1, b, 0);
    rig_run_bits(r, 600);
    const cw_event *lost = rig_nth(r, CW_EVENT_ARBITRATION_LOST, 0);
    assert_int_equal(lost->nodes, NODE(loser));
    assert_int_equal(lost->lost_bit, bit - 1);
    assert_int_equal(lost->tick, end_of(JOIN, models[loser].at[bit]));
    assert_true(cw_frame_equal(&lost->frame, frames[loser]));
    const cw_event *rx = rig_nth(r, CW_EVENT_RX, 0);
    assert_int_equal(rx->nodes, NODE(loser) | NODE(2));
    assert_true(cw_frame_equal(&rx->frame, frames[winner]));
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->nodes, NODE(winner));
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 1)->nodes, NODE(loser));
    uint64_t sof = JOIN + models[winner].length + INTERMISSION_BITS;
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 1)->tick, end_of(sof, models[loser].length - 1));
    assert_int_equal(r->count, 5);
    rig_free(r);
}

#define PAIR_PREFIXES 8u
#define PAIR_EXTENSIONS 5u
#define PAIR_FRAMES (2u * PAIR_PREFIXES * (1u + PAIR_EXTENSIONS))

static unsigned make_contenders(cw_frame *frames)
{
    static const uint32_t prefixes[PAIR_PREFIXES] = {0,     1,     0x7FF, 0x7FE,
                                                     0x123, 0x555, 0x0F8, 0x400};
    static const uint32_t extensions[PAIR_EXTENSIONS] = {0, 1, 0x3FFFF, 0x15555, 0x20000};
    unsigned n = 0;
    for (unsigned p = 0; p < PAIR_PREFIXES; p++)
        for (unsigned remote = 0; remote <= REMOTE; remote += REMOTE) {
            frames[n++] = rig_frame(prefixes[p], remote, 1);
            for (unsigned e = 0; e < PAIR_EXTENSIONS; e++)
                frames[n++] = rig_frame(prefixes[p] << 18 | extensions[e], EXTENDED | remote, 1);
        }
    return n;
}

/* M2, M3: base, extended, data, remote with equal and with other prefixes, both ways round. */
static void every_pairing_is_won_by_the_dominant_bit(void **state)
{
    (void)state;
    cw_frame frames[PAIR_FRAMES];
    unsigned n = make_contenders(frames);
    assert_int_equal(n, PAIR_FRAMES);
    for (unsigned a = 0; a < n; a++)
        for (unsigned b = 0; b < n; b++)
            if (a != b)
                check_pair(&frames[a], &frames[b]);
}

/* M4: both win arbitration; the node that sends `r` at the first bit that differs has an error. */
static void same_identifier_with_other_data_is_a_bit_error(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    cw_frame a = rig_frame(0x123, 0, 2);
    cw_frame b = a;
    b.data[1] ^= 0x10;
    model ma = model_encode(&a);
    model mb = model_encode(&b);
    unsigned bit = first_difference(ma.plain, mb.plain);
    unsigned loser = ma.plain[bit] == '1' ? 0 : 1;
    rig_start(r);
    rig_send(r, 0, &a, 0);
    rig_send(r, 1, &b, 0);
    rig_run_bits(r, 100);
    const cw_event *e = rig_nth(r, CW_EVENT_ERROR, 0);
    assert_int_equal(e->nodes, NODE(loser));
    assert_int_equal(e->error.type, CW_ERROR_BIT);
    assert_int_equal(e->error.role, CW_ROLE_TRANSMITTER);
    assert_int_equal(e->error.place.field, CW_FIELD_DATA);
    assert_int_equal(e->error.place.index, bit - 19);
    assert_int_equal(e->tick, end_of(JOIN, loser ? mb.at[bit] : ma.at[bit]));
    assert_int_equal(e->tec, 8);
    assert_int_equal(rig_count(r, CW_EVENT_ARBITRATION_LOST, -1), 0);
    rig_free(r);
}

/* The very same frame from two nodes goes through as one. */
static void equal_frames_go_as_one(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    cw_frame f = rig_frame(0x123, 0, 8);
    rig_start(r);
    rig_send(r, 0, &f, 0);
    rig_send(r, 1, &f, 0);
    rig_run_bits(r, 500);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 2);
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->tick, rig_nth(r, CW_EVENT_TX, 1)->tick);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 2), 1);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
    rig_free(r);
}

/* Frames tell whose they are and since when, for those who sent and those who received them. */
static void frames_tell_where_they_are_from(void **state)
{
    (void)state;
    rig *r = rig_new(4);
    cw_frame f = rig_frame(0x123, 0, 2);
    cw_frame own = rig_frame(0x200, 0, 0);
    r->nodes[3].modes = CW_MODE_LOOPBACK;
    rig_start(r);
    rig_send(r, 1, &f, 100);
    rig_send(r, 0, &f, 300);
    rig_send(r, 3, &own, 50);
    rig_run_bits(r, 300);
    for (size_t i = 0; i < r->count; i++) {
        const cw_event *e = &r->events[i];
        if (e->nodes == NODE(3)) {
            assert_int_equal(e->from, NODE(3));
            assert_int_equal(e->handed_in, 50);
        } else if (e->kind == CW_EVENT_RX) { /* the same frame of both */
            assert_int_equal(e->from, NODE(0) | NODE(1));
            assert_int_equal(e->handed_in, 100);
        } else {
            assert_int_equal(e->from, e->nodes);
            assert_int_equal(e->handed_in, e->nodes == NODE(0) ? 300 : 100);
        }
    }
    assert_int_equal(rig_count(r, CW_EVENT_RX, -1), 2);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 3);
    rig_free(r);
}

static int compare_wire(const void *a, const void *b)
{
    const cw_frame *fa = a;
    const cw_frame *fb = b;
    return strcmp(model_encode(fa).wire, model_encode(fb).wire);
}

static void sixty_four_nodes_drain_in_identifier_order(void **state)
{
    (void)state;
    cw_frame frames[CW_NODES_MAX];
    rig_random random = {4711};
    rig *r = rig_new(CW_NODES_MAX);
    rig_start(r);
    for (unsigned i = 0; i < CW_NODES_MAX; i++) {
        uint32_t id = i * 29u % 64u * 31u; /* distinct base identifiers, shuffled */
        frames[i] = rig_frame(id, 0, rig_below(&random, 9));
        if (i % 3 == 1) {
            frames[i].flags = EXTENDED;
            frames[i].id = (id / 62 * 62) << 18 | i; /* some share their prefix with a base one */
        }
        rig_send(r, i, &frames[i], 0);
    }
    rig_run_bits(r, 64 * 170);
    qsort(frames, CW_NODES_MAX, sizeof frames[0], compare_wire);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), CW_NODES_MAX);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
    uint64_t end = JOIN;
    for (unsigned i = 0; i < CW_NODES_MAX; i++) {
        const cw_event *tx = rig_nth(r, CW_EVENT_TX, i);
        assert_true(cw_frame_equal(&tx->frame, &frames[i]));
        end += model_encode(&frames[i]).length;
        assert_int_equal(tx->tick, end * BIT);
        end += INTERMISSION_BITS;
        assert_int_equal(rig_nth(r, CW_EVENT_RX, i)->tick, tx->tick - BIT);
    }
    assert_int_equal(rig_bus_stats(r).arbitration_lost, 64 * 63 / 2);
    rig_free(r);
}

/* ---- A lonely node: M5, R14, M8, M14 --------------------------------------------------------- */

static void a_lonely_node_becomes_passive_and_never_bus_off(void **state)
{
    (void)state;
    enum { ATTEMPTS = 5000 };
    rig *r = rig_new(1);
    cw_frame f = rig_frame(0x123, 0, 2);
    unsigned ack = model_encode(&f).length - ACK_FROM_END;
    uint64_t sof = JOIN;
    size_t error = 0;
    rig_start(r);
    rig_send(r, 0, &f, 0);
    rig_run_bits(r, (uint64_t)ATTEMPTS * 100);
    for (size_t i = 0; i < r->count && error < ATTEMPTS; i++) {
        const cw_event *e = &r->events[i];
        if (e->kind != CW_EVENT_ERROR)
            continue;
        error++;
        bool passive = error > 16;
        assert_int_equal(e->tick, end_of(sof, ack));
        assert_int_equal(e->error.type, CW_ERROR_ACK);
        assert_int_equal(e->error.place.field, CW_FIELD_ACK_SLOT);
        assert_int_equal(e->error.flag, passive ? CW_FLAG_PASSIVE : CW_FLAG_ACTIVE); /* R9 */
        assert_int_equal(e->tec, passive ? 128 : 8 * error);
        assert_int_equal(e->rec, 0);
        sof += ack + 1 + ERROR_FRAME_BITS + INTERMISSION_BITS;
        sof += error >= 16 ? SUSPEND_BITS : 0; /* passive from this error on (M8) */
    }
    assert_int_equal(error, ATTEMPTS);
    assert_int_equal(rig_count(r, CW_EVENT_STATE, 0), 2); /* warning, passive */
    assert_int_equal(rig_stats(r, 0).state, CW_STATE_ERROR_PASSIVE);
    assert_int_equal(rig_stats(r, 0).bus_off, 0);
    assert_int_equal(rig_stats(r, 0).tx_frames, 0);
    rig_free(r);
}

/* ---- Hand-in and queue ----------------------------------------------------------------------- */

static void overflow_is_dropped_at_the_tick_of_its_hand_in(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    cw_frame f = rig_frame(0x123, 0, 0);
    unsigned length = model_encode(&f).length;
    uint64_t end = end_of(JOIN, length - 1);
    r->nodes[0].queue = 2;
    rig_start(r);
    for (unsigned i = 0; i < 2; i++)
        rig_send(r, 0, &f, 0);
    rig_send(r, 0, &f, 3333);
    rig_send(r, 0, &f, end - 1); /* the first is still being sent */
    rig_send(r, 0, &f, end);     /* its place is free */
    rig_run_bits(r, 1000);
    assert_int_equal(rig_count(r, CW_EVENT_DROP, 0), 2);
    assert_int_equal(rig_nth(r, CW_EVENT_DROP, 0)->tick, 3333);
    assert_int_equal(rig_nth(r, CW_EVENT_DROP, 1)->tick, end - 1);
    assert_int_equal(rig_nth(r, CW_EVENT_DROP, 0)->why, CW_DROP_QUEUE_FULL);
    assert_int_equal(rig_stats(r, 0).dropped[CW_DROP_QUEUE_FULL], 2);
    assert_int_equal(rig_stats(r, 0).tx_frames, 3);
    rig_free(r);
}

/* Same frames, other order of the queue. The second goes first by priority once it is there. */
static void check_queue_order(cw_order order, const uint32_t *expected)
{
    static const uint32_t ids[] = {0x300, 0x200, 0x100, 0x200, 0x400};
    rig *r = rig_new(2);
    r->nodes[0].order = order;
    rig_start(r);
    for (unsigned i = 0; i < 5; i++) {
        cw_frame f = rig_frame(ids[i], 0, 1);
        f.data[0] = (uint8_t)i;
        rig_send(r, 0, &f, i == 4 ? 0 : (20 + i) * BIT); /* 400 is on the wire meanwhile */
    }
    rig_run_bits(r, 1000);
    for (unsigned i = 0; i < 5; i++)
        assert_int_equal(rig_nth(r, CW_EVENT_TX, i)->frame.id << 8 |
                             rig_nth(r, CW_EVENT_TX, i)->frame.data[0],
                         expected[i]);
    rig_free(r);
}

static size_t drops_of(rig *r, unsigned frames)
{
    const size_t before = rig_count(r, CW_EVENT_DROP, 0);
    const cw_frame frame = {.id = 0x123};
    for (unsigned i = 0; i < frames; i++)
        rig_send(r, 0, &frame, cw_bus_now(r->bus));
    rig_run_bits(r, 1);
    return rig_count(r, CW_EVENT_DROP, 0) - before;
}

/* As long as there is room for, whatever it was at first; a shorter one keeps what waits in it. */
static void a_queue_is_set_within_its_room(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    cw_settings settings = {.which = CW_SET_QUEUE, .queue = CW_QUEUE_MAX};
    r->nodes[0].queue_room = 100;
    rig_start(r);
    assert_int_equal(drops_of(r, 20), 4);
    assert_int_equal(cw_node_set(r->bus, 0, &settings), CW_INVALID);
    assert_int_equal(cw_node_set(r->bus, 1, &settings), CW_INVALID); /* there is none */
    settings.queue = 101;
    assert_int_equal(cw_node_set(r->bus, 0, &settings), CW_INVALID);
    settings.queue = 100;
    assert_int_equal(cw_node_set(r->bus, 0, &settings), CW_OK);
    assert_int_equal(drops_of(r, 90), 6);
    settings.queue = 10;
    assert_int_equal(cw_node_set(r->bus, 0, &settings), CW_OK);
    assert_int_equal(drops_of(r, 1), 1);
    rig_run_bits(r, 20000);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 100);
    rig_free(r);
}

static void queue_order_is_by_priority_or_fifo(void **state)
{
    (void)state;
    static const uint32_t priority[] = {0x40004, 0x10002, 0x20001, 0x20003, 0x30000};
    static const uint32_t fifo[] = {0x40004, 0x30000, 0x20001, 0x10002, 0x20003};
    check_queue_order(CW_ORDER_PRIORITY, priority);
    check_queue_order(CW_ORDER_FIFO, fifo);
}

static void bad_frames_are_counted_and_never_sent(void **state)
{
    (void)state;
    static const cw_frame bad[] = {{.id = 0x800}, {.id = 1, .dlc = 16}, {.flags = CW_FRAME_FD}};
    rig *r = rig_new(2);
    rig_start(r);
    for (unsigned i = 0; i < 3; i++)
        rig_send(r, 0, &bad[i], 5000 + i);
    rig_run_bits(r, 300);
    assert_int_equal(r->count, 3);
    for (unsigned i = 0; i < 3; i++) {
        assert_int_equal(rig_nth(r, CW_EVENT_DROP, i)->why, CW_DROP_BAD_FRAME);
        assert_int_equal(rig_nth(r, CW_EVENT_DROP, i)->tick, 5000 + i);
    }
    rig_free(r);
}

static void a_full_inbox_refuses_until_the_bus_has_gone_on(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    cw_frame f = rig_frame(0x123, 0, 0);
    r->config.inbox = 2;
    rig_start(r);
    assert_int_equal(cw_node_send(r->bus, 3, &f, 0), CW_INVALID);
    rig_send(r, 0, &f, 9000);
    rig_send(r, 1, &f, 7000);
    assert_int_equal(cw_bus_inbox_first(r->bus), 7000);
    assert_int_equal(cw_node_send(r->bus, 0, &f, 0), CW_FULL);
    assert_int_equal(cw_bus_pending(r->bus), 2);
    /* to the end of the bit that holds the tick, so that it has come up */
    rig_run(r, cw_bus_inbox_first(r->bus) + BIT);
    assert_int_equal(cw_bus_inbox_first(r->bus), 9000);
    rig_send(r, 0, &f, 0);
    rig_run_bits(r, 500);
    assert_int_equal(cw_bus_inbox_first(r->bus), CW_NEVER);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 3);
    rig_free(r);
}

/* What is on its way into the queue counts, too; a node that takes nothing has room for all. */
static void the_room_in_a_queue_is_known(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    cw_frame f = rig_frame(0x123, 0, 0);
    r->nodes[0].queue = 3;
    rig_start(r);
    assert_int_equal(cw_node_room(r->bus, 0), 3);
    assert_int_equal(cw_node_room(r->bus, 1), 16);
    assert_int_equal(cw_node_room(r->bus, 2), CW_QUEUE_MAX);
    rig_send(r, 0, &f, 0);
    rig_send(r, 0, &f, 100 * BIT);
    assert_int_equal(cw_node_room(r->bus, 0), 1);
    rig_send(r, 0, &f, 20 * BIT);
    assert_int_equal(cw_node_room(r->bus, 0), 0);
    rig_run_bits(r, 50);
    assert_int_equal(cw_node_room(r->bus, 0), 0);
    const cw_settings less = {.which = CW_SET_QUEUE, .queue = 1};
    assert_int_equal(cw_node_set(r->bus, 0, &less), CW_OK);
    assert_int_equal(cw_node_room(r->bus, 0), 0);
    assert_int_equal(cw_node_attach(r->bus, 0, false), CW_OK);
    assert_int_equal(cw_node_room(r->bus, 0), CW_QUEUE_MAX);
    assert_int_equal(cw_node_attach(r->bus, 0, true), CW_OK);
    rig_run_bits(r, 500);
    assert_int_equal(cw_node_room(r->bus, 0), 1);
    const cw_settings listens = {.which = CW_SET_MODES, .modes_mask = CW_MODE_LISTEN_ONLY,
                                 .modes = CW_MODE_LISTEN_ONLY};
    assert_int_equal(cw_node_set(r->bus, 0, &listens), CW_OK);
    assert_int_equal(cw_node_room(r->bus, 0), CW_QUEUE_MAX);
    rig_free(r);
}

/* It never comes up, and there is no place for another until its node is flushed. */
static void a_frame_for_never_holds_its_place(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    cw_frame f = rig_frame(0x123, 0, 0);
    r->config.inbox = 2;
    rig_start(r);
    rig_send(r, 0, &f, CW_NEVER);
    rig_send(r, 1, &f, 0);
    rig_run_bits(r, 500);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 1);
    assert_int_equal(cw_bus_inbox_first(r->bus), CW_NEVER);
    assert_int_equal(cw_bus_pending(r->bus), 1);
    rig_send(r, 1, &f, 0);
    assert_int_equal(cw_node_send(r->bus, 1, &f, 0), CW_FULL);
    rig_run_bits(r, 1000);
    assert_int_equal(cw_bus_pending(r->bus), 1);
    assert_int_equal(cw_node_flush(r->bus, 0), CW_OK);
    assert_int_equal(cw_bus_pending(r->bus), 0);
    rig_free(r);
}

/* b's frame has waited less than c's; brought forward they come in that order, at once or as much
 * earlier, and their delay counts from then. */
static void what_waits_in_the_inbox_is_brought_forward(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    cw_frame low = rig_frame(0x300, 0, 0), high = rig_frame(0x100, 0, 0);
    rig_start(r);
    rig_run_bits(r, 20);
    rig_send(r, 2, &low, 30 * BIT);
    rig_send(r, 1, &high, 40 * BIT);
    rig_send(r, 0, &high, 500 * BIT);
    rig_send(r, 0, &low, CW_NEVER);
    cw_bus_bring_forward(r->bus, 15 * BIT);
    assert_int_equal(cw_bus_inbox_first(r->bus), 20 * BIT);
    rig_run_bits(r, 400);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 2);
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->from, 1u << 2);
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->handed_in, 20 * BIT);
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 1)->handed_in, 25 * BIT);
    assert_int_equal(cw_bus_inbox_first(r->bus), 485 * BIT);
    cw_bus_bring_forward(r->bus, UINT64_MAX);
    assert_int_equal(cw_bus_inbox_first(r->bus), cw_bus_now(r->bus));
    rig_run_bits(r, 600);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 3);
    assert_int_equal(cw_bus_pending(r->bus), 1); /* the one for never */
    rig_free(r);
}

/* Though node 1's frame stands before node 0's, and node 2 restarts at that tick: both begin at
 * once, which node 1 in loopback does not hide. */
static void frames_brought_forward_come_with_a_restart(void **state)
{
    (void)state;
    rig *r = rig_new(4);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    r->nodes[1].modes = CW_MODE_LOOPBACK;
    r->rules[r->config.rule_count++] =
        (cw_rule){.name = "kill", .trigger = CW_TRIGGER_TIME, .time_begin = 50 * BIT,
                  .time_end = CW_NEVER, .probability = UINT64_MAX, .action = CW_ACTION_BUS_OFF,
                  .nodes = NODE(2)};
    rig_start(r);
    rig_send(r, 1, &frame, 1000 * BIT);
    rig_send(r, 0, &frame, 2000 * BIT);
    rig_run_bits(r, 100);
    assert_int_equal(cw_node_restart(r->bus, 2), CW_OK);
    cw_bus_bring_forward(r->bus, UINT64_MAX);
    rig_run_bits(r, 400);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 2);
    for (size_t i = 0; i < 2; i++)
        assert_int_equal(rig_nth(r, CW_EVENT_TX, i)->tick,
                         (100 + cw_frame_wire_bits(&frame)) * BIT);
    rig_free(r);
}

/* A node in loopback sends while another's frame, which is the longer one, is leapt over. */
static void nothing_happens_before_the_next_event(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    cw_frame longer = rig_frame(0x6C0, 0, 8), own = rig_frame(0x7C2, 0, 0);
    r->nodes[2].modes = CW_MODE_LOOPBACK | CW_MODE_PRESUME_ACK;
    rig_start(r);
    rig_send(r, 0, &longer, 0);
    rig_send(r, 2, &own, 23 * BIT);
    rig_run_by_next(r, 1000 * BIT);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 2);
    rig_free(r);
}

/* What canwire.h says of CW_FULL: advance to cw_bus_inbox_first(), call again. A tick that is the
 * end of a bit comes up there. */
static void a_hand_in_at_the_end_of_a_bit_comes_up_there(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    cw_frame f = rig_frame(0x123, 0, 0);
    r->config.inbox = 1;
    rig_start(r);
    rig_send(r, 0, &f, 20 * BIT);
    rig_run(r, cw_bus_inbox_first(r->bus));
    assert_int_equal(cw_bus_inbox_first(r->bus), CW_NEVER);
    rig_send(r, 1, &f, 20 * BIT);
    rig_free(r);
}

static void hand_in_before_now_counts_as_now(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    cw_frame f = rig_frame(0x123, 0, 0);
    rig_start(r);
    rig_run_bits(r, 100);
    rig_send(r, 0, &f, 5);
    rig_run_bits(r, 300);
    unsigned length = model_encode(&f).length;
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->tick, end_of(100, length - 1));
    assert_int_equal(rig_stats(r, 0).delay.max_ticks, (uint64_t)length * BIT);
    rig_free(r);
}

/* ---- One bus, many ways to advance it -------------------------------------------------------- */

#define MIXED_BITS 60000u

/* Everything at once: contention, flips, bus-off and restart, one-shot, listen-only, overflow. */
static rig *new_mixed_bus(uint16_t events)
{
    rig *r = rig_new(6);
    r->config.events = events;
    r->config.inbox = 1000;
    r->nodes[1].modes = CW_MODE_ONE_SHOT;
    r->nodes[2].modes = CW_MODE_LISTEN_ONLY;
    r->nodes[3].queue = 2;
    r->nodes[4].restart_ticks = 777777;
    rig_flip(r, "self", CW_FIELD_DLC, 3)->from = NODE(4);
    r->rules[0].at = NODE(4);
    rig_flip(r, "wire", CW_FIELD_CRC, 3)->every = 7;
    rig_flip(r, "last", CW_FIELD_EOF, 6)->probability = UINT64_MAX / 10;
    rig_flip(r, "one", CW_FIELD_DATA, 4)->probability = UINT64_MAX / 10;
    r->rules[3].at = NODE(5);
    rig_flip(r, "flag", CW_FIELD_ERROR_FLAG, 2)->every = 5;
    rig_start(r);
    rig_random random = {123};
    for (unsigned i = 0; i < 900; i++) {
        cw_frame f = rig_random_frame(&random);
        rig_send(r, rig_below(&random, 6), &f, rig_below(&random, MIXED_BITS * BIT));
    }
    return r;
}

static void the_smallest_event_ring_changes_nothing(void **state)
{
    (void)state;
    rig *large = new_mixed_bus(UINT16_MAX);
    rig *small = new_mixed_bus(1);
    unsigned stops = 0;
    rig_run_bits(large, MIXED_BITS);
    while (cw_bus_advance(small->bus, (uint64_t)MIXED_BITS * BIT) == CW_FULL) {
        cw_event event;
        uint64_t now = cw_bus_now(small->bus);
        stops++;
        assert_int_equal(cw_bus_advance(small->bus, (uint64_t)MIXED_BITS * BIT), CW_FULL);
        assert_int_equal(cw_bus_now(small->bus), now);
        assert_true(cw_bus_poll(small->bus, &event)); /* one by one; keep it as rig_poll() does */
        small->events = realloc(small->events, (small->count + 1) * sizeof event);
        assert_non_null(small->events);
        small->events[small->count++] = event;
        small->capacity = small->count;
    }
    rig_poll(small);
    assert_true(stops > 0);
    assert_true(rig_count(large, CW_EVENT_RESTART, 4) > 1);
    for (unsigned kind = 0; kind < CW_EVENT_COUNT; kind++)
        if (kind != CW_EVENT_LINK && kind != CW_EVENT_SKIP) /* the test has all else */
            assert_true(rig_count(large, (cw_event_kind)kind, -1) > 0);
    rig_assert_same_events(large, small);
    rig_free(large);
    rig_free(small);
}

static void chopped_time_changes_nothing(void **state)
{
    (void)state;
    static const uint64_t steps[] = {1, 97, BIT, 333, 12345, 1000 * BIT};
    rig *whole = new_mixed_bus(4096);
    rig_run_bits(whole, MIXED_BITS);
    for (size_t i = 0; i < sizeof steps / sizeof steps[0]; i++) {
        rig *r = new_mixed_bus(4096);
        uint64_t end = (uint64_t)(steps[i] == 1 ? MIXED_BITS / 20 : MIXED_BITS) * BIT;
        for (uint64_t tick = 0; tick < end; tick += steps[i]) {
            rig_run(r, tick);
            assert_in_range(cw_bus_now(r->bus), tick / BIT * BIT, tick);
        }
        rig_run_bits(r, MIXED_BITS);
        rig_assert_same_events(whole, r);
        assert_int_equal(rig_bus_stats(whole).busy_bits, rig_bus_stats(r).busy_bits);
        assert_int_equal(rig_bus_stats(whole).load_permille, rig_bus_stats(r).load_permille);
        rig_free(r);
    }
    rig_free(whole);
}

/* The order within one tick: faults, then nodes, then the kinds as they are enumerated. Drops are
 * of their hand-in tick. */
static void events_come_in_the_documented_order(void **state)
{
    (void)state;
    rig *r = new_mixed_bus(4096);
    rig_run_bits(r, MIXED_BITS);
    for (size_t i = 1; i < r->count; i++) {
        const cw_event *a = &r->events[i - 1];
        const cw_event *b = &r->events[i];
        assert_true(a->tick <= b->tick);
        if (a->tick != b->tick || a->kind == CW_EVENT_RX)
            continue; /* an RX of several nodes stands at its first */
        bool node_goes_on = (a->nodes & -a->nodes) < (b->nodes & -b->nodes);
        bool kind_goes_on = a->nodes == b->nodes && a->kind <= b->kind;
        assert_true(node_goes_on || kind_goes_on);
    }
    rig_free(r);
}

static void the_same_run_gives_the_same_events(void **state)
{
    (void)state;
    rig *a = new_mixed_bus(4096);
    rig *b = new_mixed_bus(4096);
    rig_run_bits(a, MIXED_BITS);
    rig_run_bits(b, MIXED_BITS);
    rig_assert_same_events(a, b);
    rig_free(a);
    rig_free(b);
}

/* Fault-free traffic without contention: next() is never later than the next event, and asking it
 * again and again gets through to each event within its bit. */
static void next_is_never_too_late(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    rig *whole = rig_new(3);
    rig_random random = {6};
    rig_start(r);
    rig_start(whole);
    for (unsigned i = 0; i < 500; i++) {
        cw_frame f = rig_random_frame(&random);
        uint64_t tick = i * 200ull * BIT + rig_below(&random, 20 * BIT);
        rig_send(r, i % 3, &f, tick);
        rig_send(whole, i % 3, &f, tick);
    }
    rig_run_bits(whole, 500 * 200);
    for (uint64_t next = cw_bus_next(r->bus); next != CW_NEVER; next = cw_bus_next(r->bus)) {
        size_t before = r->count;
        assert_true(next >= cw_bus_now(r->bus));
        uint64_t bit_end = (next + BIT - 1) / BIT * BIT;
        if (before < whole->count) /* at or before the event that comes next */
            assert_true(next <= whole->events[before].tick);
        rig_run(r, bit_end > cw_bus_now(r->bus) ? bit_end : cw_bus_now(r->bus) + BIT);
        for (size_t i = before; i < r->count; i++)
            assert_int_equal(r->events[i].tick, cw_bus_now(r->bus));
    }
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 500);
    rig_assert_same_events(whole, r);
    rig_free(r);
    rig_free(whole);
}

static void a_bus_at_rest_expects_nothing(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    rig_start(r);
    assert_int_equal(cw_bus_next(r->bus), CW_NEVER);
    rig_run(r, UINT64_C(1) << 60); /* 457 years at once */
    assert_int_equal(cw_bus_now(r->bus), (UINT64_C(1) << 60) / BIT * BIT);
    assert_int_equal(cw_bus_recessive_bits(r->bus), (UINT64_C(1) << 60) / BIT);
    assert_true(cw_bus_idle(r->bus));
    assert_int_equal(rig_bus_stats(r).load_permille, 0);
    rig_free(r);
}

/* ---- Idle time against plain controllers, bit by bit ----------------------------------------- */

/* A bus made of nothing but cw_mac: every bit is driven and sampled. Each node sends one frame
 * again and again, so that there is no queue to model. */
typedef struct plain_bus {
    cw_mac macs[3];
    uint64_t bits;
    char *text;
    size_t used;
} plain_bus;

#define PLAIN_TEXT_MAX 400000u

static void plain_note(plain_bus *p, unsigned node, const char *what)
{
    p->used += (size_t)snprintf(p->text + p->used, PLAIN_TEXT_MAX - p->used, "%llu %u %s %u/%u\n",
                                (unsigned long long)p->bits, node, what, cw_mac_tec(&p->macs[node]),
                                cw_mac_rec(&p->macs[node]));
    assert_in_range(p->used, 0, PLAIN_TEXT_MAX - 1);
}

static void plain_bit(plain_bus *p, unsigned nodes)
{
    bool wire = CW_RECESSIVE;
    cw_mac_report report;
    for (unsigned i = 0; i < nodes; i++)
        wire = cw_mac_drive(&p->macs[i]) && wire;
    p->bits++;
    for (unsigned i = 0; i < nodes; i++) {
        cw_mac_sample(&p->macs[i], wire, &report);
        if (report.what & CW_REPORT_ERROR)
            plain_note(p, i, "error");
        if (report.what & CW_REPORT_RX)
            plain_note(p, i, "rx");
        if (report.what & CW_REPORT_TX)
            plain_note(p, i, "tx");
        if (report.what & CW_REPORT_STATE)
            plain_note(p, i, "state");
    }
}

static void plain_note_event(plain_bus *p, const cw_event *e)
{
    if (e->kind != CW_EVENT_ERROR && e->kind != CW_EVENT_RX && e->kind != CW_EVENT_TX &&
        e->kind != CW_EVENT_STATE)
        return;
    for (unsigned i = 0; i < 3; i++)
        if (e->nodes >> i & 1u)
            p->used += (size_t)snprintf(p->text + p->used, PLAIN_TEXT_MAX - p->used,
                                        "%llu %u %s %u/%u\n", (unsigned long long)(e->tick / BIT),
                                        i, cw_event_name(e->kind), e->tec, e->rec);
}

/* Lone traffic with pauses, and a lonely passive node with its suspends: the bus skips, the plain
 * controllers do not. */
static void check_skipping(unsigned nodes, unsigned dlc)
{
    enum { FRAMES = 40, PAUSE = 211, RUN = FRAMES * PAUSE + 500 };
    char *texts[2] = {malloc(PLAIN_TEXT_MAX), malloc(PLAIN_TEXT_MAX)};
    plain_bus plain = {.text = texts[0]};
    plain_bus seen = {.text = texts[1]};
    rig *r = rig_new(nodes);
    cw_frame f = rig_frame(0x123, 0, dlc);
    rig_start(r);
    for (unsigned i = 0; i < FRAMES; i++)
        rig_send(r, 0, &f, (uint64_t)i * PAUSE * BIT);
    rig_run_bits(r, RUN);
    for (unsigned i = 0; i < nodes; i++)
        cw_mac_init(&plain.macs[i], 0, 96);
    for (unsigned bit = 0, frame = 0; bit < RUN; bit++) {
        if (frame < FRAMES && bit >= frame * PAUSE && !plain.macs[0].offered) {
            assert_int_equal(cw_mac_offer(&plain.macs[0], &f), CW_OK);
            frame++;
        }
        plain_bit(&plain, nodes);
    }
    for (size_t i = 0; i < r->count; i++)
        plain_note_event(&seen, &r->events[i]);
    assert_string_equal(seen.text, plain.text);
    rig_free(r);
    free(texts[0]);
    free(texts[1]);
}

static void skipping_idle_bits_changes_nothing(void **state)
{
    (void)state;
    for (unsigned dlc = 0; dlc <= 8; dlc++)
        check_skipping(2, dlc);
    check_skipping(3, 5);
    check_skipping(1, 1); /* lonely: passive, with suspend */
}

/* ---- Bus-off and restart: R10, R12 ----------------------------------------------------------- */

/* Node 0 is made bus-off by what it samples itself; two others are there. */
static rig *new_failing_node(uint64_t restart_ticks)
{
    rig *r = rig_new(3);
    r->nodes[0].restart_ticks = restart_ticks;
    r->nodes[1].queue = 256;
    rig_flip(r, "own", CW_FIELD_R0, 0)->from = NODE(0);
    r->rules[0].at = NODE(0);
    r->rules[0].count = 32;
    rig_start(r);
    return r;
}

/* Until the node is bus-off; returns the tick. */
static uint64_t run_to_bus_off(rig *r)
{
    cw_frame f = rig_frame(0x123, 0, 1);
    rig_send(r, 0, &f, cw_bus_now(r->bus));
    rig_send(r, 0, &f, cw_bus_now(r->bus));
    while (rig_stats(r, 0).state != CW_STATE_BUS_OFF) {
        assert_in_range(cw_bus_now(r->bus), 0, 4000 * BIT);
        rig_run(r, cw_bus_now(r->bus) + BIT);
    }
    return cw_bus_now(r->bus);
}

/* And time ends with the last whole bit. */
static void an_idle_bus_goes_to_the_end_of_time(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    rig_start(r);
    rig_run_bits(r, 200);
    rig_run(r, CW_NEVER);
    assert_int_equal(cw_bus_now(r->bus), CW_NEVER / BIT * BIT);
    assert_int_equal(rig_bus_stats(r).bits, CW_NEVER / BIT);
    rig_free(r);
}

static void restart_by_hand_takes_128_groups(void **state)
{
    (void)state;
    rig *r = new_failing_node(0);
    cw_frame f = rig_frame(0x123, 0, 1);
    assert_int_equal(cw_node_restart(r->bus, 0), CW_REFUSED); /* not bus-off */
    assert_int_equal(cw_node_restart(r->bus, 3), CW_INVALID);
    uint64_t off = run_to_bus_off(r);
    assert_int_equal(rig_stats(r, 0).tec, 256);
    rig_run(r, off + 5000 * BIT);
    assert_int_equal(rig_stats(r, 0).state, CW_STATE_BUS_OFF); /* never by itself */
    rig_send(r, 0, &f, off + 4999 * BIT);
    rig_run(r, off + 5001 * BIT);
    assert_int_equal(rig_stats(r, 0).dropped[CW_DROP_BUS_OFF], 1); /* at once */
    assert_int_equal(cw_node_restart(r->bus, 0), CW_OK);
    assert_int_equal(cw_node_restart(r->bus, 0), CW_REFUSED); /* under way */
    uint64_t request = cw_bus_now(r->bus);
    rig_run(r, request + RECOVERY_BITS * BIT - BIT);
    assert_int_equal(rig_nth(r, CW_EVENT_RESTART, 0)->tick, request);
    assert_int_equal(rig_stats(r, 0).dropped[CW_DROP_BUS_OFF], 3); /* the two that waited */
    assert_int_equal(rig_stats(r, 0).state, CW_STATE_BUS_OFF);
    assert_int_equal(cw_node_restart(r->bus, 0), CW_REFUSED);
    rig_run(r, request + RECOVERY_BITS * BIT);
    assert_int_equal(rig_stats(r, 0).state, CW_STATE_ERROR_ACTIVE);
    assert_int_equal(rig_stats(r, 0).tec, 0);
    assert_int_equal(rig_stats(r, 0).restarts, 1);
    assert_int_equal(cw_node_restart(r->bus, 0), CW_REFUSED);
    rig_send(r, 0, &f, cw_bus_now(r->bus)); /* back at once, no further integration */
    uint64_t sof = cw_bus_now(r->bus) / BIT;
    rig_run(r, cw_bus_now(r->bus) + 200 * BIT);
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->tick,
                     end_of(sof, model_encode(&f).length - 1));
    rig_free(r);
}

static void restart_ms_runs_from_bus_off(void **state)
{
    (void)state;
    static const struct {
        uint64_t ticks;
        uint64_t bits; /* from bus-off to the request: the first end of a bit not before */
    } cases[] = {{1, 1}, {BIT, 1}, {BIT + 1, 2}, {1000 * BIT, 1000}, {999 * BIT + 80, 1000}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        rig *r = new_failing_node(cases[i].ticks);
        uint64_t off = run_to_bus_off(r);
        assert_int_equal(cw_node_restart(r->bus, 0), CW_REFUSED); /* it restarts by itself */
        rig_run(r, off + 4000 * BIT);
        uint64_t request = off + cases[i].bits * BIT;
        assert_int_equal(rig_nth(r, CW_EVENT_RESTART, 0)->tick, request);
        const cw_event *back = rig_nth(r, CW_EVENT_STATE, rig_count(r, CW_EVENT_STATE, -1) - 1);
        assert_int_equal(back->state, CW_STATE_ERROR_ACTIVE);
        assert_int_equal(back->state_before, CW_STATE_BUS_OFF);
        /* node 1 ends its error frame meanwhile: groups count when the wire is recessive */
        assert_in_range(back->tick, request + RECOVERY_BITS * BIT,
                        request + (RECOVERY_BITS + 14) * BIT);
        rig_free(r);
    }
}

/* Frames that come with a restart, at the end of a bit in which others come, have come up by then:
 * nodes act in their order at that end, whatever came to other nodes before it. */
static void frames_come_up_beside_a_restart(void **state)
{
    (void)state;
    rig *r = new_failing_node(1000 * BIT);
    cw_frame f = rig_frame(0x123, 0, 1);
    uint64_t request = run_to_bus_off(r) + 1000 * BIT;
    rig_send(r, 2, &f, request - BIT / 2);
    rig_send(r, 1, &f, request);
    rig_run(r, request);
    assert_int_equal(rig_nth(r, CW_EVENT_RESTART, 0)->tick, request);
    assert_int_equal(cw_bus_inbox_first(r->bus), CW_NEVER);
    rig_free(r);
}

/* R12: between two frames that follow each other lie exactly eleven recessive bits, from the ACK
 * delimiter to the end of intermission: one group a frame. */
static void recovery_under_full_load_takes_128_frames(void **state)
{
    (void)state;
    enum { FRAMES = 140 };
    rig *r = new_failing_node(2000 * BIT);
    uint64_t request = run_to_bus_off(r) + 2000 * BIT;
    cw_frame f = rig_frame(0x555, 0, 0);
    uint64_t period = (model_encode(&f).length + INTERMISSION_BITS) * BIT;
    for (unsigned i = 0; i < FRAMES; i++)
        rig_send(r, 1, &f, request);
    rig_run(r, request + (FRAMES + 1) * period);
    assert_int_equal(rig_nth(r, CW_EVENT_RESTART, 0)->tick, request);
    const cw_event *back = rig_nth(r, CW_EVENT_STATE, rig_count(r, CW_EVENT_STATE, -1) - 1);
    assert_int_equal(back->nodes, NODE(0));
    assert_int_equal(back->state, CW_STATE_ERROR_ACTIVE);
    assert_int_equal(back->tick, request + 128 * period);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 0), FRAMES - 128);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 2), FRAMES);
    rig_free(r);
}

/* ---- Modes: M11, M13, M14, M15 --------------------------------------------------------------- */

static void one_shot_gives_up_after_one_attempt(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    cw_frame high = rig_frame(0x100, 0, 0);
    cw_frame low = rig_frame(0x101, 0, 0);
    r->nodes[1].modes = CW_MODE_ONE_SHOT;
    rig_flip(r, "crc", CW_FIELD_CRC, 0)->from = NODE(1);
    rig_start(r);
    rig_send(r, 0, &high, 0);
    rig_send(r, 1, &low, 0);         /* loses */
    rig_send(r, 1, &low, 1000 * BIT); /* is disturbed */
    rig_run_bits(r, 2000);
    const cw_event *lost = rig_nth(r, CW_EVENT_DROP, 0);
    const cw_event *disturbed = rig_nth(r, CW_EVENT_DROP, 1);
    assert_int_equal(lost->why, CW_DROP_ONE_SHOT);
    assert_int_equal(lost->tick, rig_nth(r, CW_EVENT_ARBITRATION_LOST, 0)->tick);
    assert_int_equal(disturbed->why, CW_DROP_ONE_SHOT);
    assert_int_equal(disturbed->tick, rig_nth(r, CW_EVENT_ERROR, 0)->tick);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 1);
    assert_int_equal(rig_stats(r, 1).tec, 8); /* counters as usual */
    assert_int_equal(rig_stats(r, 1).queue, 0);
    rig_free(r);
}

static void listen_only_hears_all_and_drives_nothing(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    cw_frame f = rig_frame(0x123, 0, 2);
    r->nodes[2].modes = CW_MODE_LISTEN_ONLY;
    rig_flip(r, "there", CW_FIELD_DATA, 3)->at = NODE(2);
    r->rules[0].count = 1;
    rig_start(r);
    rig_send(r, 0, &f, 0); /* the listener samples a bit wrong: its flag stays inside it */
    rig_send(r, 0, &f, 200 * BIT);
    rig_send(r, 2, &f, 0);
    rig_run_bits(r, 1000);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 2);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 2);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 2), 1);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, 0) + rig_count(r, CW_EVENT_ERROR, 1), 0);
    assert_true(rig_count(r, CW_EVENT_ERROR, 2) > 0);
    assert_int_equal(rig_nth(r, CW_EVENT_DROP, 0)->why, CW_DROP_LISTEN_ONLY);
    assert_int_equal(rig_stats(r, 2).rec, 0); /* M11: counters do not move */
    assert_int_equal(rig_stats(r, 2).tec, 0);
    rig_free(r);
}

/* The sender stays without ACK. It spoils its own frame by an active flag in the ACK delimiter;
 * once it is passive its flag is recessive, and the listener, seeing an ACK, takes the frame. */
static void a_listener_does_not_acknowledge(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    cw_frame f = rig_frame(0x123, 0, 2);
    r->nodes[1].modes = CW_MODE_LISTEN_ONLY;
    rig_start(r);
    rig_send(r, 0, &f, 0);
    rig_run_bits(r, 5000);
    size_t attempts = rig_stats(r, 0).errors[CW_ERROR_ACK];
    assert_true(attempts > 40);
    assert_int_equal(rig_stats(r, 0).tec, 128);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 0);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 1), attempts - 16);
    rig_free(r);
}

static void presume_ack_needs_nobody(void **state)
{
    (void)state;
    rig *r = rig_new(1);
    cw_frame f = rig_frame(0x123, 0, 2);
    r->nodes[0].modes = CW_MODE_PRESUME_ACK;
    rig_start(r);
    rig_send(r, 0, &f, 0);
    rig_run_bits(r, 500);
    assert_int_equal(r->count, 1);
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->tick, end_of(JOIN, model_encode(&f).length - 1));
    rig_free(r);
}

static void loopback_keeps_to_itself(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    cw_frame own = rig_frame(0x7FF, 0, 8);
    cw_frame foreign = rig_frame(0x100, 0, 8);
    r->nodes[0].modes = CW_MODE_LOOPBACK;
    rig_start(r);
    rig_send(r, 0, &own, 0);
    rig_run_bits(r, 60);
    assert_int_equal(cw_bus_recessive_bits(r->bus), 60); /* nothing on the wire */
    rig_send(r, 1, &foreign, 0);
    rig_run_bits(r, 500);
    uint64_t end = end_of(JOIN, model_encode(&own).length - 1);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 0), 1); /* its own, not the foreign one */
    for (size_t i = 0; i < r->count; i++)
        if (r->events[i].nodes == NODE(0))
            assert_int_equal(r->events[i].tick,
                             r->events[i].kind == CW_EVENT_TX ? end : end - BIT);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 2), 1); /* the foreign one */
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
    assert_int_equal(rig_bus_stats(r).undetected_errors, 0);
    rig_free(r);
}

/* ---- Flips ----------------------------------------------------------------------------------- */

typedef struct flip_case {
    cw_field field;
    unsigned index;
    int plain; /* unstuffed bit of the frame, or */
    int wire;  /* wire bit, or -1: never */
} flip_case;

/* Where the rule hits a frame for the first time; observed at a listener, so that nothing follows
 * from it. */
static void check_position(const cw_frame *f, const flip_case *c)
{
    model m = model_encode(f);
    int bit = c->plain >= 0 ? (int)m.at[c->plain] : c->wire;
    rig *r = rig_new(3);
    r->nodes[2].modes = CW_MODE_LISTEN_ONLY;
    rig_flip(r, "there", c->field, c->index)->at = NODE(2);
    rig_start(r);
    rig_send(r, 0, f, 0);
    rig_run_bits(r, 300);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
    assert_int_equal(rig_count(r, CW_EVENT_FAULT, -1), bit >= 0);
    if (bit >= 0)
        assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 0)->tick, end_of(JOIN, (unsigned)bit));
    rig_free(r);
}

/* 000#0000 has stuff bits from the first run on; its fields are at known unstuffed bits. */
static void positions_of_a_base_frame(void **state)
{
    (void)state;
    static const flip_case cases[] = {
        {CW_FIELD_SOF, 0, 0, 0},     {CW_FIELD_SOF, 1, -1, -1},   {CW_FIELD_ID, 0, 1, 0},
        {CW_FIELD_ID, 10, 11, 0},    {CW_FIELD_ID, 11, -1, -1},   {CW_FIELD_RTR, 0, 12, 0},
        {CW_FIELD_SRR, 0, -1, -1},   {CW_FIELD_IDE, 0, 13, 0},    {CW_FIELD_R0, 0, 14, 0},
        {CW_FIELD_R1, 0, -1, -1},    {CW_FIELD_DLC, 0, 15, 0},    {CW_FIELD_DLC, 3, 18, 0},
        {CW_FIELD_DATA, 0, 19, 0},   {CW_FIELD_DATA, 15, 34, 0},  {CW_FIELD_DATA, 16, -1, -1},
        {CW_FIELD_CRC, 0, 35, 0},    {CW_FIELD_CRC, 14, 49, 0},   {CW_FIELD_STUFF, 0, -1, 5},
        {CW_FIELD_BIT, 0, -1, 0},    {CW_FIELD_BIT, 5, -1, 5},    {CW_FIELD_BIT, 40, -1, 40},
        {CW_FIELD_STUFF, 30, -1, -1}, {CW_FIELD_BIT, 200, -1, -1},
    };
    cw_frame f = {.dlc = 2};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        check_position(&f, &cases[i]);
}

static void positions_of_an_extended_frame(void **state)
{
    (void)state;
    static const flip_case cases[] = {
        {CW_FIELD_ID, 0, 1, 0},    {CW_FIELD_ID, 10, 11, 0}, {CW_FIELD_SRR, 0, 12, 0},
        {CW_FIELD_IDE, 0, 13, 0},  {CW_FIELD_ID, 11, 14, 0}, {CW_FIELD_ID, 28, 31, 0},
        {CW_FIELD_RTR, 0, 32, 0},  {CW_FIELD_R1, 0, 33, 0},  {CW_FIELD_R0, 0, 34, 0},
        {CW_FIELD_DLC, 0, 35, 0},  {CW_FIELD_DATA, 0, 39, 0}, {CW_FIELD_DATA, 63, 102, 0},
        {CW_FIELD_CRC, 0, 103, 0}, {CW_FIELD_CRC, 14, 117, 0},
    };
    cw_frame f = rig_frame(0x1F00FF00, EXTENDED, 8);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        check_position(&f, &cases[i]);
}

/* The end of a frame is at known bits from its end. */
static void positions_behind_the_crc(void **state)
{
    (void)state;
    cw_frame f = rig_frame(0x123, 0, 5);
    int length = (int)model_encode(&f).length;
    const flip_case cases[] = {
        {CW_FIELD_CRC_DELIMITER, 0, -1, length - 10}, {CW_FIELD_ACK_SLOT, 0, -1, length - 9},
        {CW_FIELD_ACK_DELIMITER, 0, -1, length - 8},  {CW_FIELD_EOF, 0, -1, length - 7},
        {CW_FIELD_EOF, 6, -1, length - 1},            {CW_FIELD_BIT, (unsigned)length - 1, -1,
                                                       length - 1},
        {CW_FIELD_INTERMISSION, 0, -1, length},       {CW_FIELD_INTERMISSION, 2, -1, length + 2},
        {CW_FIELD_EOF, 7, -1, -1},                    {CW_FIELD_INTERMISSION, 3, -1, -1},
        {CW_FIELD_SUSPEND, 0, -1, -1},                {CW_FIELD_ERROR_FLAG, 0, -1, -1},
        {CW_FIELD_OVERLOAD_FLAG, 0, -1, -1},          {CW_FIELD_ERROR_DELIMITER, 0, -1, -1},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        check_position(&f, &cases[i]);
}

/* Every stuff bit of a frame, by number: it is the N-th, and no other field's. */
static void positions_of_stuff_bits(void **state)
{
    (void)state;
    cw_frame f = {.dlc = 4};
    model m = model_encode(&f);
    unsigned stuff = 0;
    for (unsigned i = 0; m.plain[i]; i++) {
        unsigned next = m.plain[i + 1] ? m.at[i + 1] : m.stuffed;
        if (next == m.at[i] + 1)
            continue;
        flip_case c = {CW_FIELD_STUFF, stuff++, -1, (int)m.at[i] + 1};
        check_position(&f, &c);
    }
    assert_true(stuff > 5);
    check_position(&f, &(flip_case){CW_FIELD_STUFF, stuff, -1, -1});
}

/* The first error frame of the wire: a flip of r0 at the transmitter ends the attempt there. Its
 * flag of six bits starts at the next; the receivers' follows, for they see a stuff error. */
static void positions_in_error_frames(void **state)
{
    (void)state;
    cw_frame f = rig_frame(0x123, 0, 1);
    unsigned r0 = model_encode(&f).at[14];
    static const struct {
        cw_field field;
        unsigned index;
        unsigned after; /* the wire bit of r0 */
    } cases[] = {
        {CW_FIELD_ERROR_FLAG, 0, 1},  {CW_FIELD_ERROR_FLAG, 5, 6},
        {CW_FIELD_ERROR_DELIMITER, 0, 0}, {CW_FIELD_ERROR_DELIMITER, 7, 7},
        {CW_FIELD_INTERMISSION, 0, 8}, {CW_FIELD_INTERMISSION, 2, 10},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        rig *r = rig_new(3);
        r->nodes[2].modes = CW_MODE_LISTEN_ONLY;
        rig_flip(r, "first", CW_FIELD_R0, 0)->at = NODE(0);
        r->rules[0].count = 1;
        rig_flip(r, "second", cases[i].field, cases[i].index)->at = NODE(2);
        rig_start(r);
        rig_send(r, 0, &f, 0);
        rig_run_bits(r, 500);
        /* r0 and IDE, RTR are dominant: the receivers reach six equal bits in the flag */
        model m = model_encode(&f);
        unsigned run = 1;
        while (m.wire[r0 - run] == '0')
            run++;
        unsigned receivers = r0 + 6 - run; /* their error; the flag is the six bits after it */
        unsigned delimiter = receivers + 6 + 1;
        bool in_flag = cases[i].field == CW_FIELD_ERROR_FLAG;
        unsigned bit = (in_flag ? r0 : delimiter) + cases[i].after;
        assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 1)->tick, end_of(JOIN, bit));
        rig_free(r);
    }
}

/* A message doubled (M7): receivers answer `d` in the last EOF bit with an overload flag, and the
 * transmitter with an error flag. */
static void positions_in_overload_and_suspend(void **state)
{
    (void)state;
    cw_frame f = rig_frame(0x123, 0, 1);
    unsigned length = model_encode(&f).length;
    for (unsigned index = 0; index < 6; index++) {
        rig *r = rig_new(3);
        r->nodes[2].modes = CW_MODE_LISTEN_ONLY;
        rig_flip(r, "first", CW_FIELD_EOF, 6)->count = 1;
        rig_flip(r, "second", CW_FIELD_OVERLOAD_FLAG, index)->at = NODE(2);
        rig_start(r);
        rig_send(r, 0, &f, 0);
        rig_run_bits(r, 500);
        assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 1)->tick, end_of(JOIN, length + index));
        rig_free(r);
    }
    rig *r = rig_new(1); /* lonely, so passive after 16 errors */
    rig_flip(r, "suspend", CW_FIELD_SUSPEND, 7)->at = NODE(0);
    r->rules[0].count = 1;
    rig_start(r);
    rig_send(r, 0, &f, 0);
    rig_run_bits(r, 3000);
    unsigned attempt = length - ACK_FROM_END + 1 + ERROR_FRAME_BITS + INTERMISSION_BITS;
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 0)->tick, end_of(JOIN + 16 * attempt, 7));
    rig_free(r);
}

/* Frames with a listener that a rule acts at: hits and nothing else happens. */
static rig *new_observed_bus(unsigned rules)
{
    static const char *const names[] = {"a", "b", "c"};
    rig *r = rig_new(3);
    r->nodes[0].queue = 256;
    r->nodes[2].modes = CW_MODE_LISTEN_ONLY;
    for (unsigned i = 0; i < rules; i++)
        rig_flip(r, names[i], CW_FIELD_BIT, 20)->at = NODE(2);
    return r;
}

#define OBSERVED_FRAMES 200u
#define OBSERVED_PAUSE 200u

/* One character a frame: '1' where the rule hit. */
static void hit_pattern(char *pattern, rig *r, unsigned rule)
{
    memset(pattern, '0', OBSERVED_FRAMES);
    pattern[OBSERVED_FRAMES] = '\0';
    for (size_t i = 0; i < r->count; i++)
        if (r->events[i].kind == CW_EVENT_FAULT && r->events[i].rule == rule)
            pattern[r->events[i].tick / (OBSERVED_PAUSE * BIT)] = '1';
}

static void run_observed(rig *r)
{
    rig_start(r);
    for (unsigned i = 0; i < OBSERVED_FRAMES; i++) {
        cw_frame f = rig_frame(0x100 + i % 4, 0, 1);
        rig_send(r, 0, &f, (uint64_t)i * OBSERVED_PAUSE * BIT);
    }
    rig_run_bits(r, OBSERVED_FRAMES * OBSERVED_PAUSE);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), OBSERVED_FRAMES);
}

typedef struct choice {
    uint32_t skip;
    uint32_t every;
    uint32_t count;
    const char *pattern; /* of the first frames; behind them '0' when count is not 0 */
} choice;

static void matches_are_chosen_by_skip_every_and_count(void **state)
{
    (void)state;
    static const choice cases[] = {
        {0, 1, 0, "11111111111111"}, {3, 1, 0, "00011111111111"}, {0, 4, 0, "10001000100010"},
        {2, 3, 0, "00100100100100"}, {0, 1, 3, "11100000000000"}, {3, 4, 2, "00010001000000"},
        {0, 0, 1, "10000000000000"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char pattern[OBSERVED_FRAMES + 1];
        cw_rule_stats stats;
        rig *r = new_observed_bus(1);
        r->rules[0].skip = cases[i].skip;
        r->rules[0].every = cases[i].every;
        r->rules[0].count = cases[i].count;
        run_observed(r);
        hit_pattern(pattern, r, 0);
        assert_memory_equal(pattern, cases[i].pattern, strlen(cases[i].pattern));
        assert_int_equal(cw_rule_get_stats(r->bus, 0, &stats), CW_OK);
        assert_int_equal(stats.hits, rig_count(r, CW_EVENT_FAULT, -1));
        assert_int_equal(rig_nth(r, CW_EVENT_FAULT, stats.hits - 1)->hit, stats.hits);
        if (cases[i].count)
            assert_int_equal(stats.hits, cases[i].count);
        else
            assert_int_equal(stats.matches, OBSERVED_FRAMES);
        rig_free(r);
    }
}

/* Filter, sender, time: half open, at the start of the bit. */
static void matches_need_frame_sender_and_time(void **state)
{
    (void)state;
    char pattern[OBSERVED_FRAMES + 1];
    rig *r = new_observed_bus(3);
    r->rules[0].filters[0] = (cw_filter){.value = 0x101, .mask = 0x7FF};
    r->rules[0].filter_count = 1;
    r->rules[1].from = NODE(1);
    /* the 20th bit of the third frame starts at 400 + 20, that of the fifth at 800 + 20 */
    r->rules[2].time_begin = 420 * BIT;
    r->rules[2].time_end = 820 * BIT;
    run_observed(r);
    hit_pattern(pattern, r, 0);
    assert_memory_equal(pattern, "0100010001000100", 16);
    hit_pattern(pattern, r, 1);
    assert_null(strchr(pattern, '1'));
    hit_pattern(pattern, r, 2);
    assert_memory_equal(pattern, "0011000000", 10);
    assert_null(strchr(pattern + 10, '1'));
    rig_free(r);
}

static void an_inverted_filter_and_a_second_one(void **state)
{
    (void)state;
    char pattern[OBSERVED_FRAMES + 1];
    rig *r = new_observed_bus(2);
    r->rules[0].filters[0] = (cw_filter){.value = 0x101, .mask = 0x7FF, .inverted = true};
    r->rules[0].filter_count = 1;
    r->rules[1].filters[0] = (cw_filter){.value = 0x101, .mask = 0x7FF};
    r->rules[1].filters[1] = (cw_filter){.value = 0x103, .mask = 0x7FF};
    r->rules[1].filter_count = 2;
    run_observed(r);
    hit_pattern(pattern, r, 0);
    assert_memory_equal(pattern, "10111011", 8);
    hit_pattern(pattern, r, 1);
    assert_memory_equal(pattern, "01010101", 8);
    rig_free(r);
}

/* Each rule draws from its own stream: another rule, before or behind it, changes nothing. */
static void random_streams_of_rules_are_independent(void **state)
{
    (void)state;
    char alone[OBSERVED_FRAMES + 1];
    char beside[OBSERVED_FRAMES + 1];
    char other[OBSERVED_FRAMES + 1];
    rig *r = new_observed_bus(1);
    r->rules[0].name = "b";
    r->rules[0].probability = UINT64_C(1) << 63;
    run_observed(r);
    hit_pattern(alone, r, 0);
    assert_in_range(rig_count(r, CW_EVENT_FAULT, -1), 70, 130); /* about half */
    rig_free(r);
    r = new_observed_bus(3);
    for (unsigned i = 0; i < 3; i++)
        r->rules[i].probability = UINT64_C(1) << 63;
    run_observed(r);
    hit_pattern(beside, r, 1);
    hit_pattern(other, r, 0);
    assert_string_equal(alone, beside);
    assert_string_not_equal(alone, other);
    rig_free(r);
    r = new_observed_bus(2);
    r->rules[1].probability = UINT64_C(1) << 63;
    r->config.seed = 2;
    run_observed(r);
    hit_pattern(other, r, 1);
    assert_string_not_equal(alone, other);
    rig_free(r);
}

/* The same draws on every machine and in every release: splitmix64, by its published values. */
static void the_generator_is_splitmix64(void **state)
{
    (void)state;
    cw_prng prng = {.state = 0};
    assert_true(cw_prng_next(&prng) == UINT64_C(0xE220A8397B1DCDAF));
    assert_true(cw_prng_next(&prng) == UINT64_C(0x6E789E6AA1B965F4));
    assert_true(cw_prng_next(&prng) == UINT64_C(0x06C45D188009454F));
}

static uint64_t first_draw(uint64_t seed, const char *name)
{
    cw_prng prng;
    cw_prng_init(&prng, seed, name);
    return cw_prng_next(&prng);
}

/* Every byte of the name counts, up to the documented number. */
static void a_stream_is_that_of_seed_and_name(void **state)
{
    (void)state;
    char long_name[CW_RULE_NAME_MAX + 2];
    memset(long_name, 'x', sizeof long_name);
    long_name[CW_RULE_NAME_MAX + 1] = '\0';
    uint64_t draw = first_draw(1, long_name);
    long_name[CW_RULE_NAME_MAX] = 'y';
    assert_true(draw == first_draw(1, long_name));
    long_name[CW_RULE_NAME_MAX - 1] = 'y';
    assert_true(draw != first_draw(1, long_name));
    assert_true(first_draw(1, "ab") != first_draw(1, "ba"));
    assert_true(first_draw(1, "ab") != first_draw(2, "ab"));
    assert_true(first_draw(0, "") != first_draw(0, "a"));
}

/* Drawn only for matches that skip and every let through. */
static void probability_is_drawn_last(void **state)
{
    (void)state;
    char all[OBSERVED_FRAMES + 1];
    char some[OBSERVED_FRAMES + 1];
    rig *r = new_observed_bus(1);
    r->rules[0].probability = UINT64_C(1) << 63;
    run_observed(r);
    hit_pattern(all, r, 0);
    rig_free(r);
    r = new_observed_bus(1);
    r->rules[0].probability = UINT64_C(1) << 63;
    r->rules[0].skip = 2;
    r->rules[0].every = 3;
    run_observed(r);
    hit_pattern(some, r, 0);
    for (unsigned i = 2, k = 0; i < OBSERVED_FRAMES; i += 3, k++)
        assert_int_equal(some[i], all[k]);
    rig_free(r);
}

static void two_flips_of_one_bit_cancel(void **state)
{
    (void)state;
    for (unsigned local = 0; local < 2; local++) {
        rig *r = rig_new(2);
        cw_frame f = rig_frame(0x123, 0, 1);
        rig_flip(r, "a", CW_FIELD_DATA, 3)->at = local ? NODE(1) : 0;
        rig_flip(r, "b", CW_FIELD_DATA, 3)->at = local ? NODE(1) : 0;
        rig_start(r);
        rig_send(r, 0, &f, 0);
        rig_run_bits(r, 300);
        assert_int_equal(rig_count(r, CW_EVENT_FAULT, -1), 2);
        assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
        rig_free(r);
    }
}

/* A wire flip and one at a node: that node alone sees the right level. */
static void a_flip_at_a_node_undoes_one_of_the_wire(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    cw_frame f = rig_frame(0x123, 0, 1);
    rig_flip(r, "wire", CW_FIELD_EOF, 2)->count = 1;
    rig_flip(r, "node", CW_FIELD_EOF, 2)->count = 1;
    r->rules[1].at = NODE(1);
    rig_start(r);
    rig_send(r, 0, &f, 0);
    rig_run_bits(r, 300);
    uint64_t bit = end_of(JOIN, model_encode(&f).length - 5);
    unsigned at_once = 0;
    for (size_t i = 0; i < r->count; i++)
        if (r->events[i].kind == CW_EVENT_ERROR && r->events[i].tick == bit)
            at_once |= (unsigned)r->events[i].nodes;
    assert_int_equal(at_once, NODE(0) | NODE(2));
    rig_free(r);
}

/* The first wrong bit is the receiver's last EOF bit and makes it send an overload flag (O1 c);
 * each further one is a bit of its flag sampled recessive: a bit error with REC +8 (R5). */
static void a_flip_of_many_bits(void **state)
{
    (void)state;
    for (unsigned bits = 1; bits <= 9; bits++) {
        rig *r = rig_new(3);
        cw_frame f = rig_frame(0x123, 0, 1);
        rig_flip(r, "wire", CW_FIELD_EOF, 6)->bits = (uint16_t)bits;
        r->rules[0].at = NODE(1);
        rig_start(r);
        rig_send(r, 0, &f, 0);
        rig_run_bits(r, 400);
        assert_int_equal(rig_count(r, CW_EVENT_FAULT, -1), 1); /* one hit, however many bits */
        assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
        assert_int_equal(rig_count(r, CW_EVENT_ERROR, 1), bits - 1);
        assert_int_equal(rig_stats(r, 1).rec, 8 * (bits - 1));
        rig_free(r);
    }
}

/* A node that lost arbitration transmits no more: a rule for its later bits does not match. */
static void a_rule_ends_with_lost_arbitration(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    cw_frame high = rig_frame(0x100, 0, 1);
    cw_frame low = rig_frame(0x101, 0, 1);
    r->nodes[2].modes = CW_MODE_LISTEN_ONLY;
    rig_flip(r, "low", CW_FIELD_DATA, 0)->from = NODE(1);
    r->rules[0].at = NODE(2);
    rig_start(r);
    rig_send(r, 0, &high, 0);
    rig_send(r, 1, &low, 0);
    rig_run_bits(r, 300);
    uint64_t sof = JOIN + model_encode(&high).length + INTERMISSION_BITS;
    assert_int_equal(rig_count(r, CW_EVENT_FAULT, -1), 1);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 0)->tick, end_of(sof, model_encode(&low).at[19]));
    rig_free(r);
}

/* ---- Undetected errors ----------------------------------------------------------------------- */

/* A flip at a receiver that an error frame answers is no undetected error. */
static void a_detected_error_is_not_counted_as_undetected(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    cw_frame f = rig_frame(0x123, 0, 8);
    rig_flip(r, "one", CW_FIELD_DATA, 9)->at = NODE(1);
    r->rules[0].count = 3;
    rig_start(r);
    rig_send(r, 0, &f, 0);
    rig_run_bits(r, 2000);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
    assert_int_equal(rig_bus_stats(r).undetected_errors, 0);
    rig_free(r);
}

/* ---- Configuration --------------------------------------------------------------------------- */

static void configurations_out_of_range_are_refused(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    const cw_bus_config good = r->config;
    cw_bus_config bad[5] = {good, good, good, good, good};
    bad[0].bit_ticks = 0;
    bad[1].node_count = 0;
    bad[2].node_count = CW_NODES_MAX + 1;
    bad[3].inbox = 0;
    bad[4].rule_count = CW_RULES_MAX + 1;
    assert_true(cw_bus_size(&good) > 0);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        assert_int_equal(cw_bus_size(&bad[i]), 0);
        assert_null(cw_bus_init(NULL, &bad[i]));
    }
    static const cw_node_config nodes[] = {
        {.queue = 0, .warning_limit = 96}, {.queue = CW_QUEUE_MAX + 1, .warning_limit = 96},
        {.queue = 1, .warning_limit = 0},  {.queue = 1, .warning_limit = 256},
        {.queue = 1, .queue_room = CW_QUEUE_MAX + 1, .warning_limit = 96},
    };
    for (size_t i = 0; i < sizeof nodes / sizeof nodes[0]; i++) {
        r->nodes[1] = nodes[i];
        assert_int_equal(cw_bus_size(&good), 0);
    }
    static const cw_node_config edges[] = {
        {.queue = 1, .warning_limit = 1},
        {.queue = CW_QUEUE_MAX, .queue_room = CW_QUEUE_MAX, .warning_limit = 255},
    };
    for (size_t i = 0; i < sizeof edges / sizeof edges[0]; i++) {
        r->nodes[1] = edges[i];
        assert_true(cw_bus_size(&good) > 0);
    }
    rig_free(r);
}

/* ---- Work ------------------------------------------------------------------------------------ */

/* Each call does a bit at least, and little more than was allowed. */
static void an_advance_stops_after_some_work(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 8);
    rig_start(r);
    cw_bus_set_stepping(r->bus, true);
    rig_send(r, 0, &frame, 0);
    const uint64_t end = 1000 * (uint64_t)BIT;
    uint64_t calls = 0;
    for (;; calls++) {
        uint64_t now = cw_bus_now(r->bus);
        uint64_t work = cw_bus_work(r->bus);
        cw_status status = cw_bus_advance_some(r->bus, end, calls % 7);
        assert_in_range(cw_bus_work(r->bus) - work, 1, 7 + 8);
        assert_true(cw_bus_now(r->bus) > now);
        rig_poll(r);
        if (status == CW_OK)
            break;
        assert_int_equal(status, CW_AGAIN);
    }
    assert_in_range(calls, 200, 1000);
    assert_int_equal(cw_bus_now(r->bus), end);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
    assert_int_equal(cw_bus_advance_some(r->bus, end, 1), CW_OK); /* nothing is left to be done */
    rig_free(r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_advance_stops_after_some_work),
        cmocka_unit_test(first_sof_comes_after_eleven_bits),
        cmocka_unit_test(frames_follow_after_three_bits),
        cmocka_unit_test(a_frame_joins_a_foreign_sof),
        cmocka_unit_test(the_most_urgent_frame_goes_at_each_start),
        cmocka_unit_test(every_pairing_is_won_by_the_dominant_bit),
        cmocka_unit_test(same_identifier_with_other_data_is_a_bit_error),
        cmocka_unit_test(equal_frames_go_as_one),
        cmocka_unit_test(frames_tell_where_they_are_from),
        cmocka_unit_test(sixty_four_nodes_drain_in_identifier_order),
        cmocka_unit_test(a_lonely_node_becomes_passive_and_never_bus_off),
        cmocka_unit_test(overflow_is_dropped_at_the_tick_of_its_hand_in),
        cmocka_unit_test(a_queue_is_set_within_its_room),
        cmocka_unit_test(queue_order_is_by_priority_or_fifo),
        cmocka_unit_test(bad_frames_are_counted_and_never_sent),
        cmocka_unit_test(a_full_inbox_refuses_until_the_bus_has_gone_on),
        cmocka_unit_test(the_room_in_a_queue_is_known),
        cmocka_unit_test(what_waits_in_the_inbox_is_brought_forward),
        cmocka_unit_test(frames_brought_forward_come_with_a_restart),
        cmocka_unit_test(nothing_happens_before_the_next_event),
        cmocka_unit_test(a_frame_for_never_holds_its_place),
        cmocka_unit_test(a_hand_in_at_the_end_of_a_bit_comes_up_there),
        cmocka_unit_test(hand_in_before_now_counts_as_now),
        cmocka_unit_test(the_smallest_event_ring_changes_nothing),
        cmocka_unit_test(chopped_time_changes_nothing),
        cmocka_unit_test(events_come_in_the_documented_order),
        cmocka_unit_test(the_same_run_gives_the_same_events),
        cmocka_unit_test(next_is_never_too_late),
        cmocka_unit_test(a_bus_at_rest_expects_nothing),
        cmocka_unit_test(skipping_idle_bits_changes_nothing),
        cmocka_unit_test(an_idle_bus_goes_to_the_end_of_time),
        cmocka_unit_test(restart_by_hand_takes_128_groups),
        cmocka_unit_test(restart_ms_runs_from_bus_off),
        cmocka_unit_test(frames_come_up_beside_a_restart),
        cmocka_unit_test(recovery_under_full_load_takes_128_frames),
        cmocka_unit_test(one_shot_gives_up_after_one_attempt),
        cmocka_unit_test(listen_only_hears_all_and_drives_nothing),
        cmocka_unit_test(a_listener_does_not_acknowledge),
        cmocka_unit_test(presume_ack_needs_nobody),
        cmocka_unit_test(loopback_keeps_to_itself),
        cmocka_unit_test(positions_of_a_base_frame),
        cmocka_unit_test(positions_of_an_extended_frame),
        cmocka_unit_test(positions_behind_the_crc),
        cmocka_unit_test(positions_of_stuff_bits),
        cmocka_unit_test(positions_in_error_frames),
        cmocka_unit_test(positions_in_overload_and_suspend),
        cmocka_unit_test(matches_are_chosen_by_skip_every_and_count),
        cmocka_unit_test(matches_need_frame_sender_and_time),
        cmocka_unit_test(an_inverted_filter_and_a_second_one),
        cmocka_unit_test(random_streams_of_rules_are_independent),
        cmocka_unit_test(the_generator_is_splitmix64),
        cmocka_unit_test(a_stream_is_that_of_seed_and_name),
        cmocka_unit_test(probability_is_drawn_last),
        cmocka_unit_test(two_flips_of_one_bit_cancel),
        cmocka_unit_test(a_flip_at_a_node_undoes_one_of_the_wire),
        cmocka_unit_test(a_flip_of_many_bits),
        cmocka_unit_test(a_rule_ends_with_lost_arbitration),
        cmocka_unit_test(a_detected_error_is_not_counted_as_undetected),
        cmocka_unit_test(configurations_out_of_range_are_refused),
    };
    return cmocka_run_group_tests_name("bus", tests, NULL, NULL);
}
