/* SPDX-License-Identifier: MIT
 *
 * test_sleep.c - nodes that sleep: when they fall asleep, what wakes them, and what they keep.
 */
#include "rig.h"

/* Levels and lengths are those of `canwire bits`. */
#define ZEROS_BITS 50u    /* 000#: SOF and 4 bits dominant, then a stuff bit */
#define ALTERNATING 0x2AA /* 010 1010 1010 */

/* ---- The controller alone -------------------------------------------------------------------- */

static unsigned sample(cw_mac *m, bool level)
{
    cw_mac_report report;
    assert_true(cw_mac_drive(m) || !level);
    cw_mac_sample(m, level, &report);
    return report.what;
}

static void be_idle(cw_mac *m)
{
    cw_mac_init(m, 0, 96);
    for (unsigned i = 0; i < JOIN; i++)
        assert_int_equal(sample(m, CW_RECESSIVE), 0);
    assert_int_equal(cw_mac_get_phase(m), CW_MAC_IDLE);
}

TEST(a_controller_sleeps_and_integrates)
{
    cw_mac m;
    cw_mac_init(&m, 0, 96);
    cw_mac_sleep(&m); /* while it integrates */
    assert_int_equal(cw_mac_get_phase(&m), CW_MAC_ASLEEP);
    for (unsigned i = 0; i < 100; i++)
        assert_int_equal(sample(&m, i % 3 == 0), 0);
    cw_mac_wake(&m);
    assert_int_equal(cw_mac_get_phase(&m), CW_MAC_INTEGRATING);
    be_idle(&m);
    cw_mac_sleep(&m);
    assert_int_equal(cw_mac_get_phase(&m), CW_MAC_ASLEEP);
    assert_false(cw_mac_can_start(&m));
    cw_mac_wake(&m);
    cw_mac_wake(&m);
    assert_int_equal(cw_mac_get_phase(&m), CW_MAC_INTEGRATING);
}

/* It acknowledges the frame, and falls asleep with the last bit of the intermission. */
TEST(a_controller_finishes_the_frame_on_the_bus)
{
    const cw_frame frame = rig_frame(0x123, 0, 2);
    cw_bits bits;
    assert_int_equal(cw_bits_encode(&bits, &frame), CW_OK);
    for (unsigned at = 1; at < bits.length; at++) {
        cw_mac m;
        unsigned acknowledged = 0;
        be_idle(&m);
        for (unsigned i = 0; i < bits.length + 3u; i++) {
            const bool own = cw_mac_drive(&m);
            cw_mac_report report;
            if (i == at)
                cw_mac_sleep(&m);
            acknowledged += !own;
            cw_mac_sample(&m, own && (i >= bits.length || cw_bits_level(&bits, i)), &report);
            assert_int_equal(report.what & CW_REPORT_SLEEP,
                             i == bits.length + 2u ? CW_REPORT_SLEEP : 0);
            assert_int_equal(!(report.what & CW_REPORT_RX), i != bits.length - 2u);
        }
        assert_int_equal(acknowledged, 1);
        assert_int_equal(cw_mac_get_phase(&m), CW_MAC_ASLEEP);
    }
}

TEST(a_request_can_be_taken_back)
{
    cw_mac m;
    be_idle(&m);
    (void)sample(&m, CW_DOMINANT);
    cw_mac_sleep(&m);
    assert_int_equal(cw_mac_get_phase(&m), CW_MAC_FRAME);
    cw_mac_wake(&m);
    assert_int_equal(cw_mac_get_phase(&m), CW_MAC_FRAME);
    while (cw_mac_get_phase(&m) != CW_MAC_IDLE)
        assert_int_equal(sample(&m, cw_mac_drive(&m)) & CW_REPORT_SLEEP, 0);
}

