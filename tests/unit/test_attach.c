/* SPDX-License-Identifier: MIT
 *
 * test_attach.c - a node whose host takes it off the bus and puts it on again. The tests check its
 * frames, its state and the other nodes.
 */
#include "rig.h"

/* Events of a node, or of the bus, as a text of their names and what they say. */
static void assert_told(const rig *r, unsigned node, const char *expected)
{
    char text[400] = "";
    for (size_t i = 0; i < r->count; i++) {
        const cw_event *e = &r->events[i];
        char line[RIG_LINE_MAX];
        if (!(e->nodes >> node & 1u))
            continue;
        rig_line(line, e);
        const char *kind = strchr(strchr(line, ' ') + 1, ' ');
        strncat(text, kind + 1, sizeof text - strlen(text) - 1);
        strncat(text, ";", sizeof text - strlen(text) - 1);
    }
    assert_string_equal(text, expected);
}

static void forget(rig *r)
{
    rig_poll(r);
    r->count = 0;
}

static void assert_all_balance(const rig *r)
{
    for (unsigned i = 0; i < r->config.node_count; i++) {
        const cw_node_stats s = rig_stats(r, i);
        assert_true(cw_node_stats_balance(&s));
    }
}

TEST(a_node_that_is_off_neither_sends_nor_hears)
{
    RIG *r = rig_new(3);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    rig_start(r);
    assert_true(cw_node_attached(r->bus, 1));
    assert_int_equal(cw_node_attach(r->bus, 1, false), CW_OK);
    assert_false(cw_node_attached(r->bus, 1));
    rig_send(r, 0, &frame, 100 * BIT);
    rig_send(r, 1, &frame, 100 * BIT);
    rig_run_bits(r, 1000);
    assert_told(r, 1, "link down;drop link-down 123#0:;");
    assert_told(r, 2, "rx 123#0:;");
    assert_told(r, 0, "tx 123#0:;");
    forget(r);
    assert_int_equal(cw_node_attach(r->bus, 1, true), CW_OK);
    assert_true(cw_node_attached(r->bus, 1));
    rig_send(r, 1, &frame, 0);
    rig_run_bits(r, 2000);
    assert_told(r, 1, "link up;tx 123#0:;");
    assert_told(r, 0, "rx 123#0:;");
    /* integrating takes eleven bits, M10 */
    uint64_t end = rig_nth(r, CW_EVENT_TX, 0)->tick;
    assert_int_equal(end, (1000 + JOIN) * BIT + rig_stats(r, 1).tx_bits * BIT);
    assert_int_equal(rig_stats(r, 1).dropped[CW_DROP_LINK_DOWN], 1);
    assert_all_balance(r);
}

/* Bits of a frame after which its sender goes; then what a receiver sees is an error, or not any
 * more. In the last bit of EOF receivers have the frame already, as M7 says. */
TEST(a_sender_that_goes_in_the_middle_of_its_frame)
{
    const cw_frame frame = rig_frame(0x123, 0, 8);
    cw_bits bits;
    assert_int_equal(cw_bits_encode(&bits, &frame), CW_OK);
    for (unsigned sent = 1; sent <= bits.length; sent++) {
        RIG *r = rig_new(3);
        rig_start(r);
        rig_send(r, 0, &frame, 0);
        rig_send(r, 0, &frame, 0);
        rig_run_bits(r, JOIN + sent);
        assert_int_equal(cw_node_attach(r->bus, 0, false), CW_OK);
        rig_run_bits(r, 1000);
        bool whole = sent == bits.length;
        assert_int_equal(rig_stats(r, 0).tx_frames, whole);
        assert_int_equal(rig_stats(r, 0).dropped[CW_DROP_LINK_DOWN], 2 - whole);
        assert_int_equal(rig_stats(r, 0).queue, 0);
        for (unsigned i = 1; i < 3; i++) {
            size_t errors = rig_count(r, CW_EVENT_ERROR, (int)i);
            size_t frames = rig_count(r, CW_EVENT_RX, (int)i);
            assert_true(frames <= 1 && (errors > 0 || frames == 1));
            assert_int_equal(rig_stats(r, i).rec == 0, errors == 0);
        }
        assert_true(cw_bus_idle(r->bus));
        assert_int_equal(rig_bus_stats(r).pending, 0);
        assert_all_balance(r);
    }
}

