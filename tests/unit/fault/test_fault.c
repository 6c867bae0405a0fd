/* SPDX-License-Identifier: MIT
 *
 * test_fault.c - fault rules that come and go while the bus runs, are refused, are fired by hand or
 * by each other, and end.
 *
 * tests/scenarios has each action and each condition. The tests here and in the other files about
 * fault rules cover effects that a scenario cannot show.
 */
#include "cases.h"
#include "rules.h"

#include "state/state.h"

/* ---- Rules that come and go ------------------------------------------------------------------ */

TEST(a_rule_added_at_run_time_acts_from_then_on)
{
    RIG *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    r->config.rule_room = 2;
    rig_start(r);
    send_every(r, &frame, 100, 4);
    rig_run_bits(r, 200);
    unsigned frames = add(r, probe("frames", CW_TRIGGER_FRAME));
    cw_rule late = probe("late", CW_TRIGGER_TIME);
    late.time_begin = 100 * BIT; /* that was before */
    unsigned at_once = add(r, late);
    unsigned index = 77;
    assert_int_equal(cw_bus_add_rule(r->bus, &index, &late), CW_FULL);
    assert_int_equal(index, 77);
    rig_run_bits(r, 500);
    assert_int_equal(hits(r, frames), 2);
    assert_int_equal(hits(r, at_once), 1);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 0)->tick, 200 * BIT);
}

/* The index is used again; nothing of the old rule is left. */
TEST(a_cleared_rule_is_gone)
{
    RIG *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    r->config.rule_room = 2;
    rig_start(r);
    cw_rule stuck = new_rule("stuck", CW_TRIGGER_TIME, CW_ACTION_STUCK);
    stuck.level = CW_RECESSIVE;
    unsigned first = add(r, stuck);
    cw_rule follower = probe("follower", CW_TRIGGER_ARMED);
    follower.has_after = true;
    follower.after = (uint16_t)first;
    unsigned second = add(r, follower);
    rig_run_bits(r, 20);
    assert_true(rule_stats(r, first).active);
    assert_int_equal(hits(r, second), 1);
    assert_int_equal(cw_bus_clear_rule(r->bus, first), CW_OK);
    assert_int_equal(cw_bus_clear_rule(r->bus, first), CW_INVALID);
    assert_int_equal(cw_bus_stop_rule(r->bus, first), CW_INVALID);
    assert_int_equal(cw_bus_fire_rule(r->bus, first), CW_INVALID);
    cw_rule_stats stats;
    assert_int_equal(cw_rule_get_stats(r->bus, first, &stats), CW_INVALID);
    assert_int_equal(add(r, probe("new", CW_TRIGGER_FRAME)), first);
    assert_int_equal(hits(r, first), 0);
    rig_send(r, 0, &frame, 30 * BIT);
    rig_run_bits(r, 200);
    assert_int_equal(hits(r, first), 1);
    assert_int_equal(hits(r, second), 1); /* it came after a removed rule */
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 1);
}

/* A lasting rule of each kind is stopped: its effect has ended, the rule stays. */
TEST(a_stopped_rule_can_act_again)
{
    static const cw_action actions[] = {CW_ACTION_STUCK, CW_ACTION_NOISE, CW_ACTION_NO_ACK,
                                        CW_ACTION_DISCONNECT, CW_ACTION_PARTITION};
    const cw_frame frame = rig_frame(0x123, 0, 0);
    for (size_t i = 0; i < sizeof actions / sizeof actions[0]; i++) {
        RIG *r = rig_new(2);
        cw_rule rule = new_rule("lasting", CW_TRIGGER_ARMED, actions[i]);
        rule.manual = true;
        rule.error_rate = UINT64_MAX;
        rule.nodes = NODE(1);
        rule.group[1] = 1;
        rig_rule(r, rule);
        rig_start(r);
        for (unsigned round = 0; round < 2; round++) {
            uint64_t start = cw_bus_now(r->bus);
            size_t sent = rig_count(r, CW_EVENT_TX, 0);
            assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_OK);
            rig_send(r, 0, &frame, start + 20 * BIT);
            rig_run(r, start + 200 * BIT);
            assert_true(rule_stats(r, 0).active);
            assert_int_equal(rig_count(r, CW_EVENT_TX, 0), sent);
            assert_int_equal(cw_bus_stop_rule(r->bus, 0), CW_OK);
            assert_false(rule_stats(r, 0).active);
            rig_run(r, start + 5000 * BIT);
            assert_int_equal(rig_count(r, CW_EVENT_TX, 0), sent + 1);
        }
    }
}

