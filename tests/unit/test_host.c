/* SPDX-License-Identifier: MIT
 *
 * test_host.c - what hosts do: frames handed in, queues, restart, settings, nodes that leave.
 */
#include "cases.h"
#include "model.h"
#include "rules.h"
#include "times.h"

/* ---- Hand-in and queue ----------------------------------------------------------------------- */

TEST(overflow_is_dropped_at_the_tick_of_its_hand_in)
{
    RIG *r = rig_new(2);
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
}

/* Sends the same frames with another order of the queue. By priority the second one goes first. */
static void check_queue_order(cw_order order, const uint32_t *expected)
{
    static const uint32_t ids[] = {0x300, 0x200, 0x100, 0x200, 0x400};
    RIG *r = rig_new(2);
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
TEST(a_queue_is_set_within_its_room)
{
    RIG *r = rig_new(2);
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
}

TEST(queue_order_is_by_priority_or_fifo)
{
    static const uint32_t priority[] = {0x40004, 0x10002, 0x20001, 0x20003, 0x30000};
    static const uint32_t fifo[] = {0x40004, 0x30000, 0x20001, 0x10002, 0x20003};
    check_queue_order(CW_ORDER_PRIORITY, priority);
    check_queue_order(CW_ORDER_FIFO, fifo);
}

TEST(bad_frames_are_counted_and_never_sent)
{
    static const cw_frame bad[] = {{.id = 0x800}, {.id = 1, .dlc = 16}, {.flags = CW_FRAME_FD}};
    RIG *r = rig_new(2);
    rig_start(r);
    for (unsigned i = 0; i < 3; i++)
        rig_send(r, 0, &bad[i], 5000 + i);
    rig_run_bits(r, 300);
    assert_int_equal(r->count, 3);
    for (unsigned i = 0; i < 3; i++) {
        assert_int_equal(rig_nth(r, CW_EVENT_DROP, i)->why, CW_DROP_BAD_FRAME);
        assert_int_equal(rig_nth(r, CW_EVENT_DROP, i)->tick, 5000 + i);
    }
}

TEST(a_full_inbox_refuses_until_the_bus_has_gone_on)
{
    RIG *r = rig_new(3);
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
}

/* Frames on their way into the queue count, too; a node that takes no frames has room for all. */
TEST(the_room_in_a_queue_is_known)
{
    RIG *r = rig_new(2);
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
}

/* It never comes up, and there is no place for another until its node is flushed. */
TEST(a_frame_for_never_holds_its_place)
{
    RIG *r = rig_new(3);
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
}

/* b's frame has waited less than c's. After cw_bus_bring_forward() they come in that order, at once
 * or earlier by as much, and their delay counts from then. */
TEST(what_waits_in_the_inbox_is_brought_forward)
{
    RIG *r = rig_new(3);
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
}

/* Node 0's frames come in bus time: they stay where they are, and the others come before them. */
TEST(only_frames_of_some_nodes_are_brought_forward)
{
    RIG *r = rig_new(3);
    const cw_frame frames[3] = {rig_frame(0x300, 0, 0), rig_frame(0x100, 0, 0),
                                rig_frame(0x200, 0, 0)};
    rig_start(r);
    rig_run_bits(r, 20);
    rig_send(r, 0, &frames[0], 30 * BIT);
    rig_send(r, 0, &frames[1], 200 * BIT);
    rig_send(r, 1, &frames[2], 300 * BIT);
    rig_send(r, 2, &frames[2], 400 * BIT);
    cw_nodes_bring_forward(r->bus, NODE(1) | NODE(2), 290 * BIT);
    rig_run_bits(r, 500);
    static const unsigned senders[] = {1, 0, 2, 0};
    static const unsigned bits[] = {20, 30, 110, 200};
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 4);
    for (size_t i = 0; i < 4; i++) {
        assert_int_equal(rig_nth(r, CW_EVENT_TX, i)->from, NODE(senders[i]));
        assert_int_equal(rig_nth(r, CW_EVENT_TX, i)->handed_in, bits[i] * BIT);
    }
}

