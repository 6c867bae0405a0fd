/* SPDX-License-Identifier: MIT
 *
 * test_bus.c - nodes on one wire: medium access, events, time, modes, undetected flips.
 */
#include "cases.h"
#include "model.h"
#include "rules.h"
#include "times.h"

#define SUSPEND_BITS 8u

/* ---- Medium access: M1, M9, M10 -------------------------------------------------------------- */

/* M10: eleven recessive bits, then SOF; a frame takes part in the first bit that starts at or after
 * its hand-in. */
TEST(first_sof_comes_after_eleven_bits)
{
    static const struct {
        uint64_t tick;
        unsigned sof;
    } cases[] = {{0, 11},        {1, 11},        {11 * BIT, 11},     {11 * BIT + 1, 12},
                 {12 * BIT, 12}, {50 * BIT, 50}, {50 * BIT + 159, 51}};
    cw_frame f = rig_frame(0x123, 0, 1);
    unsigned length = model_encode(&f).length;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        RIG *r = rig_new(2);
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
    }
}

/* M1, M6: the next SOF comes right after three bits of intermission. */
TEST(frames_follow_after_three_bits)
{
    RIG *r = rig_new(2);
    cw_frame f = rig_frame(0x123, 0, 3);
    unsigned length = model_encode(&f).length;
    rig_start(r);
    for (unsigned i = 0; i < 10; i++)
        rig_send(r, 0, &f, 0);
    rig_run_bits(r, 2000);
    for (unsigned i = 0; i < 10; i++)
        assert_int_equal(rig_nth(r, CW_EVENT_TX, i)->tick,
                         end_of(JOIN + i * (length + INTERMISSION_BITS), length - 1));
}

/* M1: a frame handed in during the SOF of another joins with its first identifier bit and can win;
 * one bit later it waits. */
TEST(a_frame_joins_a_foreign_sof)
{
    cw_frame low = rig_frame(0x400, 0, 0);
    cw_frame high = rig_frame(0x100, 0, 0);
    for (unsigned late = 0; late < 3; late++) {
        RIG *r = rig_new(3);
        rig_start(r);
        rig_send(r, 0, &low, 0);
        rig_send(r, 1, &high, JOIN * BIT + 1 + late * (BIT - 1)); /* 1 and 160: end of SOF, 319 */
        rig_run_bits(r, 300);
        bool joins = late < 2;
        assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->nodes, joins ? NODE(1) : NODE(0));
        assert_int_equal(rig_count(r, CW_EVENT_ARBITRATION_LOST, 0), joins);
        assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
        assert_int_equal(rig_bus_stats(r).frames, 2);
    }
}

/* M1: the choice is made at each start; a more urgent frame overtakes one that lost. */
TEST(the_most_urgent_frame_goes_at_each_start)
{
    RIG *r = rig_new(3);
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
}

/* ---- A lonely node: M5, R14, M8, M14 --------------------------------------------------------- */

TEST(a_lonely_node_becomes_passive_and_never_bus_off)
{
    enum { ATTEMPTS = 5000 };
    RIG *r = rig_new(1);
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
}

/* ---- What comes next ------------------------------------------------------------------------- */

/* A node in loopback sends while another's frame, which is the longer one, goes by in one step. */
TEST(nothing_happens_before_the_next_event)
{
    RIG *r = rig_new(3);
    cw_frame longer = rig_frame(0x6C0, 0, 8), own = rig_frame(0x7C2, 0, 0);
    r->nodes[2].modes = CW_MODE_LOOPBACK | CW_MODE_PRESUME_ACK;
    rig_start(r);
    rig_send(r, 0, &longer, 0);
    rig_send(r, 2, &own, 23 * BIT);
    rig_run_by_next(r, 1000 * BIT);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 2);
}

/* ---- One bus, many ways to advance it -------------------------------------------------------- */

#define MIXED_BITS 60000u

/* Makes a bus with everything at once: arbitration, flips, bus-off and restart, one-shot,
 * listen-only, overflow. */
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

