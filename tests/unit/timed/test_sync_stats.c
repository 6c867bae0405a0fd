/* SPDX-License-Identifier: MIT
 *
 * test_sync_stats.c - what a bus counts of the clocks of its nodes, by numbers of T3 to T5.
 *
 * A bit has 16 quanta, is sampled after 12 and lasts 160 ticks. The frame 0F0#0F0F0F0F has its
 * edges to dominant at most 10 bits apart.
 */
#include "cases.h"
#include "canwire.h"

#define BIT_TICKS 160u
#define QUANTUM (CW_TICK * 10)

typedef struct rig {
    cw_bus *bus;
    cw_sync_record records[2];
    cw_sync_stats sender, receiver;
} rig;

static cw_node_config node_of(cw_span quantum, cw_span place, uint16_t sjw)
{
    return (cw_node_config){
        .queue = 4, .warning_limit = 96,
        .timing = {.bit = {.quantum = quantum, .prop_seg = 6, .phase_seg1 = 5, .phase_seg2 = 4,
                           .sjw = sjw},
                   .place = place}};
}

static cw_bus *make_bus(cw_span quantum, cw_span place)
{
    const uint16_t sjw = place ? 1 : 4;
    const cw_node_config nodes[2] = {node_of(QUANTUM, 0, sjw), node_of(quantum, place, sjw)};
    const cw_bus_config config = {.bit_ticks = BIT_TICKS, .node_count = 2, .inbox = 8,
                                  .events = 256, .nodes = nodes};
    cw_bus *bus = cw_bus_init(malloc(cw_bus_size(&config)), &config);
    assert_non_null(bus);
    return bus;
}

static void send(cw_bus *bus, unsigned node)
{
    const cw_frame frame = {.id = 0x0F0, .dlc = 4, .data = {0x0F, 0x0F, 0x0F, 0x0F}};
    assert_int_equal(cw_node_send(bus, node, &frame, cw_bus_now(bus)), CW_OK);
}

static void advance(rig *r, unsigned bits)
{
    assert_int_equal(cw_bus_advance(r->bus, cw_bus_now(r->bus) + bits * BIT_TICKS), CW_OK);
    assert_int_equal(cw_node_get_sync_stats(r->bus, 0, &r->sender), CW_OK);
    assert_int_equal(cw_node_get_sync_stats(r->bus, 1, &r->receiver), CW_OK);
}

/* Node 0 sends one frame to a receiver with another quantum, or at another place. */
static rig run_frame(cw_span quantum, cw_span place, bool own_clocks)
{
    rig r = {.bus = make_bus(quantum, place)};
    cw_bus_set_own_clocks(r.bus, own_clocks);
    cw_bus_set_sync_records(r.bus, r.records);
    advance(&r, 20);
    send(r.bus, 0);
    advance(&r, 160);
    cw_node_stats stats;
    assert_int_equal(cw_node_get_stats(r.bus, 1, &stats), CW_OK);
    assert_int_equal(stats.rx_frames, 1);
    free(r.bus);
    return r;
}

/* In 10 bits a receiver that is slow by 1 per cent falls behind by 1.6 quanta. Then an edge comes 1
 * or 2 quanta early. Of a fast one it comes 1 or 2 quanta late. */
TEST(a_slow_receiver_sees_edges_early_and_a_fast_one_late)
{
    const rig slow = run_frame(QUANTUM + QUANTUM / 100, 0, false);
    const rig fast = run_frame(QUANTUM - QUANTUM / 100, 0, false);
    assert_int_equal(slow.receiver.hard_syncs, 1);
    assert_true(slow.receiver.resyncs > 0);
    assert_true(slow.receiver.phase_error_tq == -1 || slow.receiver.phase_error_tq == -2);
    assert_true(slow.receiver.phase_error == slow.receiver.phase_error_tq *
                                                 (QUANTUM + QUANTUM / 100));
    assert_int_equal(fast.receiver.hard_syncs, 1);
    assert_true(fast.receiver.resyncs > 0);
    assert_true(fast.receiver.phase_error_tq == 1 || fast.receiver.phase_error_tq == 2);
}

/* In 10 bits a receiver that is slow by 1000 ppm falls behind by 0.16 quanta. So an edge comes at
 * most in the last quantum of a bit, at least 4 - 1 quanta behind a sample point. */
