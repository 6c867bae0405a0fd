/* SPDX-License-Identifier: MIT
 *
 * test_fault_control.c - what fault rules do to controllers, at odd moments.
 */
#include "rules.h"
#include "times.h"

/* A command at the very tick at which a frame ends: the frame counts, once. */
static void commands_at_the_end_of_a_frame(void **state)
{
    (void)state;
    static const cw_action actions[] = {CW_ACTION_SET, CW_ACTION_BUS_OFF, CW_ACTION_ERROR_FLAG,
                                        CW_ACTION_DISCONNECT};
    const cw_frame frame = rig_frame(0x123, 0, 4);
    rig *plain = rig_new(2);
    rig_start(plain);
    rig_send(plain, 0, &frame, 0);
    rig_run_bits(plain, 200);
    uint64_t end = rig_nth(plain, CW_EVENT_TX, 0)->tick;
    rig_free(plain);
    for (size_t i = 0; i < sizeof actions / sizeof actions[0]; i++) {
        rig *r = rig_new(2);
        cw_rule *rule = rig_rule(r, new_rule("command", CW_TRIGGER_TIME, actions[i]));
        rule->time_begin = end;
        rule->nodes = NODE(0);
        rule->settings = (cw_settings){.which = CW_SET_MODES, .modes_mask = CW_MODE_LISTEN_ONLY,
                                       .modes = CW_MODE_LISTEN_ONLY};
        rig_start(r);
        rig_send(r, 0, &frame, 0);
        rig_send(r, 0, &frame, 0);
        rig_run(r, end);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
        assert_int_equal(rig_stats(r, 0).tx_frames, 1);
        bool dropped = actions[i] == CW_ACTION_SET;
        assert_int_equal(rig_stats(r, 0).queue, dropped ? 0 : 1);
        assert_int_equal(rig_stats(r, 0).dropped[CW_DROP_LISTEN_ONLY], dropped ? 1 : 0);
        assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 0)->tick, end);
        rig_run_bits(r, 1000);
        rig_free(r);
    }
}

/* A node that is disconnected while bus-off is not back on the bus when its recovery has
 * finished. */
static void recovery_does_not_reconnect(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    cw_rule *off = rig_rule(r, new_rule("off", CW_TRIGGER_TIME, CW_ACTION_BUS_OFF));
    off->nodes = NODE(2);
    cw_rule *away = rig_rule(r, new_rule("away", CW_TRIGGER_TIME, CW_ACTION_DISCONNECT));
    away->nodes = NODE(2);
    away->for_ticks = 3000 * BIT;
    rig_start(r);
    rig_run_bits(r, 20);
    assert_int_equal(cw_node_restart(r->bus, 2), CW_OK);
    rig_run_bits(r, 30 + RECOVERY_BITS);
    assert_int_equal(rig_stats(r, 2).state, CW_STATE_ERROR_ACTIVE);
    rig_send(r, 2, &frame, 2000 * BIT);
    rig_send(r, 0, &frame, 2000 * BIT);
    rig_run_bits(r, 2999);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 1);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 2), 0);
    rig_run_bits(r, 3200);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 2), 1);
    rig_free(r);
}

/* Neither do they when the node has been bus-off for no time, so that no state is reported. */
static void counters_do_not_reconnect(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    rig_rule(r, new_rule("away", CW_TRIGGER_TIME, CW_ACTION_DISCONNECT))->nodes = NODE(1);
    cw_rule *off = rig_rule(r, new_rule("off", CW_TRIGGER_TIME, CW_ACTION_BUS_OFF));
    off->nodes = NODE(1);
    off->time_begin = 50 * BIT;
    cw_rule *counters = rig_rule(r, new_rule("counters", CW_TRIGGER_TIME, CW_ACTION_COUNTERS));
    counters->nodes = NODE(1);
    counters->time_begin = 50 * BIT;
    counters->tec = 0;
    rig_start(r);
    rig_send(r, 0, &frame, 100 * BIT);
    rig_run_bits(r, 500);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 0);
    assert_int_not_equal(rig_count(r, CW_EVENT_ERROR, 0), 0);
    rig_free(r);
}

