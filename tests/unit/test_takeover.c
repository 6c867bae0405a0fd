/* SPDX-License-Identifier: MIT
 *
 * test_takeover.c - a bus that takes over from another one: what goes on, and what begins anew.
 */
#include "cases.h"
#include "rules.h"

#include "state/state.h"

/* Makes a bus of the same kind at tick 0. */
static rig *successor(unsigned nodes)
{
    rig *r = rig_new(nodes);
    r->config.rule_room = 4;
    return r;
}

/* However often the bus is exchanged, the trace is that of one. */
TEST(a_bus_that_takes_over_goes_on)
{
    static const uint8_t same[] = {0, 1, 2};
    rig_random random = {.state = 11};
    RIG *one = rig_new(3);
    RIG *now = rig_new(3);
    rig_start(one);
    rig_start(now);
    for (unsigned round = 0; round < 50; round++) {
        for (unsigned n = 0; n < 4; n++) {
            const cw_frame frame = rig_random_frame(&random);
            unsigned node = rig_below(&random, 3);
            uint64_t tick = cw_bus_now(one->bus) + rig_below(&random, 400 * BIT);
            rig_send(one, node, &frame, tick);
            rig_send(now, node, &frame, tick);
        }
        uint64_t until = cw_bus_now(one->bus) + rig_below(&random, 300) * BIT;
        rig_run(one, until);
        rig_run(now, until);
        RIG *next = rig_new(3);
        rig_start(next);
        assert_int_equal(cw_bus_take_over(next->bus, now->bus, same), CW_OK);
        free(now->memory);
        now->memory = next->memory;
        now->bus = next->bus;
        next->memory = NULL;
    }
    rig_assert_same_events(one, now);
    const cw_bus_stats left = rig_bus_stats(one);
    const cw_bus_stats right = rig_bus_stats(now);
    assert_memory_equal(&left, &right, sizeof left);
}

/* A rule with a period keeps to its grid: it begins neither anew nor at once. So does one that is
 * added late. */
TEST(times_of_a_rule_go_on_when_taking_over)
{
    static const uint8_t same[] = {0, 1, 2};
    cw_rule again = probe("again", CW_TRIGGER_TIME);
    unsigned index;
    again.time_begin = 30 * BIT;
    again.again_ticks = 100 * BIT;
    again.time_end = 430 * BIT;
    RIG *old = rig_new(3);
    rig_rule(old, again);
    rig_start(old);
    rig_run_bits(old, 150);
    assert_int_equal(hits(old, 0), 2); /* at 30 and 130 */
    RIG *r = rig_new(3);
    rig_rule(r, again);
    r->config.rule_room = 1;
    rig_start(r);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, same), CW_OK);
    again.name = "late";
    assert_int_equal(cw_bus_add_rule(r->bus, &index, &again), CW_OK);
    assert_int_equal(cw_bus_rules_until(r->bus), 230 * BIT);
    rig_run_bits(r, 600);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 0)->tick, 230 * BIT);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 1)->tick, 230 * BIT);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 3)->tick, 330 * BIT);
    assert_int_equal(hits(r, 0), 2);
    assert_int_equal(hits(r, index), 2);
    assert_int_equal(cw_bus_rules_until(r->bus), 0);
    again.trigger = CW_TRIGGER_FRAME;
    assert_int_equal(cw_bus_add_rule(r->bus, &index, &again), CW_INVALID);
}