TEST(the_smallest_event_ring_changes_nothing)
{
    RIG *large = new_mixed_bus(UINT16_MAX);
    RIG *small = new_mixed_bus(1);
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
        if ((CW_EVENTS_USUAL >> kind & 1u) && kind != CW_EVENT_LINK && kind != CW_EVENT_SKIP &&
            kind != CW_EVENT_EXCEPTION && kind != CW_EVENT_OVERRUN && kind != CW_EVENT_IMPROPER &&
            kind != CW_EVENT_WAKE)
            assert_true(rig_count(large, (cw_event_kind)kind, -1) > 0);
    rig_assert_same_events(large, small);
}

TEST(chopped_time_changes_nothing)
{
    static const uint64_t steps[] = {1, 97, BIT, 333, 12345, 1000 * BIT};
    RIG *whole = new_mixed_bus(4096);
    rig_run_bits(whole, MIXED_BITS);
    for (size_t i = 0; i < sizeof steps / sizeof steps[0]; i++) {
        RIG *r = new_mixed_bus(4096);
        uint64_t end = (uint64_t)(steps[i] == 1 ? MIXED_BITS / 20 : MIXED_BITS) * BIT;
        for (uint64_t tick = 0; tick < end; tick += steps[i]) {
            rig_run(r, tick);
            assert_in_range(cw_bus_now(r->bus), tick / BIT * BIT, tick);
        }
        rig_run_bits(r, MIXED_BITS);
        rig_assert_same_events(whole, r);
        assert_int_equal(rig_bus_stats(whole).busy_bits, rig_bus_stats(r).busy_bits);
        assert_int_equal(rig_bus_stats(whole).load_permille, rig_bus_stats(r).load_permille);
    }
}

/* The order within one tick: faults, then nodes, then the kinds as they are enumerated. Drops are
 * of their hand-in tick. */
TEST(events_come_in_the_documented_order)
{
    RIG *r = new_mixed_bus(4096);
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
}

TEST(the_same_run_gives_the_same_events)
{
    RIG *a = new_mixed_bus(4096);
    RIG *b = new_mixed_bus(4096);
    rig_run_bits(a, MIXED_BITS);
    rig_run_bits(b, MIXED_BITS);
    rig_assert_same_events(a, b);
}

/* Sends fault-free traffic without arbitration. next() is never later than the next event, and
 * repeated calls find each event within its bit. */
TEST(next_is_never_too_late)
{
    RIG *r = rig_new(3);
    RIG *whole = rig_new(3);
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
}

static bool is_wanted(const void *user, unsigned node, const cw_frame *frame)
{
    (void)user;
    return frame->id >= 0x200 && node != 2;
}

/* Frames are 44 bits long, more with stuff bits, and receivers have them before the last bit. */
TEST(receptions_of_some_frames_are_foretold)
{
    RIG *r = rig_new(3);
    rig_start(r);
    const cw_frame other = rig_frame(0x123, 0, 8), wanted = rig_frame(0x255, 0, 0);
    assert_int_equal(cw_bus_next_rx(r->bus, is_wanted, NULL), CW_NEVER);
    rig_send(r, 1, &other, 0);
    rig_send(r, 2, &wanted, 0); /* by a node that does not count */
    assert_int_equal(cw_bus_next_rx(r->bus, is_wanted, NULL), CW_NEVER);
    rig_send(r, 0, &wanted, 1000 * BIT);
    const uint64_t first = cw_bus_next_rx(r->bus, is_wanted, NULL);
    assert_in_range(first, 1040 * BIT, 1043 * BIT);
    rig_run_bits(r, 1001);
    const uint64_t bits = cw_frame_wire_bits(&wanted);
    assert_in_range(cw_bus_next_rx(r->bus, is_wanted, NULL), 1001 * BIT,
                    (1000 + bits - 1) * BIT);
    rig_run_bits(r, 1010);
    assert_int_equal(cw_bus_next_rx(r->bus, is_wanted, NULL), (1000 + bits - 1) * BIT);
    rig_run_bits(r, 2000);
    rig_send(r, 1, &other, 2000 * BIT);
    rig_send(r, 0, &wanted, 2010 * BIT); /* behind a frame on the wire */
    rig_run_bits(r, 2020);
    const uint64_t all = cw_frame_wire_bits(&other);
    assert_in_range(cw_bus_next_rx(r->bus, is_wanted, NULL), (2000 + all + bits - 4) * BIT,
                    (2000 + all + 3 + bits - 1) * BIT);
}