/* A follower that stands before the rule comes after it no more, either. */
TEST(a_rule_before_the_cleared_one_is_left_alone)
{
    RIG *r = rig_new(2);
    cw_rule *follower = rig_rule(r, probe("follower", CW_TRIGGER_ARMED));
    follower->has_after = true;
    follower->after = 1;
    rig_rule(r, probe("old", CW_TRIGGER_TIME));
    rig_start(r);
    rig_run_bits(r, 10);
    assert_int_equal(hits(r, 0), 1);
    assert_int_equal(cw_bus_clear_rule(r->bus, 1), CW_OK);
    assert_int_equal(add(r, probe("new", CW_TRIGGER_TIME)), 1);
    rig_run_bits(r, 20);
    assert_int_equal(hits(r, 1), 1);
    assert_int_equal(hits(r, 0), 1);
}

#define RULE(t, a, ...)                                                                            \
    {.name = "rule", .trigger = CW_TRIGGER_##t, .action = CW_ACTION_##a, __VA_ARGS__}
#define FLIP(...) RULE(FRAME, FLIP, .field = CW_FIELD_SOF, .bits = 1, __VA_ARGS__)
#define SET(...) RULE(TIME, SET, .nodes = NODE(1) | NODE(2), .settings = {__VA_ARGS__})

/* On a bus of three nodes with room for four rules. */
TEST(bad_rules_are_refused)
{
    static const cw_rule bad[] = {
        /* no such kind, node or rule */
        {.trigger = CW_TRIGGER_TIME, .action = CW_ACTION_STUCK}, /* no name */
        {.name = "rule", .trigger = (cw_trigger)4, .action = CW_ACTION_STUCK},
        {.name = "action", .action = CW_ACTION_COUNT},
        RULE(TIME, STUCK, .line = (cw_line)(CW_LINE_RX + 1)),
        RULE(TIME, STUCK, .node = 3),
        RULE(FRAME, DROP, .side = (cw_side)(CW_SIDE_RX + 1)),
        FLIP(.from = NODE(3)),
        FLIP(.at = NODE(63)),
        RULE(TIME, BUS_OFF, .nodes = NODE(3) | NODE(1)),
        RULE(TIME, BUS_OFF, .state_nodes = NODE(5)),
        RULE(ARMED, BUS_OFF, .has_after = true, .after = 4),
        FLIP(.filter_count = CW_RULE_FILTERS_MAX + 1),
        FLIP(.data_length = 9),
        /* no moment */
        RULE(FRAME, FLIP, .bits = 1),
        RULE(FRAME, FLIP, .bits = 1, .field = CW_FIELD_COUNT),
        RULE(FRAME, FORCE, .bits = 0, .field = CW_FIELD_SOF),
        RULE(TIME, FLIP, .bits = 1, .field = CW_FIELD_SOF),
        RULE(FRAME, GLITCH, .bits = CW_PATTERN_MAX + 1, .field = CW_FIELD_SOF),
        RULE(TIME, WRONG_CRC, .nodes = NODE(0)),
        RULE(ERROR, DROP, .error_mask = 4),
        RULE(TIME, CHANGE, .side = CW_SIDE_RX),
        RULE(ARMED, REPLY, .manual = true),
        /* values */
        RULE(TIME, SEND, .frame = {.id = 0x800}),
        RULE(TIME, BABBLE, .frame = {.dlc = 16}),
        RULE(FRAME, REPLY, .frame = {.flags = CW_FRAME_FD}),
        RULE(TIME, COUNTERS, .tec = 264, .rec = CW_KEEP),
        RULE(TIME, COUNTERS, .tec = CW_KEEP, .rec = 256),
        RULE(TIME, OVERLOAD, .number = 0),
        RULE(TIME, OVERLOAD, .number = 3),
        RULE(FRAME, DUPLICATE, .number = CW_COPIES_MAX + 1),
        RULE(TIME, LOAD, .load_permille = 1001),
        SET(.which = CW_SET_QUEUE, .queue = 0),
        SET(.which = CW_SET_QUEUE, .queue = 17),
        SET(.which = CW_SET_WARNING, .warning_limit = 256),
    };
    RIG *r = rig_new(3);
    r->config.rule_room = 4;
    rig_start(r);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        unsigned index = 77;
        if (cw_bus_add_rule(r->bus, &index, &bad[i]) != CW_INVALID)
            fail_msg("rule %zu was accepted", i);
        assert_int_equal(index, 77);
    }
    cw_rule good = new_rule("flip", CW_TRIGGER_FRAME, CW_ACTION_FLIP);
    good.field = CW_FIELD_SOF;
    good.from = good.at = good.nodes = good.state_nodes = NODE(2);
    good.node = 2;
    good.has_after = true;
    good.after = 3; /* one that may come later */
    assert_int_equal(add(r, good), 0);
    rig_free(r);

    r = rig_new(3);
    ADD_RULE(r, "bad", TIME, SEND, .frame.id = 0x800);
    FREED void *memory = malloc(cw_bus_size(&r->config));
    assert_null(cw_bus_init(memory, &r->config));
}