/* Nodes come, go and change places; frames and counters go with their node. */
TEST(nodes_are_matched_when_taking_over)
{
    static const uint8_t from[] = {CW_NO_NODE, 2, 0};
    RIG *old = rig_new(3);
    ADD_RULE(old, "tec", TIME, COUNTERS, .nodes = NODE(2), .tec = 50);
    rig_start(old);
    for (unsigned node = 0; node < 3; node++) {
        const cw_frame frame = rig_frame(0x100 + node, 0, 0);
        for (unsigned i = 0; i <= node; i++)
            rig_send(old, node, &frame, i < 2 ? 0 : 500 * BIT);
    }
    rig_run_bits(old, 5);
    RIG *r = successor(3);
    rig_start(r);
    rig_run_bits(r, 1);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, from), CW_INVALID); /* not at tick 0 */
    rig_free(r);
    r = successor(3);
    rig_start(r);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, from), CW_OK);
    assert_int_equal(cw_bus_now(r->bus), 5 * BIT);
    assert_int_equal(rig_stats(r, 0).queue, 0);
    assert_int_equal(rig_stats(r, 1).queue, 2);
    assert_int_equal(rig_stats(r, 1).tec, 50);
    assert_int_equal(rig_stats(r, 2).queue, 1);
    assert_int_equal(cw_bus_pending(r->bus), 4); /* one in the inbox */
    while (cw_node_flush(old->bus, 1) == CW_FULL)
        rig_poll(old);
    rig_poll(old);
    assert_int_equal(rig_count(old, CW_EVENT_DROP, 1), 2);
    assert_int_equal(rig_nth(old, CW_EVENT_DROP, 0)->why, CW_DROP_REMOVED);
    assert_int_equal(cw_node_flush(old->bus, 3), CW_INVALID);
    rig_run_bits(r, 1000);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 1), 3);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 2), 1);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 0), 3); /* it integrates in the first one */
}

/* The settings are those of the new configuration, at once. */
TEST(settings_are_the_new_ones_when_taking_over)
{
    static const uint8_t same[] = {0, 1, 2, 3};
    const cw_frame frame = rig_frame(0x123, 0, 0);
    RIG *old = rig_new(4);
    ADD_RULE(old, "tec", TIME, COUNTERS, .nodes = NODE(0), .tec = 100);
    ADD_RULE(old, "off", TIME, BUS_OFF, .nodes = NODE(2) | NODE(3));
    old->nodes[3].restart_ticks = 200 * BIT;
    rig_start(old);
    for (unsigned i = 0; i < 3; i++) {
        rig_send(old, 0, &frame, 0);
        rig_send(old, 1, &frame, 0);
    }
    rig_run_bits(old, 5);
    RIG *r = successor(4);
    r->nodes[0].queue = 2;
    r->nodes[0].warning_limit = 101;
    r->nodes[1].modes = CW_MODE_LISTEN_ONLY;
    r->nodes[2].restart_ticks = 100 * BIT;
    rig_start(r);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, same), CW_OK);
    rig_run_bits(r, 300);
    assert_int_equal(rig_stats(r, 0).dropped[CW_DROP_QUEUE_FULL], 1);
    assert_int_equal(rig_stats(r, 1).dropped[CW_DROP_LISTEN_ONLY], 3);
    assert_int_equal(rig_nth(r, CW_EVENT_STATE, 0)->state, CW_STATE_ERROR_ACTIVE);
    assert_int_equal(rig_nth(r, CW_EVENT_RESTART, 0)->tick, 100 * BIT); /* R12: from bus-off */
    assert_int_equal(rig_count(r, CW_EVENT_RESTART, 3), 0); /* restart-ms is 0 now */
    assert_int_equal(cw_bus_pending(r->bus), 2);
}

/* Forces a passive flag of the transmitter around the end of the CRC. When the rest of the flag is
 * recessive, the receivers still take the frame, and no node sends it any more. On another wire
 * others may send. */
