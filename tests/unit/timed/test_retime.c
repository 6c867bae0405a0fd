/* SPDX-License-Identifier: MIT
 *
 * test_retime.c - bit timings and delays that change while the bus runs: parts of them, limits, and
 * the way off the grid and back to it.
 */
#include "rig.h"

#define QUANTUM (CW_TICK * BIT / 20)

static const cw_bit_timing own = {.quantum = QUANTUM, .prop_seg = 8, .phase_seg1 = 6,
                                  .phase_seg2 = 5, .sjw = 4};

static rig *rig_timed(void)
{
    rig *r = rig_new(2);
    for (unsigned i = 0; i < 2; i++)
        r->nodes[i].timing.bit = own;
    rig_start(r);
    return r;
}

static cw_bit_timing timing_of(const rig *r, unsigned node)
{
    cw_settings s;
    assert_int_equal(cw_node_get_settings(r->bus, node, &s), CW_OK);
    return s.timing;
}

static cw_status set(rig *r, uint8_t which, cw_bit_timing timing)
{
    const cw_settings s = {.which = which, .timing = timing};
    return cw_node_set(r->bus, 1, &s);
}

static void check(const rig *r, const cw_bit_timing *expected)
{
    const cw_bit_timing t = timing_of(r, 1);
    assert_int_equal(t.quantum, expected->quantum);
    assert_int_equal(t.prop_seg, expected->prop_seg);
    assert_int_equal(t.phase_seg1, expected->phase_seg1);
    assert_int_equal(t.phase_seg2, expected->phase_seg2);
    assert_int_equal(t.sjw, expected->sjw);
    assert_int_equal(t.triple_sampling, expected->triple_sampling);
}

/* ---- Parts ----------------------------------------------------------------------------------- */

TEST(each_part_changes_alone)
{
    RIG *r = rig_timed();
    cw_bit_timing expected = own;
    const cw_bit_timing other = {.quantum = QUANTUM + 1, .prop_seg = 7, .phase_seg1 = 5,
                                 .phase_seg2 = 7, .sjw = 3, .triple_sampling = true};
    assert_int_equal(set(r, CW_SET_QUANTUM, other), CW_OK);
    expected.quantum = QUANTUM + 1;
    check(r, &expected);
    assert_int_equal(set(r, CW_SET_SAMPLING, other), CW_OK);
    expected.triple_sampling = true;
    check(r, &expected);
    assert_int_equal(set(r, CW_SET_QUANTUM | CW_SET_SAMPLING, own), CW_OK);
    assert_int_equal(set(r, CW_SET_SEGMENTS, other), CW_OK);
    expected = other;
    expected.quantum = QUANTUM;
    expected.triple_sampling = false;
    check(r, &expected);
    assert_int_equal(set(r, CW_SET_TIMING, own), CW_OK);
    check(r, &own);
}

/* A part is wrong together with the other parts as they are now. */
TEST(a_wrong_part_changes_nothing)
{
    RIG *r = rig_timed();
    const struct {
        uint8_t which;
        cw_bit_timing timing;
    } wrong[] = {
        {CW_SET_QUANTUM, {.quantum = 0}},
        {CW_SET_QUANTUM, {.quantum = QUANTUM * 64 + 1}}, /* 64 bits of the bus at most */
        {CW_SET_QUANTUM, {.quantum = QUANTUM / 2 - 1}},  /* room for two bits in one */
        {CW_SET_SEGMENTS, {.phase_seg1 = 6, .phase_seg2 = 5, .sjw = 6}},
        {CW_SET_SEGMENTS, {.prop_seg = 0, .phase_seg1 = 1, .phase_seg2 = 1, .sjw = 1}},
        {CW_SET_SEGMENTS | CW_SET_WARNING, {.prop_seg = 8, .phase_seg1 = 6, .sjw = 1}},
    };
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        assert_int_equal(set(r, wrong[i].which, wrong[i].timing), CW_INVALID);
        check(r, &own);
    }
    assert_true(cw_bus_is_on_grid(r->bus));
    assert_int_equal(set(r, CW_SET_QUANTUM, (cw_bit_timing){.quantum = QUANTUM * 64}), CW_OK);
    assert_int_equal(set(r, CW_SET_QUANTUM, (cw_bit_timing){.quantum = QUANTUM / 2}), CW_OK);
}

/* ---- The grid -------------------------------------------------------------------------------- */

/* Sends a frame from each node, and returns how many have been received without an error. */
static size_t exchange(rig *r)
{
    const size_t before = rig_count(r, CW_EVENT_RX, -1);
    for (unsigned i = 0; i < 2; i++) {
        const cw_frame f = rig_frame(0x100 + i, 0, 8);
        rig_send(r, i, &f, cw_bus_now(r->bus));
    }
    rig_run(r, cw_bus_now(r->bus) + 400 * BIT);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
    return rig_count(r, CW_EVENT_RX, -1) - before;
}

/* Bits still begin together when only the sample point differs. */
TEST(a_bus_leaves_the_grid_and_comes_back)
{
    RIG *r = rig_timed();
    assert_int_equal(exchange(r), 2);
    assert_true(cw_bus_is_on_grid(r->bus));
    const cw_bit_timing early = {.prop_seg = 7, .phase_seg1 = 6, .phase_seg2 = 6, .sjw = 4};
    assert_int_equal(set(r, CW_SET_SEGMENTS, early), CW_OK);
    assert_false(cw_bus_is_on_grid(r->bus));
    assert_int_equal(exchange(r), 2);
    assert_int_equal(set(r, CW_SET_SEGMENTS, own), CW_OK);
    assert_int_equal(exchange(r), 2);
    assert_true(cw_bus_is_on_grid(r->bus));
}