/* A line that is cut is recessive: the controller sleeps when it is joined again. */
TEST(a_cut_controller_stays_asleep)
{
    cw_mac m;
    be_idle(&m);
    cw_mac_disconnect(&m);
    cw_mac_sleep(&m);
    cw_mac_reconnect(&m);
    assert_int_equal(cw_mac_get_phase(&m), CW_MAC_ASLEEP);
    assert_int_equal(cw_mac_set_counters(&m, 256, 0), CW_OK);
    assert_int_equal(cw_mac_get_phase(&m), CW_MAC_BUS_OFF);
    cw_mac_sleep(&m);
    assert_int_equal(cw_mac_get_phase(&m), CW_MAC_BUS_OFF);
    assert_int_equal(cw_mac_request_restart(&m), CW_OK);
    for (unsigned i = 0; i < 128 * 11 - 1; i++)
        assert_int_equal(sample(&m, CW_RECESSIVE) & CW_REPORT_SLEEP, 0);
    assert_true(sample(&m, CW_RECESSIVE) & CW_REPORT_SLEEP);
}

TEST(a_filter_measures_dominant_phases)
{
    cw_wake_filter f = {.length = 5};
    assert_false(cw_wake_filter_take(&f, CW_DOMINANT, 4));
    assert_false(cw_wake_filter_take(&f, CW_RECESSIVE, 1));
    assert_false(cw_wake_filter_take(&f, CW_DOMINANT, 4));
    assert_true(cw_wake_filter_take(&f, CW_DOMINANT, 1));
    assert_true(cw_wake_filter_take(&f, CW_DOMINANT, UINT64_MAX));
    f = (cw_wake_filter){.length = 0};
    assert_false(cw_wake_filter_take(&f, CW_RECESSIVE, 1));
    assert_true(cw_wake_filter_take(&f, CW_DOMINANT, 1));
}

/* ---- A bus ----------------------------------------------------------------------------------- */

/* Ways to simulate the same: fast paths, single bits, clocks of nodes. */
typedef enum way { FAST = 0, STEPS, CLOCKS, WAYS } way;

static rig *begin(way w, unsigned nodes)
{
    rig *r = rig_new(nodes);
    r->config.seed = w + 1u;
    return r;
}

static void start(rig *r, way w)
{
    rig_start(r);
    cw_bus_set_stepping(r->bus, w == STEPS);
    cw_bus_set_own_clocks(r->bus, w == CLOCKS);
}

static void set(rig *r, unsigned node, bool sleeps)
{
    const cw_settings s = {.which = CW_SET_SLEEP, .sleeps = sleeps};
    assert_int_equal(cw_node_set(r->bus, node, &s), CW_OK);
}

static cw_sleep_stats stats_of(const rig *r, unsigned node)
{
    cw_sleep_stats stats;
    assert_int_equal(cw_node_get_sleep_stats(r->bus, node, &stats), CW_OK);
    return stats;
}

/* SOF and four bits of 000# are dominant from bit JOIN on. The end of the filter time lies in one
 * of these bits, and the event comes at the end of that one. */
TEST(a_dominant_phase_wakes_a_node)
{
    const cw_frame zeros = rig_frame(0, 0, 0);
    for (way w = 0; w < WAYS; w++)
        for (uint64_t ticks = 0; ticks <= 5 * BIT + 1; ticks += BIT / 16) {
            RIG *r = begin(w, 3);
            r->nodes[1].sleeps = true;
            r->nodes[1].sleep.filter_ticks = ticks;
            r->nodes[1].sleep.wake_ticks = 1000 * BIT;
            start(r, w);
            rig_send(r, 0, &zeros, 0);
            rig_run_bits(r, JOIN + ZEROS_BITS + 10);
            const uint64_t bits = ticks ? (ticks + BIT - 1) / BIT : 1;
            assert_int_equal(rig_count(r, CW_EVENT_WAKE, 1), bits <= 5);
            if (bits <= 5) {
                const cw_event *e = rig_nth(r, CW_EVENT_WAKE, 0);
                assert_int_equal(e->tick, (JOIN + bits) * BIT);
                assert_int_equal(e->why, CW_WAKE_PATTERN);
            }
            assert_int_equal(rig_stats(r, 1).state, CW_STATE_SLEEPING);
            assert_int_equal(rig_count(r, CW_EVENT_RX, -1), 1);
        }
}