static unsigned run_frames_that_are_left(bool partitioned)
{
    unsigned taken = 0;
    for (unsigned k = 0; k < 64 * 32; k++) {
        const cw_frame frame = rig_frame(0x6C0 + k / 32, 0, 0);
        const cw_frame other = rig_frame(0x123, 0, 8);
        RIG *r = rig_new(5);
        cw_rule *split = ADD_RULE(r, "split", TIME, PARTITION);
        split->group[3] = split->group[4] = partitioned;
        ADD_RULE(r, "passive", TIME, COUNTERS, .nodes = NODE(0), .tec = 200);
        ADD_RULE(r, "flag", TIME, ERROR_FLAG, .nodes = NODE(0),
                 .time_begin = (11 + 20 + k % 32) * BIT);
        rig_start(r);
        rig_send(r, 0, &frame, 0);
        for (unsigned i = 0; partitioned && i < 3; i++)
            rig_send(r, 3, &other, 0);
        rig_run_by_next(r, 300 * BIT);
        taken += rig_count(r, CW_EVENT_RX, 1) > 1;
    }
    return taken;
}

TEST(a_frame_that_its_transmitter_leaves_is_foreseen)
{
    assert_in_range(run_frames_that_are_left(false), 64, 64 * 16);
    assert_in_range(run_frames_that_are_left(true), 64, 64 * 16);
}

/* A smaller queue keeps what goes first, not what has lost an arbitration before. */
TEST(a_smaller_queue_keeps_the_first_frames)
{
    static const uint8_t same[] = {0, 1, 2};
    const cw_frame low = rig_frame(0x300, 0, 0);
    const cw_frame middle = rig_frame(0x200, 0, 0);
    const cw_frame high = rig_frame(0x100, 0, 8);
    for (unsigned stepping = 0; stepping < 2; stepping++) {
        RIG *old = rig_new(3);
        rig_start(old);
        cw_bus_set_stepping(old->bus, stepping == 1);
        rig_send(old, 0, &high, 0);
        rig_send(old, 1, &low, 0);
        rig_send(old, 1, &middle, 50 * BIT);
        rig_run_bits(old, 60);
        assert_int_equal(rig_count(old, CW_EVENT_ARBITRATION_LOST, 1), 1);
        RIG *r = successor(3);
        r->nodes[1].queue = 1;
        r->nodes[1].queue_room = stepping ? 16 : 0; /* there is more, for later */
        rig_start(r);
        assert_int_equal(cw_bus_take_over(r->bus, old->bus, same), CW_OK);
        rig_run_bits(r, 300);
        assert_int_equal(rig_nth(r, CW_EVENT_DROP, 0)->frame.id, low.id);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
        assert_int_equal(rig_nth(r, CW_EVENT_TX, 1)->frame.id, middle.id);
    }
}

/* A wrong CRC on the wire stays wrong; the repetition is right. */
TEST(a_wrong_crc_is_taken_over)
{
    static const uint8_t same[] = {0, 1};
    const cw_frame frame = rig_frame(0x123, 0, 0);
    RIG *old = rig_new(2);
    ADD_RULE(old, "wrong", FRAME, WRONG_CRC, .nodes = NODE(0));
    rig_start(old);
    rig_send(old, 0, &frame, 0);
    rig_run_bits(old, JOIN + 10);
    RIG *r = successor(2);
    rig_start(r);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, same), CW_OK);
    rig_run_bits(r, 300);
    assert_int_equal(rig_nth(r, CW_EVENT_ERROR, 0)->error.type, CW_ERROR_ACK);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, 0), 1);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
}

/* Nodes have other numbers on the new bus, and one is removed. */
TEST(the_sender_of_a_held_frame_is_renumbered)
{
    static const uint8_t turned[] = {2, 1, 0};
    static const uint8_t without[] = {CW_NO_NODE, 1, 2};
    const cw_frame frame = rig_frame(0x123, 0, 0);
    for (unsigned gone = 0; gone < 2; gone++) {
        RIG *old = rig_new(3);
        ADD_RULE(old, "late", FRAME, DELAY, .for_ticks = 100000 * BIT, .side = CW_SIDE_RX,
                 .at = NODE(1));
        rig_start(old);
        rig_send(old, 0, &frame, 0);
        rig_run_bits(old, 100);
        RIG *r = successor(3);
        rig_start(r);
        assert_int_equal(cw_bus_take_over(r->bus, old->bus, gone ? without : turned), CW_OK);
        rig_run_bits(r, 110);
        assert_int_equal(rig_nth(r, CW_EVENT_RX, 0)->nodes, NODE(1));
        assert_int_equal(rig_nth(r, CW_EVENT_RX, 0)->from, gone ? 0 : NODE(2));
    }
}

