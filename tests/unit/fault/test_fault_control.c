/* SPDX-License-Identifier: MIT
 *
 * test_fault_control.c - what fault rules do to controllers, at odd moments.
 */
#include "cases.h"
#include "rules.h"
#include "times.h"

/* A command at the very tick at which a frame ends: the frame counts, once. */
TEST(commands_at_the_end_of_a_frame)
{
    static const cw_action actions[] = {CW_ACTION_SET, CW_ACTION_BUS_OFF, CW_ACTION_ERROR_FLAG,
                                        CW_ACTION_DISCONNECT, CW_ACTION_SOFTWARE_RESET,
                                        CW_ACTION_HARDWARE_RESET};
    const cw_frame frame = rig_frame(0x123, 0, 4);
    rig *plain = rig_new(2);
    rig_start(plain);
    rig_send(plain, 0, &frame, 0);
    rig_run_bits(plain, 200);
    uint64_t end = rig_nth(plain, CW_EVENT_TX, 0)->tick;
    rig_free(plain);
    for (size_t i = 0; i < sizeof actions / sizeof actions[0]; i++) {
        RIG *r = rig_new(2);
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
        const bool silent = actions[i] == CW_ACTION_SET;
        const bool resets = actions[i] == CW_ACTION_SOFTWARE_RESET ||
                            actions[i] == CW_ACTION_HARDWARE_RESET;
        assert_int_equal(rig_stats(r, 0).queue, silent || resets ? 0 : 1);
        assert_int_equal(rig_stats(r, 0).dropped[CW_DROP_LISTEN_ONLY], silent ? 1 : 0);
        assert_int_equal(rig_stats(r, 0).dropped[CW_DROP_FAULT], resets ? 1 : 0);
        assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 0)->tick, end);
        rig_run_bits(r, 1000);
    }
}

/* A node that is disconnected while bus-off is not back on the bus when its recovery has
 * finished. */
TEST(recovery_does_not_reconnect)
{
    RIG *r = rig_new(3);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    ADD_RULE(r, "off", TIME, BUS_OFF, .nodes = NODE(2));
    ADD_RULE(r, "away", TIME, DISCONNECT, .nodes = NODE(2), .for_ticks = 3000 * BIT);
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
}

/* Neither do they when the node has been bus-off for no time, so that no state is reported. */
TEST(counters_do_not_reconnect)
{
    RIG *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    ADD_RULE(r, "away", TIME, DISCONNECT, .nodes = NODE(1));
    ADD_RULE(r, "off", TIME, BUS_OFF, .nodes = NODE(1), .time_begin = 50 * BIT);
    ADD_RULE(r, "counters", TIME, COUNTERS, .nodes = NODE(1), .time_begin = 50 * BIT, .tec = 0);
    rig_start(r);
    rig_send(r, 0, &frame, 100 * BIT);
    rig_run_bits(r, 500);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 0);
    assert_int_not_equal(rig_count(r, CW_EVENT_ERROR, 0), 0);
}

/* O1 a: an error after two overload frames gives no right to a third one, in whatever way the nodes
 * are simulated. */
TEST(two_overload_frames_are_all_before_the_next_frame)
{
    for (unsigned stepping = 0; stepping < 2; stepping++) {
        RIG *r = rig_new(4);
        const cw_frame frame = rig_frame(0x123, 0, 0);
        ADD_RULE(r, "ask", FRAME, OVERLOAD, .nodes = NODE(1), .number = 2);
        ADD_RULE(r, "error", ARMED, ERROR_FLAG, .nodes = NODE(2), .manual = true);
        ADD_RULE(r, "again", ARMED, OVERLOAD, .nodes = NODE(1), .number = 1, .manual = true);
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
    }
}

/* A state that changes with a clean frame is no reason to look at its bits again. */
TEST(a_state_changes_while_a_node_is_away)
{
    cw_bus_stats stats[2];
    for (unsigned stepping = 0; stepping < 2; stepping++) {
        RIG *r = rig_new(3);
        const cw_frame frame = rig_frame(0x123, 0, 0);
        ADD_RULE(r, "away", TIME, DISCONNECT, .nodes = NODE(2));
        ADD_RULE(r, "tec", TIME, COUNTERS, .nodes = NODE(0), .tec = 96);
        ADD_RULE(r, "rec", TIME, COUNTERS, .nodes = NODE(1), .rec = 96);
        rig_start(r);
        cw_bus_set_stepping(r->bus, stepping == 1);
        rig_send(r, 0, &frame, 0);
        rig_send(r, 0, &frame, 0);
        rig_run_bits(r, 500);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 2);
        assert_int_equal(rig_count(r, CW_EVENT_STATE, -1), 4);
        stats[stepping] = rig_bus_stats(r);
    }
    assert_int_equal(stats[0].busy_bits, stats[1].busy_bits);
}