/* By a clock of its own the node looks at the end of each quantum, a sixteenth of a bit. */
TEST(a_pulse_wakes_a_node)
{
    for (unsigned sixteenths = 1; sixteenths <= 32; sixteenths++) {
        RIG *r = rig_new(2);
        cw_rule *pulse = rig_flip(r, "pulse", CW_FIELD_NONE, 0);
        *pulse = (cw_rule){.name = "pulse", .trigger = CW_TRIGGER_TIME, .time_begin = 100 * BIT,
                           .time_end = CW_NEVER, .probability = UINT64_MAX, .every = 1,
                           .action = CW_ACTION_PULSE, .level = CW_DOMINANT, .at = NODE(1),
                           .pulse_offset = CW_TICK * BIT / 2,
                           .pulse_length = CW_TICK * BIT / 16 * (cw_span)sixteenths};
        r->nodes[1].sleeps = true;
        r->nodes[1].sleep.filter_ticks = BIT;
        rig_start(r);
        rig_run_bits(r, 200);
        assert_int_equal(rig_count(r, CW_EVENT_WAKE, 1), sixteenths >= 16);
        if (sixteenths >= 16)
            assert_int_equal(rig_nth(r, CW_EVENT_WAKE, 0)->tick, 102 * BIT);
    }
}

/* Nobody acknowledges: the sender gets ACK errors. */
TEST(a_sleeping_node_neither_acknowledges_nor_signals)
{
    const cw_frame frame = rig_frame(ALTERNATING, 0, 0);
    for (way w = 0; w < WAYS; w++) {
        RIG *r = begin(w, 3);
        rig_flip(r, "spoil", CW_FIELD_CRC, 3)->at = NODE(1) | NODE(2);
        for (unsigned i = 1; i < 3; i++) {
            r->nodes[i].sleeps = true;
            r->nodes[i].sleep.filter_ticks = 20 * BIT;
        }
        r->nodes[2].sleep.frames[0] = (cw_filter){.value = 1, .mask = CW_FILTER_BASE_MASK};
        r->nodes[2].sleep.frame_count = 1;
        start(r, w);
        rig_send(r, 0, &frame, 0);
        rig_run_bits(r, 500);
        assert_true(rig_stats(r, 0).errors[CW_ERROR_ACK] > 3);
        assert_int_equal(rig_count(r, CW_EVENT_ERROR, 0), rig_count(r, CW_EVENT_ERROR, -1));
        for (unsigned i = 1; i < 3; i++) {
            const cw_node_stats s = rig_stats(r, i);
            assert_int_equal(s.rec + s.tec + s.rx_frames + s.errors[CW_ERROR_CRC], 0);
            assert_int_equal(s.state, CW_STATE_SLEEPING);
            assert_int_equal(stats_of(r, i).ticks, 500 * BIT);
        }
    }
}

TEST(frames_wake_those_that_want_them)
{
    const cw_frame first = rig_frame(0x100, 0, 1), second = rig_frame(0x101, 0, 1);
    for (way w = 0; w < WAYS; w++) {
        RIG *r = begin(w, 4);
        for (unsigned i = 1; i < 3; i++) {
            r->nodes[i].sleeps = true;
            r->nodes[i].sleep.frame_count = 1;
            r->nodes[i].sleep.frames[0] =
                (cw_filter){.value = 0x100 + i, .mask = CW_FILTER_BASE_MASK};
        }
        r->nodes[2].sleep.frames[0].mask = 0x7F0; /* 100 to 10F */
        start(r, w);
        rig_send(r, 0, &first, 100 * BIT);
        rig_send(r, 0, &second, 200 * BIT);
        rig_send(r, 0, &first, 300 * BIT);
        rig_run_bits(r, 500);
        assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 1); /* the last one */
        assert_int_equal(rig_count(r, CW_EVENT_RX, 2), 2);
        assert_int_equal(rig_count(r, CW_EVENT_RX, 3), 3);
        for (unsigned i = 1; i < 3; i++) {
            const cw_event *e = rig_nth(r, CW_EVENT_WAKE, 2 - i);
            assert_int_equal(e->nodes, NODE(i));
            assert_int_equal(e->why, CW_WAKE_FRAME);
            assert_int_equal(e->tick, rig_nth(r, CW_EVENT_RX, 2 - i)->tick);
            assert_int_equal(stats_of(r, i).wake_ups, 1);
            assert_int_equal(stats_of(r, i).ticks, e->tick);
        }
    }
}

