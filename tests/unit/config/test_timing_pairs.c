/* SPDX-License-Identifier: MIT
 *
 * test_timing_pairs.c - what two nodes leave each other by T10: clocks, line, resynchronisations.
 */
#include "cases.h"
#include "timing/pairs.h"

#define MHZ 1000000u
#define PPM_IN_PPB 1000u
#define WORST 3u /* nodes of the last test */

/* 500 kbit/s in 16 tq of 125 ns, and 1 Mbit/s in 16 tq of 62.5 ns. */
static const bit_timing slow_bit = {16 * MHZ, 2, 4, 5, 6, 4};
static const bit_timing fast_bit = {16 * MHZ, 1, 10, 2, 3, 2};

static timing_node node_of(bit_timing bit, int32_t ppm, uint64_t place_ps, uint64_t transfer_ps)
{
    return (timing_node){.bit = bit,
                         .ppm = ppm,
                         .delay_tq = bit.prop_seg,
                         .place_ps = place_ps,
                         .transfer_ps = transfer_ps};
}

static uint32_t need_of(bit_timing a, int32_t ppm_a, bit_timing b, int32_t ppm_b)
{
    const timing_node one = node_of(a, ppm_a, 0, 0), other = node_of(b, ppm_b, 0, 0);
    const uint32_t need = timing_pair_of(&one, &other).need_ppb;

    assert_int_equal(timing_pair_of(&other, &one).need_ppb, need);
    return need;
}

/* ---- Clocks ---------------------------------------------------------------------------------- */

TEST(a_pair_needs_half_of_the_difference_of_its_clocks)
{
    const bit_timing ten_tq = {80 * MHZ, 16, 6, 1, 2, 1};
    const bit_timing fifteen_tq = {16 * MHZ, 2, 4, 4, 6, 4};
    const bit_timing long_bit = {1000 * MHZ, 1024, 256, 256, 128, 1};
    const bit_timing longer_bit = {1000 * MHZ, 1024, 256, 255, 128, 1};

    assert_int_equal(need_of(slow_bit, 100, slow_bit, -100), 100 * PPM_IN_PPB);
    assert_int_equal(need_of(slow_bit, 0, slow_bit, 0), 0);
    assert_int_equal(need_of(slow_bit, 0, ten_tq, 0), 0); /* another prescaler, the same rate */
    assert_int_equal(need_of(slow_bit, 0, fast_bit, 0), 333333334);          /* 1 / 3, rounded up */
    assert_int_equal(need_of(slow_bit, 0, slow_bit, 300), 149978);           /* 300 / 2.0003 ppm */
    assert_int_equal(need_of(slow_bit, 0, fifteen_tq, 0), 32258065);         /* 1 / 31 */
    assert_int_equal(need_of(slow_bit, 0, fifteen_tq, -62500), 0);           /* 15 / 16 */
    assert_int_equal(need_of(long_bit, 100000, longer_bit, 100000), 780641); /* 1 / 1281 */
    assert_int_equal(need_of(long_bit, 1, long_bit, 1), 0);
}

/* Both limits of T10: 125 kbit/s in 11-2-2, SJW 2; and PS2 - 1 only counts where it is the
 * smallest. */
TEST(the_sufficient_tolerance_has_a_phase_seg2_that_is_shorter)
{
    static const struct {
        bit_timing t;
        uint32_t tolerance_ppb;
        uint32_t sufficient_ppb;
    } cases[] = {
        {{16 * MHZ, 8, 11, 2, 2, 2}, 4854368, 2427184},   /* 2 / 412, 1 / 412 */
        {{10 * MHZ, 1, 6, 1, 2, 1}, 3906250, 3906250},    /* 1 / 256: PS1 is the smaller one */
        {{16 * MHZ, 16, 11, 4, 4, 4}, 7812500, 5859375},  /* 4 / 512, 3 / 512 */
        {{16 * MHZ, 2, 4, 5, 6, 1}, 3125000, 3125000},    /* by sjw: 1 / 320 */
        {{16 * MHZ, 2, 13, 1, 1, 1}, 2415458, 0},         /* 1 / 414 and nothing */
    };

    for (size_t i = 0; i < COUNT(cases); i++) {
        assert_int_equal(timing_tolerance_ppb(&cases[i].t), cases[i].tolerance_ppb);
        assert_int_equal(timing_sufficient_ppb(&cases[i].t), cases[i].sufficient_ppb);
    }
}

TEST(the_tolerance_of_a_pair_is_the_smaller_one)
{
    const bit_timing small = {16 * MHZ, 16, 11, 4, 4, 4};
    const bit_timing smaller = {16 * MHZ, 16, 11, 4, 4, 1}; /* 1 / 400 */
    const timing_node a = node_of(small, 3000, 0, 0), b = node_of(smaller, -3000, 0, 0);
    const timing_pair pair = timing_pair_of(&a, &b);

    assert_int_equal(pair.tolerance_ppb, 2500 * PPM_IN_PPB);
    assert_int_equal(pair.sufficient_ppb, 2500 * PPM_IN_PPB);
    assert_int_equal(timing_tolerance_left_ppb(&pair), -500 * (int)PPM_IN_PPB);
    assert_int_equal(timing_sufficient_left_ppb(&pair), -500 * (int)PPM_IN_PPB);
}

