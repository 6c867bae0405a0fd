/* SPDX-License-Identifier: MIT
 *
 * test_buffers.c - what sits between controllers and hosts: acceptance filters (M12) and receive
 * buffers.
 */
#include "model.h"
#include "rig.h"

#define US 80u         /* ticks */
#define SLOT (50 * BIT)
#define FRAMES 40u

static cw_host_stats host_stats(const rig *r, unsigned node)
{
    cw_host_stats s;
    assert_int_equal(cw_node_get_host_stats(r->bus, node, &s), CW_OK);
    return s;
}

/* Returns the n-th frame that fits into a slot of 50 bits, with its intermission. */
static cw_frame short_frame(unsigned n)
{
    cw_frame f = {.id = 0x100};
    while (model_encode(&f).length > 47 || n-- > 0)
        f.id++;
    return f;
}

/* Node 0 sends frames in slots of 50 bits. */
static void send_in_slots(rig *r, unsigned count)
{
    for (unsigned i = 0; i < count; i++) {
        const cw_frame f = short_frame(i);
        rig_send(r, 0, &f, JOIN * BIT + (uint64_t)i * SLOT);
    }
}

static void balance(const rig *r)
{
    for (unsigned i = 0; i < r->config.node_count; i++) {
        const cw_node_stats s = rig_stats(r, i);
        assert_true(cw_node_stats_balance(&s));
    }
}

/* ---- Filters --------------------------------------------------------------------------------- */

static void filters_decide_what_a_host_gets_and_nothing_else(void **state)
{
    (void)state;
    static const cw_filter all_of_these = {.value = 0x100, .mask = 0x7F0, .inverted = true};
    const cw_filter some[] = {{.value = short_frame(0).id, .mask = 0x7FF},
                              {.value = short_frame(3).id, .mask = 0x7FF},
                              {.value = short_frame(4).id, .mask = 0x7FF}};
    rig *r = rig_new(3);
    r->nodes[1].host = (cw_host_config){.filters = some, .filter_count = 3};
    r->nodes[2].host = (cw_host_config){.filters = &all_of_these, .filter_count = 1};
    rig_start(r);
    send_in_slots(r, FRAMES);
    rig_run_bits(r, 60 * FRAMES);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), FRAMES);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 3);
    assert_int_equal(host_stats(r, 1).filtered, FRAMES - 3);
    for (size_t i = 0; i < r->count; i++)
        if (r->events[i].kind == CW_EVENT_RX && (r->events[i].nodes & NODE(2)))
            assert_true(r->events[i].frame.id >= 0x110);
    assert_int_equal(host_stats(r, 2).filtered + rig_count(r, CW_EVENT_RX, 2), FRAMES);
    assert_true(host_stats(r, 2).filtered > 0 && rig_count(r, CW_EVENT_RX, 2) > 0);
    balance(r);
    rig_free(r);
}

/* A node alone with the sender acknowledges frames that its host never gets, and loses REC. */
static void a_filtered_frame_is_acknowledged_and_lowers_rec(void **state)
{
    (void)state;
    static const cw_filter other = {.value = 0x7FF, .mask = 0x7FF};
    rig *r = rig_new(2);
    r->nodes[1].host = (cw_host_config){.filters = &other, .filter_count = 1};
    r->rules[r->config.rule_count++] =
        (cw_rule){.name = "rec", .action = CW_ACTION_COUNTERS, .trigger = CW_TRIGGER_TIME,
                  .nodes = NODE(1), .tec = CW_KEEP, .rec = 9, .time_end = CW_NEVER,
                  .probability = UINT64_MAX, .every = 1};
    rig_start(r);
    send_in_slots(r, 5);
    rig_run_bits(r, 400);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 5);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 0);
    assert_int_equal(rig_stats(r, 1).rec, 4);
    rig_free(r);
}

/* ---- Receive buffers ------------------------------------------------------------------------- */

static rig *slow_host(uint64_t service_ticks, unsigned buffers)
{
    rig *r = rig_new(3);
    r->nodes[1].host = (cw_host_config){.receive_buffers = (uint16_t)buffers,
                                        .service_ticks = service_ticks};
    rig_start(r);
    send_in_slots(r, FRAMES);
    rig_run_bits(r, 200 * FRAMES);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 2), FRAMES);
    assert_int_equal(rig_stats(r, 1).rx_held, 0);
    assert_int_equal(cw_bus_pending(r->bus), 0);
    balance(r);
    return r;
}