static cw_rule *reset_at(rig *r, bool hardware, unsigned node, uint64_t bit)
{
    cw_rule *reset = rig_rule(r, new_rule("reset", CW_TRIGGER_TIME,
                                          hardware ? CW_ACTION_HARDWARE_RESET
                                                   : CW_ACTION_SOFTWARE_RESET));
    reset->nodes = NODE(node);
    reset->time_begin = bit * BIT;
    return reset;
}

/* Frames that wait, on either side of the controller, are dropped and counted. */
TEST(a_reset_loses_no_frame_silently)
{
    for (unsigned hardware = 0; hardware < 2; hardware++) {
        RIG *r = rig_new(2);
        const cw_frame frame = rig_frame(0x123, 0, 0);
        r->nodes[1].host = (cw_host_config){.receive_buffers = 8, .service_ticks = 1000 * BIT};
        (void)reset_at(r, hardware, 1, 300);
        rig_start(r);
        for (unsigned i = 0; i < 2; i++)
            rig_send(r, 0, &frame, 0);
        for (unsigned i = 0; i < 3; i++)
            rig_send(r, 1, &frame, 299 * BIT);
        rig_run_bits(r, 2000);
        const cw_node_stats stats = rig_stats(r, 1);
        assert_int_equal(stats.dropped[CW_DROP_FAULT], 3);
        assert_int_equal(stats.rx_dropped[CW_DROP_FAULT], 2);
        assert_int_equal(stats.restarts, 0);
        assert_true(cw_node_stats_balance(&stats));
        assert_int_equal(rig_count(r, CW_EVENT_DROP, 1), 5);
    }
}

/* A reset brings no node back that is cut off. The wait begins when it is back. */
TEST(a_reset_does_not_reconnect)
{
    for (unsigned hardware = 0; hardware < 2; hardware++) {
        RIG *r = rig_new(2);
        const cw_frame frame = rig_frame(0x123, 0, 0);
        ADD_RULE(r, "away", TIME, DISCONNECT, .nodes = NODE(1), .for_ticks = 3000 * BIT);
        (void)reset_at(r, hardware, 1, 100);
        rig_start(r);
        rig_send(r, 1, &frame, 200 * BIT);
        rig_run_bits(r, 5000);
        const uint64_t wait = hardware ? JOIN : RECOVERY_BITS;
        assert_int_equal(rig_count(r, CW_EVENT_TX, 1), 1);
        assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->tick,
                         (3000 + wait + cw_frame_wire_bits(&frame)) * BIT);
    }
}

/* Returns the recessive bits that a controller needs to be idle. */
static unsigned bits_to_idle(cw_mac *mac)
{
    cw_mac_report report;
    unsigned bits = 0;
    for (; cw_mac_get_phase(mac) != CW_MAC_IDLE; bits++) {
        (void)cw_mac_drive(mac);
        cw_mac_sample(mac, CW_RECESSIVE, &report);
    }
    return bits;
}

/* A dominant bit costs a group of 11, disconnection and a change of modes all of them. Bus-off has
 * a wait of its own (R12). A hardware reset ends the wait. */
TEST(a_software_reset_waits_for_128_groups)
{
    for (unsigned with = 0; with < 6; with++) {
        cw_mac mac;
        cw_mac_report report;
        cw_mac_init(&mac, 0, 96);
        assert_int_equal(bits_to_idle(&mac), JOIN);
        cw_mac_reset(&mac, false);
        for (unsigned bit = 0; bit < 27; bit++) /* two groups, and five bits */
            cw_mac_sample(&mac, with != 1 || bit < 26, &report);
        if (with == 2) {
            cw_mac_disconnect(&mac);
            cw_mac_reconnect(&mac);
        } else if (with == 3) {
            cw_mac_set_modes(&mac, CW_MODE_LOOPBACK);
        } else if (with == 4) {
            assert_int_equal(cw_mac_set_counters(&mac, 256, 0), CW_OK);
            assert_int_equal(cw_mac_set_counters(&mac, 0, 0), CW_OK);
        } else if (with == 5) {
            cw_mac_reset(&mac, true);
        }
        static const unsigned left[] = {RECOVERY_BITS - 27, RECOVERY_BITS - 22, RECOVERY_BITS,
                                        RECOVERY_BITS, JOIN, JOIN};
        assert_int_equal(bits_to_idle(&mac), left[with]);
        cw_mac_disconnect(&mac);
        cw_mac_reconnect(&mac);
        assert_int_equal(bits_to_idle(&mac), JOIN); /* it is over */
    }
}