TEST(the_limit_depends_on_whether_a_round_trip_takes_a_quantum)
{
    const bit_timing bit = {16 * MHZ, 8, 11, 2, 2, 2}; /* tq of 500 ns */
    timing_node a = node_of(bit, 0, 0, 0), b = node_of(bit, 0, 0, 499999);
    timing_pair pair = timing_pair_of(&a, &b);

    assert_int_equal(timing_limit_ppb(&pair), 2427184);
    b.transfer_ps++;
    pair = timing_pair_of(&a, &b);
    assert_int_equal(timing_limit_ppb(&pair), 4854368);
}

/* ---- The line -------------------------------------------------------------------------------- */

/* 10 tq of 62.5 ns are 625 ns. Two transfers of 150 ns leave 325 ns: 162.5 ns one way. */
TEST(the_longest_line_fills_prop_seg)
{
    const timing_node a = node_of(fast_bit, 0, 500000, 150000);
    timing_node b = node_of(fast_bit, 0, 662500, 150000);
    timing_pair pair = timing_pair_of(&a, &b);

    assert_int_equal(pair.round_trip_ps, 625000);
    assert_int_equal(pair.delays_ps, 625000);
    assert_int_equal(pair.longest_ps, 162500);
    assert_int_equal(timing_delays_left_ps(&pair), 0);
    b.stub_ps = 1;
    pair = timing_pair_of(&b, &a);
    assert_int_equal(pair.longest_ps, 162500);
    assert_int_equal(timing_delays_left_ps(&pair), -2);
    b.transfer_ps = 475000;
    pair = timing_pair_of(&a, &b);
    assert_int_equal(pair.longest_ps, 0);
    b.transfer_ps = 1000000;
    pair = timing_pair_of(&a, &b);
    assert_int_equal(pair.longest_ps, 0);
    assert_int_equal(timing_delays_left_ps(&pair), -850002);
}

TEST(the_node_with_less_time_for_delays_limits_a_pair)
{
    const timing_node a = node_of(fast_bit, 0, 0, 0), b = node_of(slow_bit, 0, 0, 0);

    assert_int_equal(timing_pair_of(&a, &b).delays_ps, 500000);
    assert_int_equal(timing_pair_of(&b, &a).delays_ps, 500000);
}

/* ---- Resynchronisations ---------------------------------------------------------------------- */

/* With 16 tq the phase error of ten bits is 320 x need tq. There are 14 edges up to the end of the
 * CRC, and that of ACK is 8 bits later. */
TEST(edges_are_counted_that_are_off_by_a_quantum)
{
    static const struct {
        uint32_t need_ppm;
        uint32_t sjw;
        unsigned count;
    } cases[] = {
        {0, 4, 0},
        {100, 4, 0},     /* 0.4736 tq in 148 bits */
        {211, 4, 0},     /* 0.9993 */
        {212, 4, 1},     /* 1.0041: the edge of ACK */
        {1000, 4, 4},    /* 0.32 an edge: the 4th, 7th, 10th and 13th */
        {3125, 4, 14},   /* 1 an edge, and 0.8 at ACK */
        {5000, 4, 15},   /* 1.6 an edge */
        {5000, 1, 15},   /* the error is never caught up */
        {500000, 4, 15},
    };

    for (size_t i = 0; i < COUNT(cases); i++) {
        bit_timing t = slow_bit;
        t.sjw = cases[i].sjw;
        assert_int_equal(timing_resynchronisations(&t, cases[i].need_ppm * PPM_IN_PPB),
                         cases[i].count);
    }
}

/* ---- All nodes of a bus ---------------------------------------------------------------------- */

TEST(the_worst_nodes_are_found_for_clock_and_line)
{
    const timing_node nodes[WORST] = {
        node_of(slow_bit, 0, 0, 0),
        node_of(slow_bit, 200, 10000, 0),
        node_of(slow_bit, 0, 50000, 0),
    };
    const timing_worst first = timing_worst_of(nodes, WORST, 0);
    const timing_worst second = timing_worst_of(nodes, WORST, 1);
    const timing_worst third = timing_worst_of(nodes, WORST, 2);

    assert_int_equal(first.clock, 1);
    assert_int_equal(first.line, 2);
    assert_int_equal(first.line_pair.round_trip_ps, 100000);
    assert_int_equal(second.clock, 0);
    assert_int_equal(second.line, 2);
    assert_int_equal(third.clock, 1);
    assert_int_equal(third.line, 0);
    assert_int_equal(third.resynchronisations, 0);
}