TEST(a_clock_becomes_slow_and_right_again)
{
    RIG *r = rig_timed();
    const cw_bit_timing slow = {.quantum = QUANTUM + QUANTUM / 1000};
    assert_int_equal(set(r, CW_SET_QUANTUM, slow), CW_OK);
    assert_false(cw_bus_is_on_grid(r->bus));
    assert_int_equal(exchange(r), 2);
    assert_int_equal(set(r, CW_SET_QUANTUM, own), CW_OK);
    assert_int_equal(exchange(r), 2);
}

/* ---- Ways ------------------------------------------------------------------------------------ */

static const cw_settings no_way = {.which = CW_SET_WAY | CW_SET_RINGING};

TEST(a_delay_takes_the_bus_off_the_grid)
{
    RIG *r = rig_timed();
    const cw_settings late = {.which = CW_SET_RX_DELAY, .rx_delay = {QUANTUM, 2 * QUANTUM}};
    assert_int_equal(exchange(r), 2);
    assert_true(cw_bus_is_on_grid(r->bus));
    assert_int_equal(cw_node_set(r->bus, 1, &late), CW_OK);
    assert_false(cw_bus_is_on_grid(r->bus));
    assert_int_equal(cw_node_set(r->bus, 1, &no_way), CW_OK);
    assert_true(cw_bus_is_on_grid(r->bus));
    assert_int_equal(cw_node_set(r->bus, 1, &late), CW_OK);
    assert_int_equal(exchange(r), 2);
    assert_int_equal(cw_node_set(r->bus, 1, &no_way), CW_OK);
    assert_int_equal(exchange(r), 2);
}

TEST(each_part_of_the_way_changes_alone)
{
    RIG *r = rig_timed();
    const cw_settings other = {.tx_delay = {1, 2}, .rx_delay = {3, 4}, .place = 5, .stub = 6,
                               .ringing = 7};
    cw_settings one = other, now;
    for (one.which = CW_SET_TX_DELAY; one.which <= CW_SET_RINGING;
         one.which = (uint16_t)(one.which * 2)) {
        assert_int_equal(cw_node_set(r->bus, 1, &no_way), CW_OK);
        assert_int_equal(cw_node_set(r->bus, 1, &one), CW_OK);
        assert_int_equal(cw_node_get_settings(r->bus, 1, &now), CW_OK);
        for (unsigned level = 0; level < 2; level++) {
            assert_int_equal(now.tx_delay[level],
                             one.which == CW_SET_TX_DELAY ? other.tx_delay[level] : 0);
            assert_int_equal(now.rx_delay[level],
                             one.which == CW_SET_RX_DELAY ? other.rx_delay[level] : 0);
        }
        assert_int_equal(now.place, one.which == CW_SET_PLACE ? 5 : 0);
        assert_int_equal(now.stub, one.which == CW_SET_STUB ? 6 : 0);
        assert_int_equal(now.ringing, one.which == CW_SET_RINGING ? 7 : 0);
    }
}

TEST(a_way_that_is_too_long_changes_nothing)
{
    RIG *r = rig_timed();
    const cw_span most = 16 * 20 * QUANTUM; /* bits */
    const cw_settings wrong[] = {
        {.which = CW_SET_TX_DELAY, .tx_delay = {most + 1, 0}},
        {.which = CW_SET_RX_DELAY, .rx_delay = {0, most + 1}},
        {.which = CW_SET_PLACE, .place = most + 1},
        {.which = CW_SET_STUB | CW_SET_PLACE, .stub = 1, .place = most},
        {.which = CW_SET_RINGING, .ringing = most + 1},
        {.which = CW_SET_PLACE, .place = -1},
        {.which = CW_SET_RINGING, .ringing = -1},
    };
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++)
        assert_int_equal(cw_node_set(r->bus, 1, &wrong[i]), CW_INVALID);
    assert_true(cw_bus_is_on_grid(r->bus));
    const cw_settings longest = {.which = CW_SET_WAY | CW_SET_RINGING, .place = most,
                                 .ringing = most};
    assert_int_equal(cw_node_set(r->bus, 1, &longest), CW_OK);
}

/* The bus remembers the last 16 ways of edges that may be under way, here for 15 bits. Nodes look
 * back by two bits more. There is an edge in each bit. */
TEST(too_many_changes_at_once_are_refused)
{
    RIG *r = rig_timed();
    unsigned taken = 0;
    cw_frame f = rig_frame(0x555, 0, 8);
    memset(f.data, 0x55, sizeof f.data);
    assert_int_equal(exchange(r), 2);
    cw_settings far = {.which = CW_SET_RX_DELAY, .rx_delay = {300 * QUANTUM, 300 * QUANTUM}};
    assert_int_equal(cw_node_set(r->bus, 1, &far), CW_OK);
    rig_send(r, 0, &f, cw_bus_now(r->bus));
    for (unsigned i = 0; i < 60; i++) {
        rig_run(r, cw_bus_now(r->bus) + BIT);
        far.rx_delay[0]--;
        taken += cw_node_set(r->bus, 1, &far) == CW_OK;
    }
    assert_in_range(taken, 20, 59);
}