/* It is woken for good: a later dominant phase does not begin the wake time anew. */
TEST(a_node_needs_a_time_to_wake_up)
{
    const cw_frame zeros = rig_frame(0, 0, 0);
    for (way w = 0; w < WAYS; w++) {
        RIG *r = begin(w, 3);
        r->nodes[1].sleeps = true;
        r->nodes[1].sleep.wake_ticks = 250 * BIT - 1;
        start(r, w);
        for (unsigned i = 0; i < 6; i++)
            rig_send(r, 0, &zeros, 100 * i * BIT);
        rig_run_bits(r, 700);
        const uint64_t woken = (JOIN + 1) * BIT, awake = woken + 250 * BIT;
        assert_int_equal(rig_count(r, CW_EVENT_WAKE, 1), 1);
        assert_int_equal(rig_nth(r, CW_EVENT_WAKE, 0)->tick, woken);
        const cw_event *e = rig_nth(r, CW_EVENT_STATE, 1);
        assert_int_equal(e->state_before, CW_STATE_SLEEPING);
        assert_int_equal(e->tick, awake);
        /* frames begin at JOIN, 100, 200, 300: it integrates behind the third one */
        assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 3);
    }
}

/* ---- Hosts ----------------------------------------------------------------------------------- */

TEST(frames_wait_until_the_host_wakes_its_node)
{
    const cw_frame frame = rig_frame(0x123, 0, 0);
    for (way w = 0; w < WAYS; w++) {
        RIG *r = begin(w, 2);
        r->nodes[1].sleep.filter_ticks = BIT;
        start(r, w);
        rig_run_bits(r, 20);
        set(r, 1, true);
        for (unsigned i = 0; i < 3; i++)
            rig_send(r, 1, &frame, 30 * BIT);
        rig_run_bits(r, 5000);
        assert_int_equal(rig_stats(r, 1).queue, 3);
        assert_int_equal(cw_bus_next(r->bus), CW_NEVER);
        set(r, 1, false);
        rig_run_bits(r, 6000);
        const cw_event *e = rig_nth(r, CW_EVENT_WAKE, 0);
        assert_int_equal(e->tick, 5000 * BIT);
        assert_int_equal(e->why, CW_WAKE_HOST);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 1), 3);
        assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->tick, (5000 + JOIN + 45) * BIT);
        assert_int_equal(rig_stats(r, 1).dropped[CW_DROP_QUEUE_FULL], 0);
    }
}

/* A bus on which all sleeps is at rest, and skips any time at once. */
TEST(a_bus_asleep_is_at_rest)
{
    for (way w = 0; w < WAYS; w++) {
        RIG *r = begin(w, 64);
        for (unsigned i = 0; i < 64; i++) {
            r->nodes[i].sleeps = true;
            r->nodes[i].sleep.frame_count = i % 2;
        }
        rig_start(r);
        cw_bus_set_own_clocks(r->bus, w == CLOCKS);
        rig_run_bits(r, 100);
        assert_int_equal(rig_count(r, CW_EVENT_STATE, -1), 64);
        assert_int_equal(cw_bus_next(r->bus), CW_NEVER);
        const uint64_t work = cw_bus_work(r->bus);
        rig_run(r, (uint64_t)3600 * CW_CLOCK_HZ);
        assert_in_range(cw_bus_work(r->bus) - work, 0, 10000);
        assert_int_equal(rig_count(r, CW_EVENT_STATE, -1), 64);
        assert_int_equal(rig_bus_stats(r).busy_bits, 0);
    }
}