/* Rules start anew: effects of the old ones have ended, but frames that they held back go on. */
TEST(old_rules_end_when_taken_over)
{
    static const uint8_t same[] = {0, 1, 2};
    const cw_frame frame = rig_frame(0x123, 0, 0);
    RIG *old = rig_new(3);
    ADD_RULE(old, "away", TIME, DISCONNECT, .nodes = NODE(2));
    ADD_RULE(old, "no-ack", TIME, NO_ACK, .nodes = NODE(1));
    ADD_RULE(old, "late", FRAME, DELAY, .for_ticks = 100000 * BIT);
    rig_start(old);
    rig_send(old, 0, &frame, 0);
    rig_run_bits(old, 100);
    RIG *r = successor(3);
    cw_rule *soon = rig_rule(r, probe("soon", CW_TRIGGER_TIME));
    soon->time_begin = 50 * BIT;
    cw_rule *over = rig_rule(r, probe("over", CW_TRIGGER_TIME));
    over->time_end = 100 * BIT;
    cw_rule *later = rig_rule(r, probe("later", CW_TRIGGER_TIME));
    later->time_begin = 150 * BIT;
    rig_start(r);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, same), CW_OK);
    rig_run_bits(r, 400);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 0)->tick, 100 * BIT);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 1)->tick, 150 * BIT);
    assert_int_equal(rig_count(r, CW_EVENT_FAULT, -1) + hits(r, 1), 2);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 1);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
    rig_send(r, 2, &frame, 300 * BIT);
    rig_run_bits(r, 600);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 2), 1);
}

/* Receivers get it when its transmitter has left it behind the CRC: a controller of the new kind
 * cannot send it. They get the time of that frame, which has no place in the queue any more. */
TEST(a_frame_that_its_new_controller_does_not_know_has_its_time)
{
    static const uint8_t same[] = {0, 1};
    const cw_frame frame = rig_frame(0x123, CW_FRAME_EXTENDED, 0);
    const unsigned bits = cw_frame_wire_bits(&frame);
    size_t received = 0;
    for (unsigned left = 0; left < bits; left++) {
        RIG *old = rig_new(2);
        rig_start(old);
        rig_send(old, 1, &frame, 100 * BIT);
        rig_run_bits(old, 100 + left);
        RIG *r = rig_new(2);
        r->nodes[1].protocol = CW_PROTOCOL_2_0A;
        rig_start(r);
        assert_int_equal(cw_bus_take_over(r->bus, old->bus, same), CW_OK);
        rig_run_bits(r, 300);
        const size_t count = rig_count(r, CW_EVENT_RX, 0);
        received += count;
        if (count > 0)
            assert_int_equal(rig_nth(r, CW_EVENT_RX, 0)->handed_in, 100 * BIT);
    }
    assert_in_range(received, 5, 12); /* from the CRC delimiter on */
}

/* Two nodes cannot both go on as one: its frames would be there twice. */
TEST(a_node_is_taken_over_once)
{
    static const uint8_t twice[] = {0, 0};
    static const uint8_t once[] = {0, CW_NO_NODE};
    RIG *old = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    rig_start(old);
    rig_send(old, 0, &frame, 5 * BIT);
    rig_run_bits(old, 8);
    RIG *r = rig_new(2);
    rig_start(r);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, twice), CW_INVALID);
    assert_int_equal(cw_bus_pending(r->bus), 0);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, once), CW_OK);
    assert_int_equal(cw_bus_pending(r->bus), 1);
}
