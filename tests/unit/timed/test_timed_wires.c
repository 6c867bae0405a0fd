/* SPDX-License-Identifier: MIT
 *
 * test_timed_wires.c - wires that rules cut and join while nodes have clocks of their own.
 *
 * A bit of the bus has 16 quanta of 10 ticks. Wires change at the begin of a bit time of the bus.
 * For a node with another clock that is in the middle of a bit.
 */
#include "cases.h"
#include "canwire.h"

#define BIT_TICKS 160u
#define QUANTUM (CW_TICK * 10)
#define SLOW (QUANTUM + QUANTUM / 100)

static cw_node_config node_of(cw_span quantum)
{
    return (cw_node_config){.queue = 4, .warning_limit = 96,
                            .timing.bit = {.quantum = quantum, .prop_seg = 6, .phase_seg1 = 5,
                                           .phase_seg2 = 4, .sjw = 1}};
}

/* The nodes are on wires of their own in a time. */
static cw_rule split(uint64_t from, uint64_t to)
{
    return (cw_rule){.name = "split", .trigger = CW_TRIGGER_TIME, .time_begin = from,
                     .time_end = to, .probability = UINT64_MAX, .action = CW_ACTION_PARTITION,
                     .group = {0, 1}};
}

static cw_bus *make_bus(const cw_rule *rule, cw_span ringing)
{
    cw_node_config nodes[2] = {node_of(QUANTUM), node_of(SLOW)};
    nodes[1].timing.ringing = ringing;
    const cw_bus_config config = {.bit_ticks = BIT_TICKS, .node_count = 2, .inbox = 8,
                                  .events = 256, .nodes = nodes, .rules = rule, .rule_count = 1};
    cw_bus *bus = cw_bus_init(malloc(cw_bus_size(&config)), &config);
    assert_non_null(bus);
    cw_bus_set_events(bus, 1u << CW_EVENT_SYNC);
    return bus;
}

static void send(cw_bus *bus, uint64_t tick)
{
    assert_int_equal(cw_node_send(bus, 0, &(cw_frame){.id = 0}, tick), CW_OK);
}

/* Returns the first synchronisation of the slow node after a tick. */
static cw_event first_sync(cw_bus *bus, uint64_t after)
{
    cw_event e;
    while (cw_bus_poll(bus, &e))
        if (e.nodes == 2 && e.tick > after)
            return e;
    fail_msg("no synchronisation");
    return e;
}

/* Bit 13 of the slow node begins at 13 x 161.6 = 2100.8 ticks. Its quantum from 2232.1 to 2242.2
 * has the begin of bit 14 of the bus in it, 2240, when the wires join. Node 0 sends `d` since bit
 * 12, but on the other wire. So the slow node, which is idle, sees an edge in that quantum, with
 * its look at 2242.2 (T3, T12), where its bit ends (T4). */
TEST(a_wire_that_is_joined_while_dominant_makes_an_edge)
{
    const cw_rule rule = split(0, 14 * BIT_TICKS);
    FREED cw_bus *bus = make_bus(&rule, 0);
    send(bus, 12 * BIT_TICKS);
    assert_int_equal(cw_bus_advance(bus, 20 * BIT_TICKS), CW_OK);
    const cw_event e = first_sync(bus, 0);
    assert_true(e.hard);
    assert_int_equal(e.tick, 2243);
}

/* An edge on the other wire stays there. SOF is at 1920 ticks. The wires are joined in bit 17, the
 * recessive stuff bit behind five `d`. So the next edge is that of bit 18, 2880. */
TEST(an_edge_on_the_other_wire_is_not_seen_later)
{
    const cw_rule rule = split(0, 17 * BIT_TICKS);
    FREED cw_bus *bus = make_bus(&rule, 0);
    send(bus, 12 * BIT_TICKS);
    assert_int_equal(cw_bus_advance(bus, 20 * BIT_TICKS), CW_OK);
    const cw_event e = first_sync(bus, 0);
    assert_true(e.hard && e.tick > 2880 && e.tick <= 2880 + 11 + 162);
}

/* A wire that swings is looked at again behind each edge, back to the last sample. There it was
 * another wire. The frame is cut in two places; the slow node ends well. */
TEST(a_swing_is_not_looked_for_on_the_other_wire)
{
    for (unsigned bit = 12; bit < 60; bit++) {
        const cw_rule rule = split(bit * BIT_TICKS, (bit + 3) * BIT_TICKS);
        FREED cw_bus *bus = make_bus(&rule, 3 * QUANTUM);
        send(bus, 12 * BIT_TICKS);
        cw_event e;
        for (unsigned part = 1; part <= 300; part++) {
            assert_int_equal(cw_bus_advance(bus, part * BIT_TICKS), CW_OK);
            while (cw_bus_poll(bus, &e)) /* no event is of a time long ago */
                assert_true(e.tick + 4 * BIT_TICKS > part * BIT_TICKS);
        }
        cw_node_stats stats;
        assert_int_equal(cw_node_get_stats(bus, 1, &stats), CW_OK);
        assert_int_equal(stats.rx_frames, 1);
    }
}