/* The bus treats each action as its row in the table of actions says. */
TEST(each_action_is_what_its_row_says)
{
    RIG *r = rig_new(2);
    r->config.rule_room = 1;
    rig_start(r);
    for (unsigned i = 0; i < CW_ACTION_COUNT; i++) {
        const cw_action action = (cw_action)i;
        cw_rule rule = new_rule("rule", CW_TRIGGER_ARMED, action);
        unsigned index;
        rule.manual = true;
        rule.field = CW_FIELD_SOF;
        rule.bits = 1;
        rule.number = 1;
        rule.for_ticks = BIT;
        rule.pulse_length = rule.jitter = rule.quantum_from = rule.quantum_to = CW_TICK;
        assert_true(cw_action_name(action)[0] != '\0');
        for (unsigned k = 0; k < i; k++)
            assert_string_not_equal(cw_action_name(action), cw_action_name((cw_action)k));
        bool needs_frame = cw_bus_add_rule(r->bus, &index, &rule) == CW_INVALID;
        assert_int_equal(needs_frame, cw_action_needs_frame(action));
        if (!needs_frame)
            assert_int_equal(cw_bus_clear_rule(r->bus, index), CW_OK);
        rule.trigger = CW_TRIGGER_FRAME;
        assert_int_equal(cw_bus_add_rule(r->bus, &index, &rule), CW_OK);
        assert_int_equal(cw_bus_clear_rule(r->bus, index), CW_OK);
        assert_in_range(cw_action_kind_of(action), CW_KIND_POSITION, CW_KIND_TRAFFIC);
    }
    assert_int_equal(cw_action_kind_of(CW_ACTION_NO_ACK), CW_KIND_LEVEL);
    assert_int_equal(cw_action_kind_of(CW_ACTION_WRONG_CRC), CW_KIND_CONTROL);
    assert_int_equal(cw_action_kind_of(CW_ACTION_DROP), CW_KIND_HOST);
}

/* Limits that are still good. */
TEST(rules_at_the_limits_are_good)
{
    RIG *r = rig_new(CW_NODES_MAX);
    static const cw_rule good[] = {
        RULE(TIME, COUNTERS, .tec = 263, .rec = 255, .nodes = UINT64_MAX),
        RULE(FRAME, GLITCH, .field = CW_FIELD_SOF, .bits = CW_PATTERN_MAX, .at = NODE(63),
             .filter_count = CW_RULE_FILTERS_MAX, .data_length = 8),
        RULE(FRAME, FORCE, .field = CW_FIELD_BIT, .for_ticks = 1),
        RULE(FRAME, FLIP, .field = CW_FIELD_BIT, .bits = UINT16_MAX),
        RULE(FRAME, DUPLICATE, .number = CW_COPIES_MAX),
        RULE(TIME, LOAD, .load_permille = 1000),
        RULE(TIME, OVERLOAD, .number = 2),
        SET(.which = CW_SET_QUEUE | CW_SET_WARNING, .queue = 16, .warning_limit = 255),
        RULE(ARMED, BUS_OFF, .has_after = true, .after = 8),
        RULE(TIME, SET, .nodes = NODE(5), .settings = {.which = CW_SET_QUEUE, .queue = 32}),
    };
    r->nodes[5].queue = 32;
    r->config.rule_room = sizeof good / sizeof good[0];
    rig_start(r);
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++)
        assert_int_equal(add(r, good[i]), i);
}

/* ---- By hand --------------------------------------------------------------------------------- */