/* Node 1's frame stands before node 0's, and node 2 restarts at that tick. Still both begin at
 * once, which node 1 in loopback does not hide. */
TEST(frames_brought_forward_come_with_a_restart)
{
    RIG *r = rig_new(4);
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
}

/* Follows canwire.h about CW_FULL: advance to cw_bus_inbox_first(), call again. A tick at the end
 * of a bit leaves the inbox there. */
TEST(a_hand_in_at_the_end_of_a_bit_comes_up_there)
{
    RIG *r = rig_new(2);
    cw_frame f = rig_frame(0x123, 0, 0);
    r->config.inbox = 1;
    rig_start(r);
    rig_send(r, 0, &f, 20 * BIT);
    rig_run(r, cw_bus_inbox_first(r->bus));
    assert_int_equal(cw_bus_inbox_first(r->bus), CW_NEVER);
    rig_send(r, 1, &f, 20 * BIT);
}

TEST(hand_in_before_now_counts_as_now)
{
    RIG *r = rig_new(2);
    cw_frame f = rig_frame(0x123, 0, 0);
    rig_start(r);
    rig_run_bits(r, 100);
    rig_send(r, 0, &f, 5);
    rig_run_bits(r, 300);
    unsigned length = model_encode(&f).length;
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->tick, end_of(100, length - 1));
    assert_int_equal(rig_stats(r, 0).delay.max_ticks, (uint64_t)length * BIT);
}

/* ---- Bus-off and restart: R10, R12 ----------------------------------------------------------- */

/* Makes a bus whose node 0 becomes bus-off by its own samples; two others are present. */
static rig *new_failing_node(uint64_t restart_ticks)
{
    rig *r = rig_new(3);
    r->nodes[0].restart_ticks = restart_ticks;
    r->nodes[1].queue = 256;
    rig_flip(r, "own", CW_FIELD_R0, 0)->from = NODE(0);
    r->rules[0].at = NODE(0);
    r->rules[0].count = 32;
    r->config.rule_room = 1;
    rig_start(r);
    return r;
}

/* Runs until the node is bus-off; returns the tick. */
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

TEST(restart_by_hand_takes_128_groups)
{
    RIG *r = new_failing_node(0);
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
}

/* R12: frames handed in before the request are lost, also when they wait in the inbox for the very
 * tick of it. Later ones have their SOF right after group 128, whoever asked for the restart. */