/* Receivers have a frame, though its sender has left it in EOF, with its queue. */
TEST(a_reception_is_foretold_without_its_sender)
{
    RIG *r = rig_new(3);
    rig_start(r);
    const cw_frame wanted = rig_frame(0x255, 0, 0);
    const uint64_t bits = cw_frame_wire_bits(&wanted);
    rig_send(r, 0, &wanted, 1000 * BIT);
    rig_run_bits(r, 1000 + bits - 4);
    assert_int_equal(cw_node_attach(r->bus, 0, false), CW_OK);
    rig_run_bits(r, 1000 + bits - 3);
    const uint64_t next = cw_bus_next_rx(r->bus, is_wanted, NULL);
    assert_in_range(next, (1000 + bits - 3) * BIT, (1000 + bits - 1) * BIT);
    rig_run_bits(r, 1000 + bits);
    assert_true(rig_count(r, CW_EVENT_RX, -1) > 0);
}

TEST(a_bus_at_rest_expects_nothing)
{
    RIG *r = rig_new(2);
    rig_start(r);
    assert_int_equal(cw_bus_next(r->bus), CW_NEVER);
    rig_run(r, UINT64_C(1) << 60); /* 457 years at once */
    assert_int_equal(cw_bus_now(r->bus), (UINT64_C(1) << 60) / BIT * BIT);
    assert_int_equal(cw_bus_recessive_bits(r->bus), (UINT64_C(1) << 60) / BIT);
    assert_true(cw_bus_idle(r->bus));
    assert_int_equal(rig_bus_stats(r).load_permille, 0);
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

/* Checks lone traffic with pauses, and a lonely passive node with its suspends: the bus skips, the
 * plain controllers do not. */
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

TEST(skipping_idle_bits_changes_nothing)
{
    for (unsigned dlc = 0; dlc <= 8; dlc++)
        check_skipping(2, dlc);
    check_skipping(3, 5);
    check_skipping(1, 1); /* lonely: passive, with suspend */
}

/* ---- At rest --------------------------------------------------------------------------------- */

/* And time ends with the last whole bit. */
TEST(an_idle_bus_goes_to_the_end_of_time)
{
    RIG *r = rig_new(2);
    rig_start(r);
    rig_run_bits(r, 200);
    rig_run(r, CW_NEVER);
    assert_int_equal(cw_bus_now(r->bus), CW_NEVER / BIT * BIT);
    assert_int_equal(rig_bus_stats(r).bits, CW_NEVER / BIT);
}

/* ---- Modes: M11, M13, M14, M15 --------------------------------------------------------------- */

TEST(one_shot_gives_up_after_one_attempt)
{
    RIG *r = rig_new(3);
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
}

TEST(listen_only_hears_all_and_drives_nothing)
{
    RIG *r = rig_new(3);
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
}

/* The sender gets no ACK. It spoils its own frame by an active flag in the ACK delimiter. Once it
 * is passive its flag is recessive, and the listener, seeing an ACK, takes the frame. */
TEST(a_listener_does_not_acknowledge)
{
    RIG *r = rig_new(2);
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
}

TEST(presume_ack_needs_nobody)
{
    RIG *r = rig_new(1);
    cw_frame f = rig_frame(0x123, 0, 2);
    r->nodes[0].modes = CW_MODE_PRESUME_ACK;
    rig_start(r);
    rig_send(r, 0, &f, 0);
    rig_run_bits(r, 500);
    assert_int_equal(r->count, 1);
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->tick, end_of(JOIN, model_encode(&f).length - 1));
}