TEST(a_manual_rule_acts_when_fired)
{
    RIG *r = rig_new(2);
    cw_rule rule = probe("by hand", CW_TRIGGER_ARMED);
    rule.manual = true;
    rule.count = 3;
    rig_rule(r, rule);
    rig_rule(r, probe("not manual", CW_TRIGGER_TIME));
    rig_start(r);
    assert_int_equal(cw_bus_fire_rule(r->bus, 1), CW_REFUSED);
    assert_int_equal(cw_bus_fire_rule(r->bus, 2), CW_INVALID);
    rig_run_bits(r, 50);
    assert_int_equal(hits(r, 0), 0);
    assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_OK);
    rig_run_bits(r, 100);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 1)->tick, 50 * BIT);
    assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_OK); /* twice: one of them a bit later */
    assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_OK);
    rig_run_bits(r, 200);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 2)->tick, 100 * BIT);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 3)->tick, 101 * BIT);
    assert_true(rule_stats(r, 0).over);
    assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_REFUSED);
}

/* With a condition on frames each firing is good for one match. */
TEST(a_manual_rule_on_frames_takes_one_match)
{
    RIG *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    cw_rule rule = probe("by hand", CW_TRIGGER_FRAME);
    rule.manual = true;
    rig_rule(r, rule);
    rig_start(r);
    send_every(r, &frame, 100, 8);
    rig_run_bits(r, 200); /* two frames */
    assert_int_equal(rule_stats(r, 0).matches, 0);
    for (unsigned i = 0; i < 2; i++)
        assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_OK);
    rig_run_bits(r, 1000);
    assert_int_equal(hits(r, 0), 2);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 0)->tick, (JOIN + 200 + 1) * BIT);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 1)->tick, (JOIN + 300 + 1) * BIT);
}

/* Armings take place at their times, in any order of their rules. */
TEST(armings_take_place_in_time_order)
{
    static const unsigned expected[] = {30, 50, 110, 130};
    RIG *r = rig_new(2);
    cw_rule *first = rig_rule(r, probe("first", CW_TRIGGER_ARMED));
    first->manual = true;
    cw_rule *both = rig_rule(r, probe("both", CW_TRIGGER_ARMED));
    both->manual = true;
    both->has_after = true;
    both->after = 0;
    both->after_delay = 100 * BIT;
    rig_start(r);
    for (unsigned bit = 10; bit <= 50; bit += 20) { /* armed at 110, 130; by hand at 30, 50 */
        rig_run_bits(r, bit);
        if (bit < 50)
            assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_OK);
        if (bit > 10)
            assert_int_equal(cw_bus_fire_rule(r->bus, 1), CW_OK);
    }
    rig_run_bits(r, 300);
    assert_int_equal(hits(r, 1), 4);
    unsigned n = 0;
    for (size_t i = 0; i < r->count; i++)
        if (r->events[i].kind == CW_EVENT_FAULT && r->events[i].rule == 1)
            assert_int_equal(r->events[i].tick, expected[n++] * (uint64_t)BIT);
}

/* Armings under way are bounded; cw_bus_fire_rule() refuses further ones. */
TEST(armings_are_bounded)
{
    RIG *r = rig_new(2);
    cw_rule rule = probe("by hand", CW_TRIGGER_ARMED);
    rule.manual = true;
    rig_rule(r, rule);
    rig_start(r);
    for (unsigned i = 0; i < CW_ARMINGS_MAX; i++)
        assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_OK);
    assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_REFUSED);
    rig_run_bits(r, 100);
    assert_int_equal(hits(r, 0), CW_ARMINGS_MAX);
    assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_OK);
}

/* Rules that arm each other without delay go round once in a bit, and time goes on. */
TEST(a_ring_of_rules_goes_round_once_in_a_bit)
{
    enum { LENGTH = 5 };
    static const char *const names[LENGTH] = {"a", "b", "c", "d", "e"};
    RIG *r = rig_new(1);
    for (uint16_t i = 0; i < LENGTH; i++) {
        cw_rule rule = probe(names[i], CW_TRIGGER_ARMED);
        rule.has_after = true;
        rule.after = (uint16_t)((i + 1) % LENGTH);
        rule.manual = i == 2;
        rig_rule(r, rule);
    }
    rig_start(r);
    assert_int_equal(cw_bus_fire_rule(r->bus, 2), CW_OK);
    rig_run_bits(r, 100);
    for (unsigned i = 0; i < LENGTH; i++)
        assert_in_range(hits(r, i), 100, 101);
}

/* ---- Alone ----------------------------------------------------------------------------------- */

