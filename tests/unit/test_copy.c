/* SPDX-License-Identifier: MIT
 *
 * test_copy.c - a bus is taken back to a copy of it, and the next event is known before it comes.
 */
#include "rig.h"

#define ALL ((1u << CW_EVENT_COUNT) - 1)

/* Allocates the memory of a copy. */
static void *room_for_copy(const rig *r)
{
    void *copy = malloc(cw_bus_copy_size(r->bus));
    assert_non_null(copy);
    return copy;
}

/* Hands in frames of all nodes, which meet errors of a noisy rule. */
static rig *busy_rig(void)
{
    rig *r = rig_new(3);
    cw_rule *noise = rig_flip(r, "noise", CW_FIELD_DATA, 3);
    noise->probability = UINT64_MAX / 3;
    rig_start(r);
    for (unsigned i = 0; i < 60; i++) {
        const cw_frame frame = rig_frame(0x100 + 7 * (i % 11), 0, 1 + i % 8);
        rig_send(r, i % 3, &frame, i * 90 * BIT + i);
    }
    return r;
}

TEST(what_follows_a_copy_follows_it_again)
{
    RIG *r = busy_rig();
    RIG *again = rig_new(3); /* for the events of the second time */
    const uint64_t end = 9000 * BIT;
    rig_run(r, 1234 * BIT + 77); /* in a frame */
    void *copy = room_for_copy(r);
    cw_bus_copy(r->bus, copy);
    const cw_bus_stats before = rig_bus_stats(r);
    r->count = 0;
    rig_run(r, end);
    const cw_bus_stats after = rig_bus_stats(r);
    cw_bus_restore(r->bus, copy);
    const cw_bus_stats back = rig_bus_stats(r);
    assert_memory_equal(&before, &back, sizeof before);
    again->bus = r->bus;
    rig_run(again, end);
    const cw_bus_stats twice = rig_bus_stats(r);
    assert_true(rig_count(r, CW_EVENT_ERROR, -1) > 10);
    rig_assert_same_events(r, again);
    assert_memory_equal(&after, &twice, sizeof after);
    free(copy);
}

TEST(a_copy_has_the_events_that_wait)
{
    RIG *r = busy_rig();
    cw_event first;
    cw_event same;
    assert_int_equal(cw_bus_advance(r->bus, 500 * BIT), CW_OK);
    void *copy = room_for_copy(r);
    cw_bus_copy(r->bus, copy);
    assert_true(cw_bus_poll(r->bus, &first));
    rig_run(r, 8000 * BIT);
    cw_bus_restore(r->bus, copy);
    assert_true(cw_bus_poll(r->bus, &same));
    assert_int_equal(first.tick, same.tick);
    assert_int_equal(first.kind, same.kind);
    free(copy);
}

TEST(a_copy_has_the_records_of_synchronisations)
{
    RIG *r = rig_new(2);
    cw_sync_record records[2];
    cw_sync_stats before;
    cw_sync_stats after;
    const cw_frame frame = rig_frame(0x155, 0, 8);
    r->nodes[1].timing.bit = (cw_bit_timing){.quantum = CW_TICK * BIT / 16 + CW_TICK / 100,
                                             .prop_seg = 5, .phase_seg1 = 8, .phase_seg2 = 2,
                                             .sjw = 1};
    rig_start(r);
    cw_bus_set_sync_records(r->bus, records);
    for (unsigned i = 0; i < 9; i++)
        rig_send(r, 0, &frame, i * 200 * BIT);
    rig_run(r, 700 * BIT);
    assert_int_equal(cw_node_get_sync_stats(r->bus, 1, &before), CW_OK);
    void *copy = room_for_copy(r);
    cw_bus_copy(r->bus, copy);
    rig_run(r, 1900 * BIT);
    assert_int_equal(cw_node_get_sync_stats(r->bus, 1, &after), CW_OK);
    assert_memory_not_equal(&before, &after, sizeof before);
    cw_bus_restore(r->bus, copy);
    assert_int_equal(cw_node_get_sync_stats(r->bus, 1, &after), CW_OK);
    assert_memory_equal(&before, &after, sizeof before);
    free(copy);
}