TEST(loopback_keeps_to_itself)
{
    RIG *r = rig_new(3);
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
}

/* ---- Undetected errors ----------------------------------------------------------------------- */

/* A flip at a receiver that an error frame answers is no undetected error. */
TEST(a_detected_error_is_not_counted_as_undetected)
{
    RIG *r = rig_new(3);
    cw_frame f = rig_frame(0x123, 0, 8);
    rig_flip(r, "one", CW_FIELD_DATA, 9)->at = NODE(1);
    r->rules[0].count = 3;
    rig_start(r);
    rig_send(r, 0, &f, 0);
    rig_run_bits(r, 2000);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
    assert_int_equal(rig_bus_stats(r).undetected_errors, 0);
}

/* ---- Configuration --------------------------------------------------------------------------- */

TEST(configurations_out_of_range_are_refused)
{
    RIG *r = rig_new(2);
    const cw_bus_config good = r->config;
    cw_bus_config bad[5] = {good, good, good, good, good};
    bad[0].bit_ticks = 0;
    bad[1].node_count = 0;
    bad[2].node_count = CW_NODES_MAX + 1;
    bad[3].inbox = 0;
    bad[4].rule_count = CW_RULES_MAX + 1;
    assert_true(cw_bus_size(&good) > 0);
    assert_int_equal(cw_bus_check(&good).limit, CW_LIMIT_NONE);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        assert_int_equal(cw_bus_check(&bad[i]).limit, i < 4 ? CW_LIMIT_BUS : CW_LIMIT_RULES);
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
        assert_int_equal(cw_bus_check(&good).limit, CW_LIMIT_NODE);
        assert_int_equal(cw_bus_check(&good).node, 1);
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
}

TEST(clocks_and_ways_have_limits)
{
    const cw_span quantum = CW_TICK * 10; /* 16 of them are a bit of the bus */
    const cw_bit_timing bit = {.quantum = quantum, .prop_seg = 6, .phase_seg1 = 7,
                               .phase_seg2 = 2, .sjw = 1};
    const struct {
        cw_span quantum, tx_delay, place;
        cw_limit limit;
        cw_span is, allowed;
    } cases[] = {
        {quantum, 0, 0, CW_LIMIT_NONE, 0, 0},
        {-1, 0, 0, CW_LIMIT_TIMING, 0, 0},
        {quantum, -1, 0, CW_LIMIT_WAY, 0, 0},
        {quantum, 0, CW_DELAY_MAX + 1, CW_LIMIT_WAY, 0, 0},
        {quantum * 64, 0, 0, CW_LIMIT_NONE, 0, 0},
        {quantum * 64 + 1, 0, 0, CW_LIMIT_BIT_MOST, quantum * 1024 + 16, quantum * 1024},
        {quantum / 64, 0, 0, CW_LIMIT_NONE, 0, 0},
        {quantum / 64 - 1, 0, 0, CW_LIMIT_BIT_LEAST, quantum / 4 - 16, quantum / 4},
        {quantum, 256 * quantum, 0, CW_LIMIT_NONE, 0, 0},
        {quantum, 256 * quantum + 1, 0, CW_LIMIT_DELAY, 256 * quantum + 1, 256 * quantum},
        {quantum / 2, 128 * quantum + 1, 0, CW_LIMIT_DELAY, 128 * quantum + 1, 128 * quantum},
        {quantum, 255 * quantum, quantum + 1, CW_LIMIT_DELAY, 256 * quantum + 1, 256 * quantum},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        RIG *r = rig_new(3);
        r->nodes[1].timing.bit = bit;
        r->nodes[1].timing.bit.quantum = cases[i].quantum;
        r->nodes[1].timing.tx_delay[0] = cases[i].tx_delay;
        r->nodes[1].timing.place = cases[i].place;
        const cw_bus_finding found = cw_bus_check(&r->config);
        assert_int_equal(found.limit, cases[i].limit);
        assert_int_equal(cw_bus_size(&r->config) > 0, found.limit == CW_LIMIT_NONE);
        assert_int_equal(found.is, cases[i].is);
        assert_int_equal(found.allowed, cases[i].allowed);
        if (found.limit != CW_LIMIT_NONE)
            assert_int_equal(found.node, 1);
    }
}