/* An action that begins with a frame and lasts for a time ends in time, without any other rule. */
TEST(what_begins_with_a_frame_ends_in_time)
{
    static const cw_action actions[] = {CW_ACTION_STUCK, CW_ACTION_NOISE, CW_ACTION_NO_ACK,
                                        CW_ACTION_DISCONNECT, CW_ACTION_PARTITION, CW_ACTION_BABBLE,
                                        CW_ACTION_LOAD};
    const cw_frame frame = rig_frame(0x123, 0, 0);
    for (size_t i = 0; i < sizeof actions / sizeof actions[0]; i++) {
        RIG *r = rig_new(3);
        r->nodes[2].modes = CW_MODE_LISTEN_ONLY;
        cw_rule *rule = rig_rule(r, new_rule("lasting", CW_TRIGGER_FRAME, actions[i]));
        exactly(rule, 0x123);
        rule->count = 1;
        rule->for_ticks = 150 * BIT + 1;
        rule->line = CW_LINE_RX;
        rule->at = rule->nodes = NODE(2);
        rule->node = 2;
        rule->group[2] = 1;
        rig_start(r);
        rig_send(r, 0, &frame, 0);
        rig_run_bits(r, JOIN + 151 - 1);
        assert_true(rule_stats(r, 0).active);
        rig_run_bits(r, JOIN + 151);
        assert_false(rule_stats(r, 0).active);
        rig_run_bits(r, 2000);
        assert_int_equal(cw_bus_next(r->bus), CW_NEVER);
    }
}

/* A rule on errors needs no other rule about. */
TEST(a_rule_on_errors_alone)
{
    RIG *r = rig_new(1);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    cw_rule *rule = ADD_RULE(r, "once", ERROR, SET);
    rule->error_mask = 0x20; /* no ACK */
    rule->nodes = NODE(0);
    rule->settings = (cw_settings){.which = CW_SET_MODES, .modes_mask = CW_MODE_PRESUME_ACK,
                                   .modes = CW_MODE_PRESUME_ACK};
    rig_start(r);
    rig_send(r, 0, &frame, 0);
    rig_run_bits(r, 500);
    assert_int_equal(hits(r, 0), 1);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
}

/* Each match is a hit or a miss; but the hits of noise are the bits that it flips. */
TEST(misses_are_matches_that_were_passed_over)
{
    RIG *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 8);
    ADD_RULE(r, "noise", TIME, NOISE, .error_rate = UINT64_MAX / 4, .for_ticks = 1000 * BIT,
             .at = NODE(1));
    ADD_RULE(r, "frames", FRAME, NOISE, .error_rate = UINT64_MAX / 4, .at = NODE(1), .skip = 1,
             .every = 2);
    ADD_RULE(r, "drops", FRAME, DROP, .side = CW_SIDE_TX, .every = 3);
    rig_start(r);
    for (unsigned i = 0; i < 12; i++)
        rig_send(r, 0, &frame, (2000 + 500 * i) * BIT);
    rig_run_bits(r, 10000);
    cw_rule_stats stats[3];
    for (unsigned i = 0; i < 3; i++) {
        assert_int_equal(cw_rule_get_stats(r->bus, i, &stats[i]), CW_OK);
        assert_true(stats[i].misses <= stats[i].matches);
    }
    assert_int_equal(stats[0].matches, 1);
    assert_int_equal(stats[0].misses, 0);
    assert_in_range(stats[0].hits, 100, 500);
    assert_int_equal(stats[1].misses, (stats[1].matches + 1) / 2);
    assert_true(stats[1].hits > stats[1].matches);
    assert_int_equal(stats[2].matches, 12);
    assert_int_equal(stats[2].hits, 4);
    assert_int_equal(stats[2].misses, 8);
}

/* ---- Traffic that is no fault ---------------------------------------------------------------- */

/* Its hits are neither reported nor counted; all else is as with a rule that is not quiet. */
TEST(a_quiet_rule_is_not_told)
{
    for (int quiet = 0; quiet < 2; quiet++) {
        RIG *r = rig_new(2);
        const cw_frame question = rig_frame(0x123, CW_FRAME_REMOTE, 0);
        ADD_RULE(r, "reply", FRAME, REPLY, .node = 1, .frame = rig_frame(0x123, 0, 2),
                 .quiet = quiet);
        rig_start(r);
        rig_send(r, 0, &question, 0);
        rig_run_bits(r, 300);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 1), 1);
        assert_int_equal(rig_count(r, CW_EVENT_FAULT, -1), quiet ? 0 : 1);
        assert_int_equal(rig_bus_stats(r).faults, quiet ? 0 : 1);
        assert_int_equal(rig_stats(r, 1).made_by_rules, 1);
    }
}