TEST(frames_after_the_request_wait_for_group_128)
{
    enum { BY_HAND, BY_RULE, BY_SETTING, BY_TIME, WAYS };
    const cw_settings at_once = {.which = CW_SET_RESTART, .restart_ticks = BIT};
    for (unsigned way = 0; way < WAYS; way++) {
        RIG *r = new_failing_node(way == BY_TIME ? 5000 * BIT : 0);
        const cw_rule back = {.name = "back", .trigger = CW_TRIGGER_ARMED, .manual = true,
                              .time_end = CW_NEVER,
                              .probability = UINT64_MAX, .every = 1, .nodes = NODE(0),
                              .action = CW_ACTION_RESTART};
        const cw_frame before = rig_frame(0x100, 0, 1), after = rig_frame(0x200, 0, 2);
        const uint64_t request = run_to_bus_off(r) + 5000 * BIT;
        unsigned rule;
        assert_int_equal(cw_bus_add_rule(r->bus, &rule, &back), CW_OK);
        rig_run(r, request - BIT);
        rig_send(r, 0, &before, request - BIT);
        rig_send(r, 0, &before, request - BIT / 2);
        if (way == BY_TIME)
            rig_send(r, 0, &before, request);
        rig_run(r, request);
        if (way != BY_TIME)
            rig_send(r, 0, &before, request);
        if (way == BY_HAND)
            assert_int_equal(cw_node_restart(r->bus, 0), CW_OK);
        if (way == BY_SETTING)
            assert_int_equal(cw_node_set(r->bus, 0, &at_once), CW_OK);
        if (way == BY_RULE)
            assert_int_equal(cw_bus_fire_rule(r->bus, rule), CW_OK);
        assert_int_equal(cw_node_takes_frames(r->bus, 0), way != BY_RULE); /* it is to act yet */
        rig_send(r, 0, &after, request);
        rig_send(r, 0, &after, request + BIT / 2);
        rig_send(r, 0, &after, request + 1000 * BIT);
        rig_run(r, request + (RECOVERY_BITS - 1) * BIT);
        assert_int_equal(rig_nth(r, CW_EVENT_RESTART, 0)->tick, request);
        assert_int_equal(cw_node_room(r->bus, 0), 16 - 3 - (way == BY_RULE));
        const unsigned waited = 2; /* the frame that went bus-off, and one behind it */
        const unsigned lost = waited + 3 - (way == BY_RULE);
        assert_int_equal(rig_stats(r, 0).dropped[CW_DROP_BUS_OFF], lost);
        rig_run(r, request + (RECOVERY_BITS + 1000) * BIT);
        assert_int_equal(rig_stats(r, 0).dropped[CW_DROP_BUS_OFF], lost);
        const cw_event *sent = rig_nth(r, CW_EVENT_TX, 0);
        const cw_frame *first = way == BY_RULE ? &before : &after; /* rules act before frames */
        assert_int_equal(sent->frame.id, first->id);
        assert_int_equal(sent->tick, request + (RECOVERY_BITS + model_encode(first).length) * BIT);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 3 + (way == BY_RULE));
    }
}

/* They are the frames of a queue, with its limit. */
TEST(frames_that_wait_for_group_128_fill_the_queue)
{
    RIG *r = new_failing_node(0);
    const cw_frame f = rig_frame(0x123, 0, 1);
    const cw_settings short_one = {.which = CW_SET_QUEUE, .queue = 3};
    (void)run_to_bus_off(r);
    assert_int_equal(cw_node_set(r->bus, 0, &short_one), CW_OK);
    rig_run(r, cw_bus_now(r->bus) + 100 * BIT);
    assert_false(cw_node_takes_frames(r->bus, 0));
    assert_int_equal(cw_node_room(r->bus, 0), CW_QUEUE_MAX);
    assert_int_equal(cw_node_restart(r->bus, 0), CW_OK);
    rig_run(r, cw_bus_now(r->bus) + BIT);
    assert_int_equal(cw_node_room(r->bus, 0), 3);
    for (unsigned i = 0; i < 5; i++)
        rig_send(r, 0, &f, cw_bus_now(r->bus));
    rig_run(r, cw_bus_now(r->bus) + BIT);
    assert_int_equal(rig_stats(r, 0).dropped[CW_DROP_QUEUE_FULL], 2);
    const cw_settings listens = {.which = CW_SET_MODES, .modes_mask = CW_MODE_LISTEN_ONLY,
                                 .modes = CW_MODE_LISTEN_ONLY};
    assert_int_equal(cw_node_set(r->bus, 0, &listens), CW_OK);
    assert_int_equal(rig_stats(r, 0).dropped[CW_DROP_LISTEN_ONLY], 3);
}

TEST(restart_ms_runs_from_bus_off)
{
    static const struct {
        uint64_t ticks;
        uint64_t bits; /* from bus-off to the request: the first end of a bit not before */
    } cases[] = {{1, 1}, {BIT, 1}, {BIT + 1, 2}, {1000 * BIT, 1000}, {999 * BIT + 80, 1000}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        RIG *r = new_failing_node(cases[i].ticks);
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
    }
}

/* Frames that come with a restart, at the end of a bit in which others come, have left the inbox by
 * then. Nodes act in their order at that end, whatever came to other nodes before it. */
