/* SPDX-License-Identifier: MIT
 *
 * test_fault_host.c - what fault rules do to frames between a host and its controller; none is
 * lost.
 */
#include "cases.h"
#include "rules.h"

#include "state/state.h"

/* ---- Frames of rules that are cleared -------------------------------------------------------- */

/* Frames of a cleared rule in a queue are sent, and do not count as frames of its successor. */
static void check_frames_of_a_cleared_rule(uint8_t node)
{
    RIG *r = rig_new(2);
    cw_rule babble = new_rule("babble", CW_TRIGGER_TIME, CW_ACTION_BABBLE);
    babble.node = node;
    r->config.rule_room = 1;
    rig_start(r);
    assert_int_equal(add(r, babble), 0);
    rig_run_bits(r, 20);
    assert_int_equal(rig_stats(r, node).queue, 1);
    assert_int_equal(cw_bus_clear_rule(r->bus, 0), CW_OK);
    babble.name = "other";
    babble.frame.id = 0x7F1;
    assert_int_equal(add(r, babble), 0);
    rig_run_bits(r, 21);
    assert_int_equal(rig_stats(r, node).queue, 2); /* at once: it has none on the way yet */
    rig_run_bits(r, 500);
    assert_int_equal(rig_stats(r, node).queue, 1);
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->frame.id, 0x7F0);
    for (size_t i = 1; i < rig_count(r, CW_EVENT_TX, node); i++)
        assert_int_equal(rig_nth(r, CW_EVENT_TX, i)->frame.id, 0x7F1);
}

TEST(frames_of_a_cleared_rule_are_sent)
{
    check_frames_of_a_cleared_rule(0);
    check_frames_of_a_cleared_rule(1);
}

/* Or a babbling idiot would try again, and drop a frame, in each bit. */
TEST(rules_send_no_frame_that_their_node_does_not_know)
{
    static const cw_action actions[] = {CW_ACTION_BABBLE, CW_ACTION_SEND};
    static const unsigned kinds[] = {CW_PROTOCOL_2_0A, CW_PROTOCOL_2_0B_PASSIVE};
    for (unsigned i = 0; i < 4; i++) {
        RIG *r = rig_new(2);
        unsigned index;
        cw_rule rule = new_rule("sends", CW_TRIGGER_TIME, actions[i / 2]);
        rule.frame = (cw_frame){.id = 0x12345678, .flags = CW_FRAME_EXTENDED};
        r->nodes[0].protocol = (uint8_t)(CW_CLASSICAL | kinds[i % 2]);
        r->config.rule_room = 2;
        rig_start(r);
        assert_int_equal(cw_bus_add_rule(r->bus, &index, &rule), CW_INVALID);
        rule.node = 1;
        assert_int_equal(cw_bus_add_rule(r->bus, &index, &rule), CW_OK);
    }
}

/* Frames that a rule holds back go on their way when it is cleared. */
TEST(held_frames_go_on_when_the_rule_is_cleared)
{
    const cw_frame frame = rig_frame(0x123, 0, 0);
    for (unsigned side = CW_SIDE_TX; side <= CW_SIDE_RX; side++) {
        RIG *r = rig_new(2);
        cw_rule rule = new_rule("late", CW_TRIGGER_FRAME, CW_ACTION_DELAY);
        rule.for_ticks = 100000 * BIT;
        rule.side = (cw_side)side;
        rig_rule(r, rule);
        rig_start(r);
        rig_send(r, 0, &frame, 0);
        rig_run_bits(r, 1000);
        assert_int_equal(rig_count(r, CW_EVENT_RX, -1), 0);
        assert_int_equal(cw_bus_pending(r->bus), 1);
        assert_int_equal(rig_bus_stats(r).pending, 1);
        assert_int_equal(cw_bus_clear_rule(r->bus, 0), CW_OK);
        rig_run_bits(r, 2000);
        assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 1);
        assert_int_equal(cw_bus_pending(r->bus), 0);
        if (side == CW_SIDE_RX)
            assert_int_equal(rig_nth(r, CW_EVENT_RX, 0)->tick, 1000 * BIT);
        assert_int_equal(rig_nth(r, CW_EVENT_RX, 0)->from, NODE(0));
        assert_int_equal(rig_nth(r, CW_EVENT_RX, 0)->handed_in,
                         rig_nth(r, CW_EVENT_TX, 0)->handed_in);
    }
}

/* ---- Frames that are changed ----------------------------------------------------------------- */

TEST(a_change_reaches_all_bytes)
{
    RIG *r = rig_new(2);
    cw_frame frame = rig_frame(0x123, 0, 8);
    cw_rule *rule = ADD_RULE(r, "change", FRAME, CHANGE);
    for (unsigned i = 0; i < 8; i++) {
        rule->change.set_mask[i] = 0xF0;
        rule->change.set[i] = 0xA5;
        rule->change.and_mask[i] = (uint8_t)~(1u << i);
        rule->change.or_mask[i] = 0x02;
        rule->change.xor_mask[i] = (uint8_t)i;
        unsigned byte = 0xA0 | (frame.data[i] & 0x0F);
        frame.data[i] = (uint8_t)(((byte & ~(1u << i)) | 0x02) ^ i);
    }
    const cw_frame sent = rig_frame(0x123, 0, 8);
    rig_start(r);
    rig_send(r, 0, &sent, 0);
    rig_run_bits(r, 200);
    assert_true(cw_frame_equal(&rig_nth(r, CW_EVENT_RX, 0)->frame, &frame));
}