TEST(a_difference_of_1000_ppm_is_a_phase_error_of_one_quantum)
{
    const rig slow = run_frame(QUANTUM + QUANTUM / 1000, 0, false);
    assert_int_equal(slow.receiver.phase_error_tq, -1);
    assert_true(slow.receiver.margin > 3 * QUANTUM && slow.receiver.margin < 4 * QUANTUM);
    assert_int_equal(slow.sender.hard_syncs, 0);
}

/* The receiver's acknowledgement comes 2 x 52 ticks late, or up to a quantum less, since it leads
 * the edge that it has synchronised to. With the quantum of SJW it is 26 to 36 ticks to the sample
 * point. With 2 x 25 ticks the sender's own edges are nearer: 4 quanta behind its sample points. */
TEST(a_long_line_takes_from_the_margin_of_the_acknowledgement)
{
    const rig near = run_frame(QUANTUM, 25 * CW_TICK, false);
    const rig farther = run_frame(QUANTUM, 52 * CW_TICK, false);
    assert_true(near.sender.margin == 4 * QUANTUM);
    assert_true(farther.sender.margin >= 26 * CW_TICK && farther.sender.margin <= 36 * CW_TICK);
}

/* Returns how many synchronisations of the receiver the events report, hard ones or others. All
 * events are kept in `kept`, but for synchronisations. */
static unsigned count_events(cw_bus *bus, bool hard, cw_event *kept, unsigned *kept_count)
{
    unsigned count = 0;
    cw_event e;
    memset(&e, 0, sizeof e); /* events without a frame have no data */
    *kept_count = 0;
    while (cw_bus_poll(bus, &e)) {
        if (e.kind != CW_EVENT_SYNC) {
            kept[(*kept_count)++] = e;
            continue;
        }
        count += e.hard == hard && e.nodes == 2;
        assert_true(e.hard ? e.phase_error_tq == 0 : e.phase_error_tq != 0);
        assert_true(e.phase_error == e.phase_error_tq * (QUANTUM + QUANTUM / 100));
    }
    return count;
}

/* The events agree with the statistics, and all other events are the same with and without them. */
TEST(synchronisations_are_events_when_asked_for)
{
    cw_event events[2][16];
    unsigned counts[2];
    for (unsigned hard = 0; hard < 2; hard++) {
        rig r = {.bus = make_bus(QUANTUM + QUANTUM / 100, 0)};
        cw_bus_set_sync_records(r.bus, r.records);
        cw_bus_set_events(r.bus, UINT32_MAX);
        advance(&r, 20);
        send(r.bus, 0);
        advance(&r, 160);
        const unsigned expected = (unsigned)(hard ? r.receiver.hard_syncs : r.receiver.resyncs);
        assert_true(expected > 0);
        assert_int_equal(count_events(r.bus, hard, events[0], &counts[0]), expected);
        free(r.bus);
    }
    rig r = {.bus = make_bus(QUANTUM + QUANTUM / 100, 0)};
    assert_int_equal(cw_bus_advance(r.bus, 20 * BIT_TICKS), CW_OK);
    send(r.bus, 0);
    assert_int_equal(cw_bus_advance(r.bus, 180 * BIT_TICKS), CW_OK);
    assert_int_equal(count_events(r.bus, false, events[1], &counts[1]), 0);
    assert_int_equal(counts[0], counts[1]);
    assert_memory_equal(events[0], events[1], counts[0] * sizeof events[0][0]);
    free(r.bus);
}

/* The receiver's event comes at the end of the bit that has been moved, SOF. */
TEST(a_hard_synchronisation_comes_at_the_end_of_sof)
{
    rig r = {.bus = make_bus(QUANTUM, 25 * CW_TICK)};
    cw_bus_set_events(r.bus, 1u << CW_EVENT_SYNC);
    assert_int_equal(cw_bus_advance(r.bus, 20 * BIT_TICKS), CW_OK);
    send(r.bus, 0);
    assert_int_equal(cw_bus_advance(r.bus, 40 * BIT_TICKS), CW_OK);
    cw_event e;
    assert_true(cw_bus_poll(r.bus, &e));
    assert_true(e.kind == CW_EVENT_SYNC && e.hard && e.nodes == 2);
    /* 25 ticks on the way are in the third quantum; SOF begins with it and lasts 16 */
    assert_int_equal(e.tick, 20 * BIT_TICKS + 20 + BIT_TICKS);
    free(r.bus);
}