TEST(frames_come_up_beside_a_restart)
{
    RIG *r = new_failing_node(1000 * BIT);
    cw_frame f = rig_frame(0x123, 0, 1);
    uint64_t request = run_to_bus_off(r) + 1000 * BIT;
    rig_send(r, 2, &f, request - BIT / 2);
    rig_send(r, 1, &f, request);
    rig_run(r, request);
    assert_int_equal(rig_nth(r, CW_EVENT_RESTART, 0)->tick, request);
    assert_int_equal(cw_bus_inbox_first(r->bus), CW_NEVER);
}

/* R12: exactly eleven recessive bits lie between two consecutive frames, from the ACK delimiter to
 * the end of intermission. They are one group per frame. */
TEST(recovery_under_full_load_takes_128_frames)
{
    enum { FRAMES = 140 };
    RIG *r = new_failing_node(2000 * BIT);
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
}

/* ---- Settings -------------------------------------------------------------------------------- */

TEST(settings_are_changed_and_read)
{
    RIG *r = rig_new(2);
    cw_settings s;
    const cw_settings all = {.which = UINT8_MAX, .modes_mask = CW_MODE_ONE_SHOT,
                             .modes = CW_MODE_ONE_SHOT | CW_MODE_LISTEN_ONLY,
                             .order = CW_ORDER_FIFO, .queue = 3, .warning_limit = 50,
                             .restart_ticks = 1000,
                             .timing = {.quantum = CW_TICK * BIT / 20, .prop_seg = 8,
                                        .phase_seg1 = 6, .phase_seg2 = 5, .sjw = 4}};
    r->nodes[1].modes = CW_MODE_PRESUME_ACK;
    rig_start(r);
    assert_int_equal(cw_node_set(r->bus, 1, &all), CW_OK);
    assert_int_equal(cw_node_get_settings(r->bus, 1, &s), CW_OK);
    assert_int_equal(s.modes, CW_MODE_ONE_SHOT | CW_MODE_PRESUME_ACK); /* masked */
    assert_int_equal(s.order, CW_ORDER_FIFO);
    assert_int_equal(s.queue, 3);
    assert_int_equal(s.warning_limit, 50);
    assert_int_equal(s.restart_ticks, 1000);
    assert_int_equal(s.timing.quantum, CW_TICK * BIT / 20);
    assert_int_equal(s.timing.sjw, 4);
    assert_false(cw_bus_is_on_grid(r->bus)); /* the other node has another bit timing */
    const cw_settings none = {.which = 0, .queue = 0, .warning_limit = 0};
    assert_int_equal(cw_node_set(r->bus, 1, &none), CW_OK);
    const cw_settings bad[] = {{.which = CW_SET_QUEUE, .queue = 0},
                               {.which = CW_SET_QUEUE, .queue = 17},
                               {.which = CW_SET_WARNING, .warning_limit = 0},
                               {.which = CW_SET_WARNING, .warning_limit = 256},
                               {.which = CW_SET_ORDER | CW_SET_QUEUE, .queue = 17}};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        assert_int_equal(cw_node_set(r->bus, 1, &bad[i]), CW_INVALID);
    assert_int_equal(cw_node_set(r->bus, 2, &none), CW_INVALID);
    assert_int_equal(cw_node_get_settings(r->bus, 2, &s), CW_INVALID);
    assert_int_equal(cw_node_get_settings(r->bus, 1, &s), CW_OK);
    assert_int_equal(s.queue, 3);
    assert_int_equal(s.order, CW_ORDER_FIFO);
}