/* ---- No frame is lost ------------------------------------------------------------------------ */

static uint64_t held_at(const rig *r, unsigned node, cw_side side)
{
    uint64_t n = 0;
    for (unsigned i = 0; i < r->bus->rules.held_count; i++)
        n += cw_held_at(&r->bus->rules, i)->node == node &&
             cw_held_at(&r->bus->rules, i)->side == side;
    return n;
}

static uint64_t all_dropped(const uint64_t dropped[CW_DROP_COUNT])
{
    uint64_t n = 0;
    for (unsigned why = 0; why < CW_DROP_COUNT; why++)
        n += dropped[why];
    return n;
}

static void check_sender(const rig *r, uint64_t copies)
{
    const cw_node_stats s = rig_stats(r, 0);
    assert_int_equal(s.made_by_rules, copies);
    assert_int_equal(s.held, held_at(r, 0, CW_SIDE_TX));
    assert_int_equal(s.handed_in + copies, s.tx_frames + s.queue + all_dropped(s.dropped) + s.held);
    assert_true(cw_node_stats_balance(&s));
}

/* Compares the frames of node 0 with those of its receiver, node 1. */
static void check_receiver(const rig *r, uint64_t copies)
{
    const cw_node_stats s = rig_stats(r, 1);
    assert_true(cw_node_stats_balance(&s));
    assert_int_equal(all_dropped(s.dropped), 0);
    if (!cw_bus_idle(r->bus))
        return; /* a frame may be between the two */
    assert_int_equal(rig_stats(r, 0).tx_frames, s.rx_accepted);
    assert_int_equal(s.rx_made_by_rules, copies);
    assert_int_equal(s.rx_held, held_at(r, 1, CW_SIDE_RX));
    assert_int_equal(s.rx_accepted + copies, s.rx_frames + all_dropped(s.rx_dropped) + s.rx_held);
}

static void host_rules(rig *r, cw_side side)
{
    static const char *const names[] = {"drop", "delay", "duplicate", "reorder", "change"};
    for (unsigned i = 0; i < 5; i++) {
        cw_rule *rule = rig_rule(r, new_rule(names[i], CW_TRIGGER_FRAME,
                                             (cw_action)(CW_ACTION_DROP + i)));
        rule->side = side;
        rule->probability = UINT64_MAX / 3;
        rule->for_ticks = 333 * BIT;
        rule->number = 2;
        memset(rule->change.and_mask, 0x0F, sizeof rule->change.and_mask);
        rule->at = side == CW_SIDE_RX ? NODE(1) : 0;
    }
}

TEST(no_frame_is_lost_at_the_host_side)
{
    for (unsigned side = CW_SIDE_TX; side <= CW_SIDE_RX; side++) {
        RIG *r = rig_new(2);
        rig_random random = {.state = 42};
        r->nodes[0].queue = 4;
        host_rules(r, (cw_side)side);
        rig_start(r);
        for (unsigned i = 0; i < 300; i++) {
            const cw_frame frame = rig_random_frame(&random);
            rig_send(r, 0, &frame, cw_bus_now(r->bus) + rig_below(&random, 50 * BIT));
            rig_run(r, cw_bus_now(r->bus) + (50 + rig_below(&random, 150)) * BIT);
            uint64_t copies = 2 * hits(r, 2);
            check_sender(r, side == CW_SIDE_TX ? copies : 0);
            check_receiver(r, side == CW_SIDE_RX ? copies : 0);
        }
        for (unsigned rule = 0; rule < 5; rule++) {
            assert_in_range(hits(r, rule), 20, 400);
            assert_int_equal(cw_bus_clear_rule(r->bus, rule), CW_OK);
        }
        rig_run(r, cw_bus_now(r->bus) + 2000 * BIT);
        assert_int_equal(cw_bus_pending(r->bus), 0);
    }
}

/* There is room for CW_HELD_FRAMES; a further frame is not held back. */
TEST(frames_held_back_are_bounded)
{
    RIG *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    r->nodes[0].queue = 1000;
    ADD_RULE(r, "late", FRAME, DELAY, .for_ticks = 1000 * BIT);
    rig_start(r);
    for (unsigned i = 0; i < CW_HELD_FRAMES + 3; i++)
        rig_send(r, 0, &frame, 0);
    rig_run_bits(r, 10);
    assert_int_equal(rig_stats(r, 0).queue, 3);
    assert_int_equal(cw_bus_pending(r->bus), CW_HELD_FRAMES + 3);
    rig_run_bits(r, 1100);
    assert_int_equal(rig_stats(r, 0).tx_frames + rig_stats(r, 0).queue, CW_HELD_FRAMES + 3);
}