TEST(a_sender_without_receiver_waits_for_one_that_comes_back)
{
    RIG *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 1);
    rig_start(r);
    assert_int_equal(cw_node_attach(r->bus, 1, false), CW_OK);
    rig_send(r, 0, &frame, 0);
    rig_run_bits(r, 5000);
    assert_int_equal(rig_stats(r, 0).tec, 128); /* R3 i */
    assert_int_equal(rig_stats(r, 0).queue, 1);
    assert_int_equal(cw_node_attach(r->bus, 1, true), CW_OK);
    rig_run_bits(r, 10000);
    assert_int_equal(rig_stats(r, 0).tx_frames, 1);
    assert_int_equal(rig_stats(r, 1).rx_frames, 1);
}

/* As `ip link set DEVICE down` and `up` do: the controller starts anew. */
TEST(going_off_ends_a_bus_off)
{
    RIG *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 1);
    cw_rule *kill = &r->rules[r->config.rule_count++];
    *kill = (cw_rule){.name = "kill", .trigger = CW_TRIGGER_TIME, .time_end = CW_NEVER,
                      .time_begin = 30 * BIT, .probability = UINT64_MAX,
                      .action = CW_ACTION_BUS_OFF, .nodes = NODE(0)};
    r->nodes[0].restart_ticks = 3000 * BIT;
    rig_start(r);
    rig_send(r, 0, &frame, 0);
    rig_run_bits(r, 100);
    assert_int_equal(rig_stats(r, 0).state, CW_STATE_BUS_OFF);
    forget(r);
    assert_int_equal(cw_node_attach(r->bus, 0, false), CW_OK);
    assert_int_equal(cw_bus_next(r->bus), cw_bus_now(r->bus)); /* it has an event to report */
    rig_run_bits(r, 200);
    assert_told(r, 0, "link down;drop link-down 123#1:11;state bus-off error-active 0/0;");
    assert_int_equal(cw_bus_next(r->bus), CW_NEVER); /* no restart any more */
    assert_int_equal(cw_node_attach(r->bus, 0, true), CW_OK);
    rig_send(r, 0, &frame, 0);
    rig_run_bits(r, 6000);
    assert_int_equal(rig_stats(r, 0).tx_frames, 1);
    assert_int_equal(rig_stats(r, 0).restarts, 0);
}

TEST(what_is_so_already_changes_nothing)
{
    RIG *r = rig_new(2);
    rig_start(r);
    assert_int_equal(cw_node_attach(r->bus, 0, true), CW_OK);
    assert_int_equal(cw_node_attach(r->bus, 1, false), CW_OK);
    forget(r);
    assert_int_equal(cw_node_attach(r->bus, 1, false), CW_OK);
    rig_poll(r);
    assert_int_equal(r->count, 0);
    assert_int_equal(cw_node_attach(r->bus, 2, true), CW_INVALID);
    assert_false(cw_node_attached(r->bus, 2));
}

/* Off by a rule and off by its host: it is back when neither keeps it off. */
TEST(a_node_is_back_when_nothing_keeps_it_off)
{
    const cw_frame frame = rig_frame(0x123, 0, 0);
    static const struct {
        unsigned off, on, rule_off, rule_on; /* bits */
    } cases[] = {
        {100, 200, 150, 300}, {100, 300, 150, 200}, {150, 300, 100, 200}, {150, 200, 100, 300},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        RIG *r = rig_new(3);
        cw_rule *cut = &r->rules[r->config.rule_count++];
        *cut = (cw_rule){.name = "cut", .trigger = CW_TRIGGER_TIME, .probability = UINT64_MAX,
                         .time_begin = cases[i].rule_off * BIT, .time_end = CW_NEVER,
                         .for_ticks = (cases[i].rule_on - cases[i].rule_off) * BIT,
                         .action = CW_ACTION_DISCONNECT, .nodes = NODE(1)};
        rig_start(r);
        rig_run_bits(r, cases[i].off);
        assert_int_equal(cw_node_attach(r->bus, 1, false), CW_OK);
        rig_run_bits(r, cases[i].on);
        assert_int_equal(cw_node_attach(r->bus, 1, true), CW_OK);
        rig_send(r, 1, &frame, 0);
        rig_send(r, 0, &frame, (300 + JOIN) * BIT);
        rig_run_bits(r, 3000);
        assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->tick,
                         (300 + JOIN) * BIT + rig_stats(r, 1).tx_bits * BIT); /* M10 */
        assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 2); /* equal frames went as one */
    }
}

