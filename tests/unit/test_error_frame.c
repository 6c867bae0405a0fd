/* SPDX-License-Identifier: MIT
 *
 * test_error_frame.c - the frame that an error belongs to: who sends it, and its identifier.
 *
 * Each case runs in fast steps and in single bits.
 */
#include "cases.h"
#include "rules.h"

#define CASES 2u
#define LONG_ID 0x12345678u

static void start(rig *r, unsigned variant)
{
    rig_start(r);
    cw_bus_set_stepping(r->bus, variant & 1);
}

static void send(rig *r, unsigned node, uint32_t id, unsigned flags)
{
    const cw_frame frame = rig_frame(id, flags, 2);
    rig_send(r, node, &frame, 0);
}

/* Checks that all errors of a node are of this frame. Returns how many there are. */
static unsigned errors_of(const rig *r, unsigned node, uint64_t from, uint32_t can_id)
{
    unsigned count = 0;
    for (size_t i = 0; i < r->count; i++) {
        const cw_event *e = &r->events[i];
        if (e->kind != CW_EVENT_ERROR || !(e->nodes & NODE(node)))
            continue;
        assert_int_equal(e->from, from);
        assert_int_equal(e->can_id, can_id);
        count++;
    }
    return count;
}

/* The others see six equal bits later. */
TEST(an_error_of_the_sender_is_of_its_frame_at_all_nodes)
{
    for (unsigned variant = 0; variant < CASES; variant++) {
        RIG *r = rig_new(3);
        cw_rule *rule = rig_flip(r, "bit", CW_FIELD_DATA, 3);
        rule->at = NODE(1);
        rule->count = 1;
        start(r, variant);
        send(r, 1, LONG_ID, CW_FRAME_EXTENDED);
        rig_run_bits(r, 90);
        for (unsigned node = 0; node < 3; node++)
            assert_int_equal(errors_of(r, node, NODE(1), LONG_ID | CW_FILTER_EXTENDED), 1);
    }
}

/* A flag of recessive bits does not stop the others: they go on with a frame that has no sender. */
TEST(an_error_behind_a_passive_flag_is_of_the_frame)
{
    for (unsigned variant = 0; variant < CASES; variant++) {
        RIG *r = rig_new(3);
        ADD_RULE(r, "passive", TIME, COUNTERS, .nodes = NODE(2), .tec = 140);
        cw_rule *rule = rig_flip(r, "bit", CW_FIELD_CRC, 2);
        rule->at = NODE(2);
        rule->count = 1;
        start(r, variant);
        send(r, 2, 0x123, 0);
        rig_run_bits(r, 90);
        assert_true(errors_of(r, 0, NODE(2), 0x123) > 0);
        assert_true(errors_of(r, 2, NODE(2), 0x123) > 0);
    }
}

/* Several nodes send; a receiver cannot know who will win, and the bus does. */
TEST(an_error_in_the_arbitration_is_of_the_frame_that_wins)
{
    for (unsigned variant = 0; variant < CASES; variant++) {
        RIG *r = rig_new(4);
        cw_rule *rule = rig_flip(r, "sof", CW_FIELD_ID, 3);
        rule->at = NODE(0);
        rule->bits = 6; /* as on the wire: dominant ones are not bit errors of the others */
        rule->action = CW_ACTION_FORCE;
        rule->count = 1;
        start(r, variant);
        send(r, 1, 0x40, CW_FRAME_REMOTE);
        send(r, 2, 0x40, 0);
        send(r, 3, 0x41, 0);
        rig_run_bits(r, 24);
        assert_int_equal(errors_of(r, 0, NODE(1) | NODE(2) | NODE(3), 0x40), 1);
    }
}

/* Errors in error flags go back to the frame in which it began. */
TEST(an_error_in_an_error_flag_is_of_the_frame_before)
{
    for (unsigned variant = 0; variant < CASES; variant++) {
        RIG *r = rig_new(3);
        cw_rule *rule = rig_flip(r, "bit", CW_FIELD_DATA, 3);
        rule->count = 1;
        rule = rig_flip(r, "flag", CW_FIELD_ERROR_FLAG, 2);
        rule->at = NODE(0);
        start(r, variant);
        send(r, 1, 0x123, 0);
        rig_run_bits(r, 60);
        assert_true(errors_of(r, 0, NODE(1), 0x123) > 1);
    }
}

/* A pulse is a SOF for all, without a frame; so is an overload frame behind a good one. */
TEST(errors_without_a_frame_have_none)
{
    for (unsigned variant = 0; variant < CASES; variant++) {
        RIG *r = rig_new(3);
        ADD_RULE(r, "pulse", TIME, STUCK, .time_begin = 200 * BIT, .for_ticks = BIT);
        start(r, variant);
        send(r, 1, 0x123, 0);
        rig_run_bits(r, 230);
        for (unsigned node = 0; node < 3; node++)
            assert_int_equal(errors_of(r, node, 0, 0), 1);
    }
    for (unsigned variant = 0; variant < CASES; variant++) {
        RIG *r = rig_new(3);
        ADD_RULE(r, "ask", FRAME, OVERLOAD, .nodes = NODE(0), .number = 1);
        rig_flip(r, "flag", CW_FIELD_OVERLOAD_DELIMITER, 3)->at = NODE(0);
        start(r, variant);
        send(r, 1, 0x123, 0);
        rig_run_bits(r, 120);
        assert_true(errors_of(r, 0, 0, 0) > 0);
    }
}