TEST(a_new_bus_has_a_small_copy)
{
    RIG *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    rig_start(r);
    assert_true(cw_bus_copy_size(r->bus) < cw_bus_size(&r->config) / 2);
    rig_send(r, 0, &frame, 0);
    assert_int_equal(cw_bus_copy_size(r->bus), cw_bus_size(&r->config));
}

TEST(buses_of_one_process_know_nothing_of_each_other)
{
    RIG *a = busy_rig();
    RIG *b = busy_rig();
    RIG *alone = busy_rig();
    rig_run(alone, 9000 * BIT);
    for (unsigned n = 1; n <= 90; n++) {
        rig_run(a, n * 100 * BIT);
        rig_run(b, n * 100 * BIT);
    }
    assert_true(alone->count > 60);
    rig_assert_same_events(alone, a);
    rig_assert_same_events(alone, b);
}

/* Goes from event to event of these kinds, and finds each at the tick that was foreseen. */
static void go_by_events(rig *r, uint32_t kinds, uint64_t until)
{
    uint64_t tick;
    void *copy = malloc(cw_bus_size(&r->config));
    assert_non_null(copy);
    while ((tick = cw_bus_next_event(r->bus, copy, kinds, until)) != CW_NEVER) {
        const size_t had = r->count;
        rig_run(r, tick - 1);
        for (size_t i = had; i < r->count; i++)
            assert_false(kinds >> r->events[i].kind & 1u);
        rig_run(r, tick);
        bool came = false;
        for (size_t i = had; i < r->count; i++)
            came = came || (kinds >> r->events[i].kind & 1u && r->events[i].tick == tick);
        assert_true(came);
    }
    rig_run(r, until);
    free(copy);
}

TEST(each_event_comes_at_the_tick_that_was_foreseen)
{
    static const uint32_t kinds[] = {ALL & CW_EVENTS_USUAL, 1u << CW_EVENT_TX, 1u << CW_EVENT_RX,
                                     1u << CW_EVENT_ERROR | 1u << CW_EVENT_TX};
    RIG *alone = busy_rig();
    rig_run(alone, 9000 * BIT);
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        RIG *r = busy_rig();
        go_by_events(r, kinds[i], 9000 * BIT);
        rig_assert_same_events(alone, r);
    }
}

/* cw_bus_next() is that tick, and an advance to it does nothing. */
TEST(a_frame_that_comes_inside_a_bit_does_not_stop_the_look)
{
    RIG *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    const uint64_t inside = 100 * BIT + 1;
    rig_start(r);
    rig_send(r, 0, &frame, inside);
    rig_run(r, inside);
    assert_int_equal(cw_bus_now(r->bus), 100 * BIT);
    assert_int_equal(cw_bus_next(r->bus), inside);
    void *copy = room_for_copy(r);
    const uint64_t tx = cw_bus_next_event(r->bus, copy, 1u << CW_EVENT_TX, 1000 * BIT);
    rig_run(r, 1000 * BIT);
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->tick, tx);
    free(copy);
}

/* The kinds need not be kept, and what waits to be taken stays. */
TEST(a_look_takes_no_event_and_changes_no_kinds)
{
    RIG *r = busy_rig();
    cw_event event;
    cw_bus_set_events(r->bus, 1u << CW_EVENT_TX);
    assert_int_equal(cw_bus_advance(r->bus, 400 * BIT), CW_OK);
    const unsigned waits = cw_bus_peek(r->bus).count;
    assert_true(waits > 0);
    void *copy = room_for_copy(r);
    const uint64_t rx = cw_bus_next_event(r->bus, copy, 1u << CW_EVENT_RX, 9000 * BIT);
    assert_in_range(rx, 400 * BIT + 1, 9000 * BIT);
    assert_int_equal(cw_bus_now(r->bus), 400 * BIT);
    assert_int_equal(cw_bus_peek(r->bus).count, waits);
    while (cw_bus_poll(r->bus, &event))
        assert_int_equal(event.kind, CW_EVENT_TX);
    assert_int_equal(cw_bus_next_event(r->bus, copy, 0, 9000 * BIT), CW_NEVER);
    free(copy);
}