/* A rule does not fill the log of a node that is off with drops, but each frame of it counts. */
TEST(rules_on_a_node_that_is_off)
{
    RIG *r = rig_new(2);
    static const cw_action actions[] = {CW_ACTION_BABBLE, CW_ACTION_LOAD, CW_ACTION_SEND};
    for (unsigned i = 0; i < 3; i++) {
        cw_rule *rule = &r->rules[r->config.rule_count++];
        *rule = (cw_rule){.name = (const char *[]){"babble", "load", "send"}[i],
                          .trigger = CW_TRIGGER_TIME, .time_end = CW_NEVER,
                          .probability = UINT64_MAX, .action = actions[i], .node = 0,
                          .load_permille = 500, .period_ticks = 100 * BIT,
                          .for_ticks = 1000 * BIT, .frame = rig_frame(0x700, 0, 0)};
    }
    rig_start(r);
    assert_int_equal(cw_node_attach(r->bus, 0, false), CW_OK);
    rig_run_bits(r, 2000);
    const cw_node_stats s = rig_stats(r, 0);
    assert_int_equal(s.made_by_rules, 10);
    assert_int_equal(s.dropped[CW_DROP_LINK_DOWN], 10);
    assert_int_equal(rig_bus_stats(r).frames, 0);
    assert_all_balance(r);
}

/* The node goes into bus-off and out of it at once: no node sees the state change, and it stays
 * off. */
TEST(counters_do_not_put_a_node_on_the_bus)
{
    static const cw_action actions[] = {CW_ACTION_BUS_OFF, CW_ACTION_COUNTERS};
    const cw_frame frame = rig_frame(0x123, 0, 0);
    for (unsigned stepping = 0; stepping < 2; stepping++) {
        RIG *r = rig_new(2);
        for (unsigned i = 0; i < 2; i++) {
            cw_rule *rule = &r->rules[r->config.rule_count++];
            *rule = (cw_rule){.name = i ? "counters" : "bus-off", .trigger = CW_TRIGGER_TIME,
                              .time_begin = 100 * BIT, .time_end = CW_NEVER,
                              .probability = UINT64_MAX, .action = actions[i], .nodes = NODE(1)};
        }
        rig_start(r);
        cw_bus_set_stepping(r->bus, stepping);
        assert_int_equal(cw_node_attach(r->bus, 1, false), CW_OK);
        rig_send(r, 0, &frame, 200 * BIT);
        rig_run_bits(r, 1000);
        assert_told(r, 1, "link down;");
        assert_int_equal(rig_stats(r, 0).tx_frames, 0);
        assert_true(rig_stats(r, 0).errors[CW_ERROR_ACK] > 0);
    }
}

TEST(a_bus_that_takes_over_leaves_it_off)
{
    static const uint8_t from[] = {CW_NO_NODE, 1, 0};
    const cw_frame frame = rig_frame(0x123, 0, 0);
    RIG *old = rig_new(2);
    RIG *r = rig_new(3);
    rig_start(old);
    rig_start(r);
    rig_run_bits(old, 100);
    assert_int_equal(cw_node_attach(old->bus, 0, false), CW_OK);
    rig_poll(old);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, from), CW_OK);
    assert_true(cw_node_attached(r->bus, 0) && cw_node_attached(r->bus, 1));
    assert_false(cw_node_attached(r->bus, 2));
    rig_send(r, 1, &frame, 200 * BIT);
    rig_send(r, 2, &frame, 200 * BIT);
    rig_run_bits(r, 1000);
    assert_told(r, 0, "rx 123#0:;");
    assert_told(r, 2, "drop link-down 123#0:;");
    forget(r);
    assert_int_equal(cw_node_attach(r->bus, 2, true), CW_OK);
    rig_send(r, 2, &frame, 0);
    rig_run_bits(r, 2000);
    assert_told(r, 2, "link up;tx 123#0:;");
}

/* Nodes that the new bus has taken off before: only one that is new stays so. */
TEST(a_bus_that_takes_over_puts_on_who_was_on)
{
    static const uint8_t from[] = {CW_NO_NODE, 0, 1};
    const cw_frame frame = rig_frame(0x123, 0, 0);
    RIG *old = rig_new(2);
    RIG *r = rig_new(3);
    rig_start(old);
    rig_start(r);
    rig_run_bits(old, 100);
    for (unsigned i = 0; i < 2; i++)
        assert_int_equal(cw_node_attach(r->bus, i, false), CW_OK);
    rig_poll(r);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, from), CW_OK);
    assert_false(cw_node_attached(r->bus, 0));
    assert_true(cw_node_attached(r->bus, 1) && cw_node_attached(r->bus, 2));
    forget(r);
    rig_send(r, 1, &frame, 200 * BIT);
    rig_run_bits(r, 1000);
    assert_told(r, 0, "");
    assert_told(r, 1, "tx 123#0:;");
    assert_told(r, 2, "rx 123#0:;");
}
