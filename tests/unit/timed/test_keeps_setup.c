/* SPDX-License-Identifier: MIT
 *
 * test_keeps_setup.c - a bus that keeps its setup has no memory for what no node has.
 */
#include "rig.h"

/* Returns what each further node takes, without its statistics. */
static size_t bytes_of_node(rig *r, unsigned few, unsigned many)
{
    r->config.events = UINT16_MAX; /* the ring has the same size for all */
    for (unsigned i = 0; i < CW_NODES_MAX; i++)
        r->nodes[i].queue = 1;
    r->config.node_count = (uint8_t)few;
    const size_t less = cw_bus_size(&r->config);
    r->config.node_count = (uint8_t)many;
    return (cw_bus_size(&r->config) - less) / (many - few) - sizeof(cw_node_stats);
}

TEST(a_node_takes_no_more_than_512_bytes_on_a_bus_of_any_size)
{
    RIG *r = rig_new(2);
    r->config.keeps_setup = true;
    const size_t bytes = bytes_of_node(r, 2, 4);
    assert_in_range(bytes, 1, 512 - 1);
    assert_in_range(bytes_of_node(r, 32, 64), 1, bytes);
    r->config.keeps_setup = false;
    assert_true(bytes_of_node(r, 32, 64) > 2 * bytes);
}

TEST(clocks_delays_and_sleep_from_the_start_have_their_memory)
{
    const cw_node_config plain = {.queue = 16, .warning_limit = 96};
    cw_node_config kinds[6] = {plain, plain, plain, plain, plain, plain};
    kinds[0].timing.bit = (cw_bit_timing){.quantum = CW_TICK * 10, .prop_seg = 6, .phase_seg1 = 7,
                                          .phase_seg2 = 2, .sjw = 1};
    kinds[1].timing.place = CW_TICK;
    kinds[2].timing.stub = CW_TICK;
    kinds[3].timing.rx_delay[CW_RECESSIVE] = CW_TICK;
    kinds[4].timing.ringing = CW_TICK;
    kinds[5].sleeps = true;
    for (unsigned i = 0; i < COUNT(kinds); i++) {
        RIG *r = rig_new(3);
        r->nodes[1] = kinds[i];
        const size_t size = cw_bus_size(&r->config);
        r->config.keeps_setup = true;
        assert_int_equal(cw_bus_size(&r->config), size);
    }
}

/* Returns the status of settings at a node that has sent a frame. */
static cw_status set(rig *r, uint32_t which)
{
    cw_settings s;
    assert_int_equal(cw_node_get_settings(r->bus, 1, &s), CW_OK);
    s.which = which;
    return cw_node_set(r->bus, 1, &s);
}

TEST(a_node_gets_no_clock_no_delay_and_no_sleep_later)
{
    RIG *r = rig_new(3);
    r->config.keeps_setup = true;
    rig_start(r);
    assert_int_equal(set(r, CW_SET_QUANTUM), CW_INVALID);
    assert_int_equal(set(r, CW_SET_SEGMENTS), CW_INVALID);
    assert_int_equal(set(r, CW_SET_TX_DELAY), CW_INVALID);
    assert_int_equal(set(r, CW_SET_PLACE), CW_INVALID);
    assert_int_equal(set(r, CW_SET_RINGING), CW_INVALID);
    assert_int_equal(set(r, CW_SET_SLEEP), CW_INVALID);
    assert_int_equal(set(r, CW_SET_WAKE_TIME), CW_INVALID);
    assert_int_equal(set(r, CW_SET_QUEUE | CW_SET_MODES | CW_SET_WARNING), CW_OK);
    cw_sleep_stats sleep;
    assert_int_equal(cw_node_get_sleep_stats(r->bus, 1, &sleep), CW_OK);
    assert_int_equal(sleep.ticks, 0);
}

TEST(a_rule_that_would_need_a_clock_is_refused_or_has_its_memory)
{
    const cw_rule stuck = {.name = "stuck", .trigger = CW_TRIGGER_ARMED, .manual = true,
                           .time_end = CW_NEVER, .every = 1, .probability = UINT64_MAX,
                           .action = CW_ACTION_STUCK, .line = CW_LINE_WIRE,
                           .level = CW_DOMINANT, .for_ticks = BIT / 2};
    unsigned index;
    RIG *r = rig_new(3);
    r->config.keeps_setup = true;
    r->config.rule_room = 1;
    rig_start(r);
    assert_int_equal(cw_bus_add_rule(r->bus, &index, &stuck), CW_INVALID);
    RIG *from_start = rig_new(3);
    from_start->config.keeps_setup = true;
    from_start->config.rule_count = 1;
    from_start->rules[0] = stuck;
    rig_start(from_start);
    assert_int_equal(cw_bus_fire_rule(from_start->bus, 0), CW_OK);
    rig_run_bits(from_start, 200);
    assert_int_equal(rig_bus_stats(from_start).faults, 1);
}

TEST(a_bus_that_keeps_its_setup_takes_over_no_other_one_and_stays_on_the_grid)
{
    const uint8_t from[] = {0, 1, 2};
    const cw_frame frame = rig_frame(0x123, 0, 8);
    RIG *old = rig_new(3);
    rig_start(old);
    RIG *r = rig_new(3);
    r->config.keeps_setup = true;
    rig_start(r);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, from), CW_INVALID);
    assert_int_equal(cw_bus_take_over(old->bus, r->bus, from), CW_INVALID);
    cw_bus_set_own_clocks(r->bus, true);
    rig_send(r, 0, &frame, 0);
    rig_run_bits(r, 200);
    assert_int_equal(rig_stats(r, 1).rx_frames, 1);
}