/* Frames beyond a smaller limit stay; a rule from the start may enlarge the queue. */
TEST(a_queue_limit_is_for_new_frames)
{
    RIG *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    r->nodes[0].queue = 2;
    ADD_RULE(r, "larger", TIME, SET, .nodes = NODE(0),
             .settings = (cw_settings){.which = CW_SET_QUEUE, .queue = 5}, .time_begin = 5 * BIT);
    rig_start(r);
    for (unsigned i = 0; i < 3; i++)
        rig_send(r, 0, &frame, 0);
    rig_run_bits(r, 4);
    assert_int_equal(rig_stats(r, 0).queue, 2);
    for (unsigned i = 0; i < 5; i++)
        rig_send(r, 0, &frame, 6 * BIT);
    rig_run_bits(r, 10);
    assert_int_equal(rig_stats(r, 0).queue, 5);
    assert_int_equal(rig_stats(r, 0).dropped[CW_DROP_QUEUE_FULL], 1 + 2);
    const cw_settings one = {.which = CW_SET_QUEUE, .queue = 1};
    assert_int_equal(cw_node_set(r->bus, 0, &one), CW_OK);
    rig_send(r, 0, &frame, 10 * BIT);
    rig_run_bits(r, 1000);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 5);
    assert_int_equal(rig_stats(r, 0).dropped[CW_DROP_QUEUE_FULL], 1 + 2 + 1);
}

/* ---- Nodes that leave ------------------------------------------------------------------------ */

/* All that a node holds is dropped and counted; it is not on the bus any more. */
TEST(a_flushed_node_is_gone)
{
    RIG *r = rig_new(3);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    ADD_RULE(r, "late", FRAME, DELAY, .for_ticks = 1000 * BIT, .count = 1);
    cw_rule *away = ADD_RULE(r, "away", TIME, DISCONNECT, .nodes = NODE(1));
    away->for_ticks = 100 * BIT; /* its end must not bring the flushed node back */
    rig_start(r);
    for (unsigned i = 0; i < 4; i++)
        rig_send(r, 2, &frame, i == 3 ? 500 * BIT : i); /* held, on the wire, waiting, to come */
    rig_send(r, 1, &frame, 600 * BIT);
    rig_run_bits(r, JOIN + 20);
    assert_int_equal(cw_node_flush(r->bus, 2), CW_OK);
    assert_int_equal(rig_stats(r, 2).dropped[CW_DROP_REMOVED], 4);
    assert_int_equal(rig_stats(r, 2).handed_in, 4);
    assert_int_equal(cw_bus_pending(r->bus), 1);
    rig_run_bits(r, 2000);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 0), 1);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 2), 0);
}

/* Neither its host nor a rule nor another bus brings it back; what it gets to send is dropped. */
TEST(a_flushed_node_stays_gone)
{
    static const uint8_t same[] = {0, 1, 2};
    RIG *r = rig_new(3);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    r->nodes[1].restart_ticks = 10 * BIT;
    ADD_RULE(r, "off", TIME, BUS_OFF, .nodes = NODE(1));
    ADD_RULE(r, "back", TIME, COUNTERS, .nodes = NODE(1), .time_begin = 100 * BIT);
    rig_start(r);
    rig_run_bits(r, 5);
    assert_int_equal(cw_node_flush(r->bus, 1), CW_OK);
    assert_false(cw_node_attached(r->bus, 1));
    assert_int_equal(cw_node_attach(r->bus, 1, false), CW_OK);
    assert_int_equal(cw_node_attach(r->bus, 1, true), CW_REFUSED);
    rig_send(r, 1, &frame, 50 * BIT);
    rig_send(r, 0, &frame, 200 * BIT);
    rig_run_bits(r, 1000);
    assert_int_equal(rig_stats(r, 1).dropped[CW_DROP_REMOVED], 1);
    assert_int_equal(rig_stats(r, 1).restarts, 0);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 0);
    RIG *next = rig_new(3);
    rig_start(next);
    assert_int_equal(cw_bus_take_over(next->bus, r->bus, same), CW_OK);
    rig_send(next, 0, &frame, 1000 * BIT);
    rig_run_bits(next, 2000);
    assert_int_equal(cw_node_attach(next->bus, 1, true), CW_REFUSED);
    assert_int_equal(rig_count(next, CW_EVENT_RX, 1), 0);
    assert_int_equal(rig_count(next, CW_EVENT_RX, 2), 1);
}
