/* SPDX-License-Identifier: MIT
 *
 * test_contest.c - arbitration: who wins the bus, and what the others see of it.
 */
#include "cases.h"
#include "model.h"
#include "times.h"

#define REMOTE CW_FRAME_REMOTE

/* Returns the first bit in which two texts differ; both reach that far. */
static unsigned first_difference(const char *a, const char *b)
{
    unsigned n = 0;
    while (a[n] == b[n])
        n++;
    return n;
}

/* Checks two frames that start together: their bits alone decide the loser, the bit and the
 * time. */
static void check_pair(const cw_frame *a, const cw_frame *b)
{
    const model models[2] = {model_encode(a), model_encode(b)};
    const cw_frame *frames[2] = {a, b};
    unsigned bit = first_difference(models[0].plain, models[1].plain);
    unsigned loser = models[0].plain[bit] == '1' ? 0 : 1;
    unsigned winner = 1 - loser;
    RIG *r = rig_new(3);
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
TEST(every_pairing_is_won_by_the_dominant_bit)
{
    cw_frame frames[PAIR_FRAMES];
    unsigned n = make_contenders(frames);
    assert_int_equal(n, PAIR_FRAMES);
    for (unsigned a = 0; a < n; a++)
        for (unsigned b = 0; b < n; b++)
            if (a != b)
                check_pair(&frames[a], &frames[b]);
}

/* M4: both win arbitration; the node that sends `r` at the first bit that differs has an error. */
TEST(same_identifier_with_other_data_is_a_bit_error)
{
    RIG *r = rig_new(3);
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
}

/* The very same frame from two nodes goes through as one. */
TEST(equal_frames_go_as_one)
{
    RIG *r = rig_new(3);
    cw_frame f = rig_frame(0x123, 0, 8);
    rig_start(r);
    rig_send(r, 0, &f, 0);
    rig_send(r, 1, &f, 0);
    rig_run_bits(r, 500);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 2);
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->tick, rig_nth(r, CW_EVENT_TX, 1)->tick);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 2), 1);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
}

/* Frames carry their sender and their hand-in time, for senders and receivers. */
TEST(frames_tell_where_they_are_from)
{
    RIG *r = rig_new(4);
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
}

/* A rule that makes node 0 error-passive before the first frame. */
static void make_passive(rig *r)
{
    cw_rule *rule = rig_flip(r, "passive", CW_FIELD_NONE, 0);
    rule->action = CW_ACTION_COUNTERS;
    rule->trigger = CW_TRIGGER_TIME;
    rule->bits = 0;
    rule->nodes = NODE(0);
    rule->tec = 130;
    rule->rec = CW_KEEP;
}

/* An error ends the arbitration for node 0. Its passive flag lasts to the end of the frame of
 * node 1, which is not from it. */
TEST(a_node_that_an_error_stops_in_the_arbitration_is_no_sender)
{
    for (unsigned stepping = 0; stepping < 2; stepping++) {
        RIG *r = rig_new(3);
        const cw_frame first = rig_frame(0x123, 0, 1), second = rig_frame(0x125, 0, 1);
        make_passive(r);
        cw_rule *flip = rig_flip(r, "stops", CW_FIELD_ID, 0);
        flip->at = NODE(0);
        flip->count = 1;
        rig_start(r);
        cw_bus_set_stepping(r->bus, stepping);
        rig_send(r, 0, &first, 100);
        rig_send(r, 1, &second, 300);
        rig_run_bits(r, 300);
        assert_int_equal(rig_nth(r, CW_EVENT_ERROR, 0)->nodes, NODE(0));
        assert_int_equal(rig_nth(r, CW_EVENT_ERROR, 0)->error.flag, CW_FLAG_PASSIVE);
        const cw_event *rx = rig_nth(r, CW_EVENT_RX, 0);
        assert_true(cw_frame_equal(&rx->frame, &second));
        assert_int_equal(rx->nodes, NODE(2));
        assert_int_equal(rx->from, NODE(1));
        assert_int_equal(rx->handed_in, 300);
    }
}

/* Nobody acknowledges, so the passive flag of the sender begins at the ACK delimiter. The listener
 * gets the frame all the same, from that node. */
TEST(a_sender_with_a_passive_flag_behind_its_frame_is_its_sender)
{
    for (unsigned stepping = 0; stepping < 2; stepping++) {
        RIG *r = rig_new(2);
        const cw_frame f = rig_frame(0x123, 0, 1);
        make_passive(r);
        r->nodes[1].modes = CW_MODE_LISTEN_ONLY;
        rig_start(r);
        cw_bus_set_stepping(r->bus, stepping);
        rig_send(r, 0, &f, 100);
        rig_run_bits(r, 80);
        assert_int_equal(rig_nth(r, CW_EVENT_ERROR, 0)->error.type, CW_ERROR_ACK);
        const cw_event *rx = rig_nth(r, CW_EVENT_RX, 0);
        assert_true(rx->tick > rig_nth(r, CW_EVENT_ERROR, 0)->tick);
        assert_int_equal(rx->from, NODE(0));
        assert_int_equal(rx->handed_in, 100);
    }
}

static int compare_wire(const void *a, const void *b)
{
    const cw_frame *fa = a;
    const cw_frame *fb = b;
    return strcmp(model_encode(fa).wire, model_encode(fb).wire);
}

TEST(sixty_four_nodes_drain_in_identifier_order)
{
    cw_frame frames[CW_NODES_MAX];
    rig_random random = {4711};
    RIG *r = rig_new(CW_NODES_MAX);
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
}

/* The arbitrations that four nodes, and the bus, have lost. */
typedef struct losses {
    uint64_t of[5];
} losses;

/* Four nodes begin together, and no event reports the losses. One of them gets a more urgent frame
 * after some bits. Returns the statistics after more bits. */
static losses lost_so_far(bool stepping, unsigned node, unsigned urgent_after, unsigned read_after)
{
    static const uint32_t ids[4] = {0x400, 0x401, 0x420, 0x600};
    const cw_frame urgent = rig_frame(0x200, 0, 0);
    losses l;
    cw_bus_stats of_bus;
    RIG *r = rig_new(4);
    rig_start(r);
    cw_bus_set_stepping(r->bus, stepping);
    cw_bus_set_events(r->bus, ~(1u << CW_EVENT_ARBITRATION_LOST));
    for (unsigned i = 0; i < 4; i++) {
        const cw_frame frame = rig_frame(ids[i], 0, 0);
        rig_send(r, i, &frame, 0);
    }
    rig_run_bits(r, JOIN + urgent_after);
    rig_send(r, node, &urgent, cw_bus_now(r->bus));
    rig_run_bits(r, JOIN + read_after);
    cw_bus_get_stats(r->bus, &of_bus);
    for (unsigned i = 0; i < 4; i++)
        l.of[i] = rig_stats(r, i).arbitration_lost;
    l.of[4] = of_bus.arbitration_lost;
    return l;
}

/* Statistics within arbitration show the losses so far, by the frames that the nodes began with.
 * The bus runs there in one call. */
TEST(statistics_show_no_loss_beforehand)
{
    for (unsigned node = 0; node < 4; node++)
        for (unsigned urgent = 2; urgent < 16; urgent++)
            for (unsigned bits = urgent; bits < 40; bits++) {
                const losses fast = lost_so_far(false, node, urgent, bits);
                const losses reference = lost_so_far(true, node, urgent, bits);
                assert_memory_equal(&fast, &reference, sizeof fast);
                assert_int_equal(fast.of[4], /* there is one stuff bit */
                                 (bits > 2) + (bits > 6) + (bits > 12));
            }
}