TEST(settings_are_kept_and_checked)
{
    RIG *r = rig_new(2);
    cw_settings now, s = {.which = CW_SET_SLEEP | CW_SET_WAKE | CW_SET_MODES, .sleeps = true,
                          .modes_mask = CW_MODE_ONE_SHOT, .modes = CW_MODE_ONE_SHOT,
                          .sleep = {.filter_ticks = 400, .wake_ticks = 7, .frame_count = 1,
                                    .frames = {{.value = 5, .mask = 7}}}};
    rig_start(r);
    assert_int_equal(cw_node_set(r->bus, 1, &s), CW_OK);
    rig_run_bits(r, 50);
    assert_int_equal(cw_node_get_settings(r->bus, 1, &now), CW_OK);
    assert_true(now.sleeps);
    assert_int_equal(now.modes, CW_MODE_ONE_SHOT); /* and not how it listens */
    assert_int_equal(now.sleep.filter_ticks, 400);
    assert_int_equal(now.sleep.wake_ticks, 7);
    assert_int_equal(now.sleep.frame_count, 1);
    s = (cw_settings){.which = CW_SET_WAKE_TIME, .sleep = {.wake_ticks = CW_WAKE_TICKS_MAX + 1}};
    assert_int_equal(cw_node_set(r->bus, 1, &s), CW_INVALID);
    s.sleep = (cw_sleep_settings){.filter_ticks = CW_WAKE_TICKS_MAX + 1};
    assert_int_equal(cw_node_set(r->bus, 1, &s), CW_INVALID);
    s.sleep = (cw_sleep_settings){.frame_count = CW_WAKE_FILTERS_MAX + 1};
    assert_int_equal(cw_node_set(r->bus, 1, &s), CW_INVALID);
    set(r, 1, false);
    assert_int_equal(cw_node_get_settings(r->bus, 1, &now), CW_OK);
    assert_false(now.sleeps);
    rig_run_bits(r, 60);
    assert_int_equal(rig_stats(r, 1).state, CW_STATE_ERROR_ACTIVE);
    assert_int_equal(cw_node_get_sleep_stats(r->bus, 2, &(cw_sleep_stats){0}), CW_INVALID);
}

/* From a dominant phase to frames and back, while it sleeps. */
TEST(what_wakes_a_node_can_change_while_it_sleeps)
{
    const cw_frame zeros = rig_frame(0, 0, 0);
    const cw_settings frames = {.which = CW_SET_WAKE_ON,
                                .sleep = {.frame_count = 1, .frames = {{.value = 1, .mask = 7}}}};
    const cw_settings none = {.which = CW_SET_WAKE_ON};
    for (way w = 0; w < WAYS; w++) {
        RIG *r = begin(w, 3);
        r->nodes[1].sleeps = true;
        r->nodes[1].modes = CW_MODE_LOOPBACK;
        start(r, w);
        assert_int_equal(cw_node_set(r->bus, 1, &frames), CW_OK);
        rig_send(r, 0, &zeros, 20 * BIT);
        rig_run_bits(r, 40); /* in the middle of the frame */
        assert_int_equal(rig_count(r, CW_EVENT_WAKE, 1), 0);
        assert_int_equal(cw_node_set(r->bus, 1, &none), CW_OK);
        rig_run_bits(r, 100);
        assert_int_equal(rig_count(r, CW_EVENT_WAKE, 1), 1);
        cw_settings now;
        assert_int_equal(cw_node_get_settings(r->bus, 1, &now), CW_OK);
        assert_int_equal(now.modes, CW_MODE_LOOPBACK);
    }
}

/* ---- Faults and links ------------------------------------------------------------------------ */

static cw_rule *at_time(rig *r, cw_action action, uint64_t bits)
{
    cw_rule *rule = rig_flip(r, "rule", CW_FIELD_NONE, 0);
    *rule = (cw_rule){.name = "rule", .trigger = CW_TRIGGER_TIME, .time_begin = bits * BIT,
                      .time_end = CW_NEVER, .probability = UINT64_MAX, .every = 1,
                      .action = action, .nodes = NODE(1), .tec = 256, .rec = CW_KEEP};
    return rule;
}