static void check_lost(uint64_t service_ticks, unsigned buffers, unsigned lost)
{
    rig *r = slow_host(service_ticks, buffers);
    assert_int_equal(rig_count(r, CW_EVENT_OVERRUN, 1), lost);
    assert_int_equal(host_stats(r, 1).overruns, lost);
    assert_int_equal(rig_stats(r, 1).rx_dropped[CW_DROP_QUEUE_FULL], lost);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 1), FRAMES - lost);
    rig_free(r);
}

/* Slots of 100 us. */
static void a_slow_host_loses_what_it_has_no_buffer_for(void **state)
{
    (void)state;
    check_lost(90 * US, 1, 0);
    check_lost(150 * US, 1, FRAMES / 2);
    check_lost(250 * US, 1, FRAMES - (FRAMES + 2) / 3);
    check_lost(150 * US, 2, 12); /* of three, one is lost, once both are full */
    check_lost(150 * US, CW_RECEIVE_BUFFERS_MAX, 0);
}

/* The host has a frame when it has fetched it; the new frame is lost, and no older one. */
static void frames_come_in_their_order_after_the_time_of_service(void **state)
{
    (void)state;
    rig *r = slow_host(150 * US, 1);
    unsigned got = 0;
    uint64_t received = 0;
    for (size_t i = 0; i < r->count; i++) {
        const cw_event *e = &r->events[i];
        if (e->kind == CW_EVENT_RX && e->nodes == NODE(2) && e->frame.id == short_frame(2 * got).id)
            received = e->tick;
        if (e->kind == CW_EVENT_RX && e->nodes == NODE(1)) {
            assert_int_equal(e->frame.id, short_frame(2 * got++).id);
            assert_in_range(e->tick, received + 150 * US, received + 150 * US + BIT - 1);
        }
    }
    assert_int_equal(got, FRAMES / 2);
    rig_free(r);
}

static void a_node_off_the_bus_drops_what_its_host_has_not_fetched(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    r->nodes[1].host = (cw_host_config){.receive_buffers = 8, .service_ticks = 10000 * US};
    rig_start(r);
    send_in_slots(r, 4);
    rig_run_bits(r, 300);
    assert_int_equal(rig_stats(r, 1).rx_held, 4);
    assert_int_equal(cw_bus_pending(r->bus), 4);
    assert_int_equal(cw_node_attach(r->bus, 1, false), CW_OK);
    rig_run_bits(r, 310);
    assert_int_equal(rig_stats(r, 1).rx_dropped[CW_DROP_LINK_DOWN], 4);
    assert_int_equal(rig_stats(r, 1).rx_held, 0);
    balance(r);
    rig_free(r);
}

/* Frames that wait go on waiting in the bus that takes over; one without buffers has them at
 * once. */
static void a_bus_that_takes_over_has_the_frames(void **state)
{
    (void)state;
    static const uint8_t from[] = {0, 1, 2};
    for (unsigned buffers = 0; buffers <= 8; buffers += 4) {
        rig *old = rig_new(3), *r = rig_new(3);
        old->nodes[1].host =
            (cw_host_config){.receive_buffers = 8, .service_ticks = 1000 * US};
        r->nodes[1].host =
            (cw_host_config){.receive_buffers = (uint16_t)buffers, .service_ticks = 1000 * US};
        rig_start(old);
        rig_start(r);
        send_in_slots(old, 4);
        rig_run_bits(old, 300);
        assert_int_equal(cw_bus_take_over(r->bus, old->bus, from), CW_OK);
        rig_run_bits(r, 310);
        assert_int_equal(rig_count(r, CW_EVENT_RX, 1), buffers ? 0 : 4);
        rig_run_bits(r, 4000);
        assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 4);
        balance(r);
        rig_free(old);
        rig_free(r);
    }
}

static void a_bus_without_any_has_no_counts(void **state)
{
    (void)state;
    cw_host_stats s;
    rig *r = rig_new(2);
    rig_start(r);
    assert_int_equal(cw_node_get_host_stats(r->bus, 1, &s), CW_REFUSED);
    assert_int_equal(cw_node_get_host_stats(r->bus, 2, &s), CW_INVALID);
    r->nodes[0].host.receive_buffers = CW_RECEIVE_BUFFERS_MAX + 1;
    assert_int_equal(cw_bus_size(&r->config), 0);
    rig_free(r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(filters_decide_what_a_host_gets_and_nothing_else),
        cmocka_unit_test(a_filtered_frame_is_acknowledged_and_lowers_rec),
        cmocka_unit_test(a_slow_host_loses_what_it_has_no_buffer_for),
        cmocka_unit_test(frames_come_in_their_order_after_the_time_of_service),
        cmocka_unit_test(a_node_off_the_bus_drops_what_its_host_has_not_fetched),
        cmocka_unit_test(a_bus_that_takes_over_has_the_frames),
        cmocka_unit_test(a_bus_without_any_has_no_counts),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