/* Frames that rules make are counted apart from those of the host. */
TEST(frames_that_rules_make_are_counted_apart)
{
    RIG *r = rig_new(3);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    ADD_RULE(r, "send", TIME, SEND, .node = 0, .frame = rig_frame(0x700, 0, 1));
    ADD_RULE(r, "reply", FRAME, REPLY, .node = 1, .frame = rig_frame(0x456, 0, 2), .from = NODE(0));
    ADD_RULE(r, "twice", FRAME, DUPLICATE, .filters[0] = (cw_filter){.value = 0x123, .mask = 0x7FF},
             .filter_count = 1, .number = 1);
    rig_start(r);
    rig_send(r, 0, &frame, 0);
    rig_run_bits(r, 2000);
    const cw_node_stats sender = rig_stats(r, 0);
    const cw_node_stats replier = rig_stats(r, 1);
    assert_int_equal(sender.handed_in, 1);
    assert_int_equal(sender.made_by_rules, 2); /* 700, and 123 once more */
    assert_int_equal(sender.tx_frames, 3);
    assert_int_equal(replier.handed_in, 0);
    assert_int_equal(replier.made_by_rules, 3);
    assert_true(cw_node_stats_balance(&sender) && cw_node_stats_balance(&replier));
}

/* Rules that make more copies in one bit than there is room for events. */
TEST(frames_that_the_event_ring_cannot_hold_are_counted)
{
    const cw_frame frame = rig_frame(0x123, 0, 0);
    RIG *r = rig_new(8);
    for (unsigned i = 0; i < RIG_RULES_MAX; i++) {
        static const char *const names[RIG_RULES_MAX] = {"a", "b", "c", "d", "e", "f", "g", "h"};
        ADD_RULE(r, names[i], FRAME, DUPLICATE, .side = CW_SIDE_RX, .number = 16);
    }
    for (unsigned i = 0; i < 8; i++)
        r->nodes[i].queue = 1;
    r->config.events = 0;
    r->config.inbox = 1;
    rig_start(r);
    rig_send(r, 0, &frame, 0);
    rig_run_bits(r, 100);
    uint64_t lost = 0;
    for (unsigned i = 1; i < 8; i++) {
        const cw_node_stats s = rig_stats(r, i);
        assert_int_equal(rig_count(r, CW_EVENT_RX, (int)i), s.rx_frames);
        assert_int_equal(s.rx_accepted + s.rx_made_by_rules, 1 + 16 * RIG_RULES_MAX);
        assert_true(cw_node_stats_balance(&s));
        lost += s.rx_dropped[CW_DROP_QUEUE_FULL];
    }
    assert_in_range(lost, 1, 7 * 16 * RIG_RULES_MAX);
    assert_true(rig_bus_stats(r).events_lost >= lost);
}

TEST(statistics_that_do_not_balance_are_known)
{
    static const struct {
        cw_node_stats stats;
        bool balance;
    } cases[] = {
        {{.handed_in = 0}, true},
        {{.handed_in = 5, .made_by_rules = 2, .tx_frames = 3, .queue = 1, .held = 1,
          .dropped = {[CW_DROP_FAULT] = 2}}, true},
        {{.handed_in = 1}, false},
        {{.made_by_rules = 1}, false},
        {{.tx_frames = 1}, false},
        {{.dropped = {[CW_DROP_REMOVED] = 1}}, false},
        {{.rx_accepted = 2, .rx_made_by_rules = 3, .rx_frames = 3, .rx_held = 1,
          .rx_dropped = {[CW_DROP_FAULT] = 1}}, true},
        {{.rx_accepted = 1}, false},
        {{.rx_frames = 1}, false},
        {{.handed_in = 1, .rx_frames = 1}, false},
        {{.handed_in = 1, .rx_dropped = {[CW_DROP_FAULT] = 1}}, false},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        assert_int_equal(cw_node_stats_balance(&cases[i].stats), cases[i].balance);
}

/* Filters look at the bits of their masks, whatever else a host may have put into an identifier. */
TEST(a_bad_frame_is_met_by_exact_and_other_filters)
{
    static const uint32_t masks[] = {CW_FILTER_EXTENDED | 0x7FF, CW_FILTER_EXTENDED | 0x7FE, 0x7FF};
    for (size_t i = 0; i < sizeof masks / sizeof masks[0]; i++) {
        RIG *r = rig_new(2);
        cw_rule *drop = ADD_RULE(r, "drop", FRAME, DROP);
        const cw_frame bad = {.id = 0x1123};
        drop->filters[0] = (cw_filter){.value = 0x123, .mask = masks[i]};
        drop->filter_count = 1;
        rig_start(r);
        rig_send(r, 0, &bad, 0);
        rig_run_bits(r, 20);
        assert_int_equal(rig_nth(r, CW_EVENT_DROP, 0)->why, CW_DROP_FAULT);
    }
}