TEST(counters_last_and_bus_off_ends_a_sleep)
{
    for (unsigned frames = 0; frames < 2; frames++) {
        RIG *r = rig_new(2);
        at_time(r, CW_ACTION_COUNTERS, 10)->tec = 130;
        at_time(r, CW_ACTION_COUNTERS, 100)->tec = 140;
        at_time(r, CW_ACTION_BUS_OFF, 200);
        r->rules[1].name = "more";
        r->rules[2].name = "off";
        r->nodes[1].modes = CW_MODE_ONE_SHOT;
        r->nodes[1].sleep.frame_count = (uint8_t)frames;
        rig_start(r);
        rig_run_bits(r, 50);
        set(r, 1, true);
        rig_run_bits(r, 150);
        assert_int_equal(rig_stats(r, 1).state, CW_STATE_SLEEPING);
        assert_int_equal(rig_stats(r, 1).tec, 140);
        rig_run_bits(r, 250);
        assert_int_equal(rig_stats(r, 1).state, CW_STATE_BUS_OFF);
        cw_settings now;
        assert_int_equal(cw_node_get_settings(r->bus, 1, &now), CW_OK);
        assert_false(now.sleeps);
        assert_int_equal(now.modes, CW_MODE_ONE_SHOT);
        assert_int_equal(rig_count(r, CW_EVENT_WAKE, 1), 0);
        assert_int_equal(stats_of(r, 1).ticks, 150 * BIT);
        set(r, 1, true); /* after the recovery */
        assert_int_equal(cw_node_restart(r->bus, 1), CW_OK);
        rig_run_bits(r, 250 + 128 * 11 + 20);
        assert_int_equal(rig_stats(r, 1).state, CW_STATE_SLEEPING);
        assert_int_equal(rig_stats(r, 1).tec, 0);
    }
}

TEST(a_sleeping_node_has_a_link)
{
    const cw_frame zeros = rig_frame(0, 0, 0);
    for (unsigned frames = 0; frames < 2; frames++) {
        RIG *r = rig_new(3);
        r->nodes[1].sleeps = true;
        r->nodes[1].sleep.filter_ticks = BIT;
        r->nodes[1].sleep.frame_count = (uint8_t)frames;
        rig_start(r);
        rig_run_bits(r, 20);
        assert_int_equal(cw_node_attach(r->bus, 1, false), CW_OK);
        rig_send(r, 0, &zeros, 30 * BIT);
        rig_run_bits(r, 200);
        assert_int_equal(rig_count(r, CW_EVENT_WAKE, 1), 0); /* its line is cut */
        assert_int_equal(rig_stats(r, 1).state, CW_STATE_SLEEPING);
        assert_int_equal(cw_node_attach(r->bus, 1, true), CW_OK);
        rig_run_bits(r, 250);
        rig_send(r, 0, &zeros, 300 * BIT);
        rig_run_bits(r, 500);
        assert_int_equal(rig_count(r, CW_EVENT_WAKE, 1), 1);
    }
}

TEST(rules_see_that_a_node_sleeps)
{
    const cw_frame frame = rig_frame(ALTERNATING, 0, 0);
    RIG *r = rig_new(3);
    cw_rule *rule = rig_flip(r, "flip", CW_FIELD_ID, 0);
    rule->state_nodes = NODE(1);
    rule->state_mask = 1u << CW_STATE_SLEEPING;
    rule->count = 1;
    r->nodes[1].sleep.filter_ticks = 20 * BIT;
    rig_start(r);
    rig_send(r, 0, &frame, 20 * BIT);
    rig_run_bits(r, 100);
    assert_int_equal(rig_count(r, CW_EVENT_FAULT, -1), 0);
    set(r, 1, true);
    rig_send(r, 0, &frame, 120 * BIT);
    rig_run_bits(r, 300);
    assert_int_equal(rig_count(r, CW_EVENT_FAULT, -1), 1);
}