/* ---- Work ------------------------------------------------------------------------------------ */

/* Each call does a bit at least, and little more than was allowed. */
TEST(an_advance_stops_after_some_work)
{
    RIG *r = rig_new(2);
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
}

/* ---- Time in which nothing happens ----------------------------------------------------------- */

/* Returns the work of a bus up to a distant second. A restart, a rule and a frame in the inbox are
 * pending, noise has ended, and a node is off. */
static uint64_t work_of_idle_seconds(uint64_t seconds)
{
    const uint64_t end = seconds * CW_CLOCK_HZ;
    RIG *r = rig_new(4);
    const cw_frame frame = rig_frame(0x123, 0, 8);
    r->nodes[1].restart_ticks = 2 * end;
    ADD_RULE(r, "down", TIME, BUS_OFF, .nodes = NODE(1), .time_begin = 10 * BIT);
    ADD_RULE(r, "noise", TIME, NOISE, .error_rate = UINT64_MAX / 2, .for_ticks = 100 * BIT);
    ADD_RULE(r, "late", TIME, BUS_OFF, .nodes = NODE(2), .time_begin = 2 * end);
    rig_start(r);
    rig_send(r, 0, &frame, 3000 * BIT);
    rig_send(r, 0, &frame, 2 * end);
    assert_int_equal(cw_node_attach(r->bus, 3, false), CW_OK);
    rig_run_bits(r, 50000);
    uint64_t before = cw_bus_work(r->bus);
    assert_int_equal(cw_bus_advance(r->bus, end), CW_OK);
    assert_true(cw_bus_now(r->bus) > end - BIT);
    cw_bus_stats stats;
    cw_bus_get_stats(r->bus, &stats);
    assert_int_equal(stats.bits, end / BIT);
    assert_int_equal(stats.load_permille, 0);
    uint64_t work = cw_bus_work(r->bus) - before;
    return work;
}

TEST(idle_time_costs_nothing)
{
    assert_in_range(work_of_idle_seconds(10), 1, 10);
    assert_int_equal(work_of_idle_seconds(10), work_of_idle_seconds(UINT64_C(100000000000)));
}

/* Polls the oldest event, which peeking has shown. */
static void poll_what_is_peeked_at(cw_bus *bus)
{
    const cw_event_row events = cw_bus_peek(bus);
    const cw_event *oldest = cw_event_at(&events, 0);
    cw_event polled;
    assert_true(events.count > 0);
    const uint64_t tick = oldest->tick, nodes = oldest->nodes;
    const cw_event_kind kind = oldest->kind;
    const uint32_t id = oldest->frame.id;
    assert_true(cw_bus_poll(bus, &polled));
    assert_true(polled.tick == tick && polled.kind == kind);
    assert_true(polled.nodes == nodes && polled.frame.id == id);
}

/* Each frame brings an RX and a TX. One event always stays behind, so that the ring wraps. */
TEST(events_are_seen_where_they_lie)
{
    RIG *r = rig_new(2);
    r->config.events = 1; /* the least that goes */
    rig_start(r);
    unsigned wraps = 0;
    assert_int_equal(cw_bus_peek(r->bus).count, 0);
    for (unsigned round = 0; round < 20000; round++) {
        const cw_frame frame = rig_frame(round % 0x700, 0, 2);
        rig_send(r, round % 2, &frame, 0);
        assert_int_equal(cw_bus_advance(r->bus, cw_bus_now(r->bus) + 100 * BIT), CW_OK);
        wraps += cw_bus_peek(r->bus).count < (round ? 3 : 2);
        poll_what_is_peeked_at(r->bus);
        if (round)
            poll_what_is_peeked_at(r->bus);
    }
    cw_bus_take(r->bus, cw_bus_peek(r->bus).count);
    assert_int_equal(cw_bus_peek(r->bus).count, 0);
    assert_true(wraps > 0);
}