TEST(common_bits_report_nothing)
{
    rig r = {.bus = make_bus(QUANTUM, 0)};
    cw_bus_set_own_clocks(r.bus, true);
    cw_bus_set_events(r.bus, 1u << CW_EVENT_SYNC);
    send(r.bus, 0);
    assert_int_equal(cw_bus_advance(r.bus, 200 * BIT_TICKS), CW_OK);
    cw_event e;
    assert_false(cw_bus_poll(r.bus, &e));
    free(r.bus);
}

TEST(a_node_that_is_off_the_bus_has_no_synchronisations)
{
    rig r = {.bus = make_bus(QUANTUM + QUANTUM / 100, 25 * CW_TICK)};
    cw_event e;
    cw_bus_set_events(r.bus, 1u << CW_EVENT_SYNC);
    cw_bus_set_sync_records(r.bus, r.records);
    assert_int_equal(cw_node_attach(r.bus, 1, false), CW_OK);
    send(r.bus, 0);
    advance(&r, 200);
    while (cw_bus_poll(r.bus, &e))
        assert_int_equal(e.nodes, 1);
    assert_int_equal(r.receiver.hard_syncs + r.receiver.resyncs, 0);
    free(r.bus);
}

static void assert_empty(const cw_sync_stats *s)
{
    assert_int_equal(s->hard_syncs, 0);
    assert_int_equal(s->resyncs, 0);
    assert_true(s->phase_error == 0 && s->phase_error_tq == 0 && s->margin == CW_NO_MARGIN);
}

TEST(common_bits_count_nothing_on_the_grid_and_off_it)
{
    for (unsigned own = 0; own < 2; own++) {
        const rig r = run_frame(QUANTUM, 0, own);
        assert_empty(&r.sender);
        assert_empty(&r.receiver);
    }
}

TEST(statistics_go_on_when_another_bus_takes_over)
{
    rig old = {.bus = make_bus(QUANTUM, 25 * CW_TICK)};
    cw_bus_set_sync_records(old.bus, old.records);
    advance(&old, 20);
    send(old.bus, 0);
    advance(&old, 160);
    rig now = {.bus = make_bus(QUANTUM, 25 * CW_TICK)};
    cw_event e;
    while (cw_bus_poll(old.bus, &e))
        continue;
    cw_bus_set_sync_records(now.bus, now.records);
    assert_int_equal(cw_bus_take_over(now.bus, old.bus, (const uint8_t[]){1, 0}), CW_OK);
    advance(&now, 0);
    assert_true(old.receiver.hard_syncs > 0);
    assert_int_equal(now.sender.hard_syncs, old.receiver.hard_syncs);
    assert_int_equal(now.sender.resyncs, old.receiver.resyncs);
    assert_true(now.sender.phase_error == old.receiver.phase_error);
    assert_true(now.sender.margin == old.receiver.margin);
    assert_true(now.receiver.margin == old.sender.margin);
    send(now.bus, 0);
    advance(&now, 160);
    assert_true(now.receiver.hard_syncs == old.sender.hard_syncs + 1);
    free(old.bus);
    free(now.bus);
}

TEST(without_records_nothing_is_counted)
{
    FREED cw_bus *bus = make_bus(QUANTUM, 0);
    cw_sync_stats stats;
    assert_int_equal(cw_node_get_sync_stats(bus, 0, &stats), CW_REFUSED);
    assert_int_equal(cw_node_get_sync_stats(bus, 2, &stats), CW_INVALID);
}

TEST(the_sum_has_the_largest_phase_error_and_the_least_margin)
{
    cw_sync_stats sum = {.hard_syncs = 1, .resyncs = 2, .phase_error_tq = 2, .phase_error = 20,
                         .margin = 7};
    const cw_sync_stats early = {.resyncs = 3, .phase_error_tq = -3, .phase_error = -30,
                                 .margin = CW_NO_MARGIN};
    const cw_sync_stats late = {.hard_syncs = 4, .phase_error_tq = 1, .phase_error = 10,
                                .margin = 5};
    cw_sync_stats_add(&sum, &early);
    cw_sync_stats_add(&sum, &late);
    assert_int_equal(sum.hard_syncs, 5);
    assert_int_equal(sum.resyncs, 5);
    assert_int_equal(sum.phase_error_tq, -3);
    assert_int_equal(sum.phase_error, -30);
    assert_int_equal(sum.margin, 5);
}