/* A cut line is recessive, so a node that shall sleep does so at once. */
TEST(a_cut_node_falls_asleep)
{
    RIG *r = rig_new(3);
    const cw_frame zeros = rig_frame(0, 0, 0);
    cw_rule *cut = at_time(r, CW_ACTION_DISCONNECT, 30);
    cut->for_ticks = 50 * BIT;
    r->nodes[1].sleep.filter_ticks = BIT;
    rig_start(r);
    rig_send(r, 0, &zeros, 20 * BIT);
    rig_run_bits(r, 25);
    set(r, 1, true);
    rig_run_bits(r, 29);
    assert_int_equal(rig_stats(r, 1).state, CW_STATE_ERROR_ACTIVE); /* in the frame */
    rig_run_bits(r, 35);
    assert_int_equal(rig_stats(r, 1).state, CW_STATE_SLEEPING);
    rig_send(r, 0, &zeros, 100 * BIT);
    rig_run_bits(r, 99);
    assert_int_equal(rig_count(r, CW_EVENT_WAKE, 1), 0);
    rig_run_bits(r, 200);
    assert_int_equal(rig_count(r, CW_EVENT_WAKE, 1), 1);
}

/* ---- Another bus goes on --------------------------------------------------------------------- */

static rig *take_over(rig *old, bool frames)
{
    rig *r = rig_new(old->config.node_count);
    uint8_t from[CW_NODES_MAX];
    for (unsigned i = 0; i < CW_NODES_MAX; i++)
        from[i] = (uint8_t)i;
    r->nodes[1].sleep.filter_ticks = 3 * BIT;
    r->nodes[1].sleep.wake_ticks = 100 * BIT;
    r->nodes[1].sleep.frame_count = frames;
    r->nodes[2].sleeps = true; /* awake before: it stays so */
    rig_start(r);
    rig_poll(old);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, from), CW_OK);
    return r;
}

TEST(sleep_goes_on_in_another_bus)
{
    const cw_frame zeros = rig_frame(0, 0, 0);
    for (unsigned how = 0; how < 4 * WAYS; how++) {
        RIG *old = rig_new(3);
        old->nodes[1].sleeps = true;
        old->nodes[1].sleep.filter_ticks = 20 * BIT;
        old->nodes[1].sleep.frame_count = how / WAYS % 2;
        old->nodes[1].sleep.frames[0] = (cw_filter){.value = 5, .mask = 7};
        start(old, how % WAYS);
        rig_send(old, 0, &zeros, 20 * BIT);
        rig_send(old, 1, &zeros, 20 * BIT);
        rig_run_bits(old, 30);
        RIG *r = take_over(old, how / WAYS / 2);
        rig_send(r, 0, &zeros, 100 * BIT);
        rig_run_bits(r, 99);
        assert_int_equal(rig_stats(r, 1).state, CW_STATE_SLEEPING);
        assert_int_equal(rig_stats(r, 1).queue, 1);
        assert_int_equal(rig_stats(r, 2).state, CW_STATE_ERROR_ACTIVE);
        rig_run_bits(r, 400);
        assert_int_equal(rig_count(r, CW_EVENT_WAKE, 1), 1);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 1), 1);
        assert_int_equal(rig_stats(r, 2).state, CW_STATE_ERROR_ACTIVE);
    }
}

TEST(a_wake_up_goes_on_in_another_bus)
{
    RIG *old = rig_new(3);
    old->nodes[1].sleeps = true;
    old->nodes[1].sleep.wake_ticks = 200 * BIT;
    rig_start(old);
    rig_run_bits(old, 50);
    set(old, 1, false);
    rig_run_bits(old, 60);
    RIG *r = take_over(old, false);
    rig_run_bits(r, 300);
    assert_int_equal(rig_nth(r, CW_EVENT_STATE, 0)->tick, 250 * BIT);
    assert_int_equal(stats_of(r, 1).wake_ups, 1);
    assert_int_equal(stats_of(r, 1).ticks, 250 * BIT);
}