/* O1 a: an error after two overload frames gives no right to a third one, in whatever way the nodes
 * are simulated. */
static void two_overload_frames_are_all_before_the_next_frame(void **state)
{
    (void)state;
    for (unsigned stepping = 0; stepping < 2; stepping++) {
        rig *r = rig_new(4);
        const cw_frame frame = rig_frame(0x123, 0, 0);
        cw_rule *ask = rig_rule(r, new_rule("ask", CW_TRIGGER_FRAME, CW_ACTION_OVERLOAD));
        ask->nodes = NODE(1);
        ask->number = 2;
        cw_rule *error = rig_rule(r, new_rule("error", CW_TRIGGER_ARMED, CW_ACTION_ERROR_FLAG));
        error->nodes = NODE(2);
        error->manual = true;
        cw_rule *again = rig_rule(r, new_rule("again", CW_TRIGGER_ARMED, CW_ACTION_OVERLOAD));
        again->nodes = NODE(1);
        again->number = 1;
        again->manual = true;
        rig_start(r);
        cw_bus_set_stepping(r->bus, stepping == 1);
        rig_send(r, 0, &frame, 0);
        while (rig_count(r, CW_EVENT_OVERLOAD, 1) < 2)
            rig_run(r, cw_bus_now(r->bus) + BIT);
        rig_run(r, cw_bus_now(r->bus) + 15 * BIT); /* the intermission begins */
        assert_int_equal(cw_bus_fire_rule(r->bus, 1), CW_OK);
        assert_int_equal(cw_bus_fire_rule(r->bus, 2), CW_OK);
        rig_run_bits(r, 300);
        assert_int_equal(rig_count(r, CW_EVENT_OVERLOAD, 1), 3); /* and an answer, O1 b */
        rig_free(r);
    }
}

/* A state that changes with a clean frame is no reason to look at its bits again. */
static void a_state_changes_while_a_node_is_away(void **state)
{
    (void)state;
    cw_bus_stats stats[2];
    for (unsigned stepping = 0; stepping < 2; stepping++) {
        rig *r = rig_new(3);
        const cw_frame frame = rig_frame(0x123, 0, 0);
        cw_rule *away = rig_rule(r, new_rule("away", CW_TRIGGER_TIME, CW_ACTION_DISCONNECT));
        away->nodes = NODE(2);
        cw_rule *tec = rig_rule(r, new_rule("tec", CW_TRIGGER_TIME, CW_ACTION_COUNTERS));
        tec->nodes = NODE(0);
        tec->tec = 96;
        cw_rule *rec = rig_rule(r, new_rule("rec", CW_TRIGGER_TIME, CW_ACTION_COUNTERS));
        rec->nodes = NODE(1);
        rec->rec = 96;
        rig_start(r);
        cw_bus_set_stepping(r->bus, stepping == 1);
        rig_send(r, 0, &frame, 0);
        rig_send(r, 0, &frame, 0);
        rig_run_bits(r, 500);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 2);
        assert_int_equal(rig_count(r, CW_EVENT_STATE, -1), 4);
        stats[stepping] = rig_bus_stats(r);
        rig_free(r);
    }
    assert_int_equal(stats[0].busy_bits, stats[1].busy_bits);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(commands_at_the_end_of_a_frame),
        cmocka_unit_test(recovery_does_not_reconnect),
        cmocka_unit_test(counters_do_not_reconnect),
        cmocka_unit_test(two_overload_frames_are_all_before_the_next_frame),
        cmocka_unit_test(a_state_changes_while_a_node_is_away),
    };
    return cmocka_run_group_tests_name("fault_control", tests, NULL, NULL);
}
