/* SPDX-License-Identifier: MIT
 *
 * test_timing.c - bit timings: what segments mean (T1, T10), limits of controllers, and the steps
 * that lead from delays to segments. test_timing_kernel.c has the other method.
 */
#include "cases.h"
#include "timing/request.h"

#include "base/text/wide.h"

#include "found_timing.h"

#define MHZ 1000000u
#define KBIT 1000u

static uint32_t least(uint32_t a, uint32_t b)
{
    return a < b ? a : b;
}

/* ---- What segments mean ---------------------------------------------------------------------- */

/* Asserts that a result is numerator / denominator in ppb, rounded down. */
static void assert_ppb(uint32_t ppb, uint64_t numerator, uint64_t denominator)
{
    uint64_t rest;
    wide exact = wide_divide(&rest, wide_product(numerator, TIMING_ONE_PPB), denominator);

    assert_int_equal(exact.high, 0);
    assert_int_equal(ppb, exact.low);
}

TEST(fractions_are_exact_up_to_the_largest_segments)
{
    bit_timing t = {.clock_hz = 80 * MHZ, .brp = 1};

    for (t.prop_seg = 1; t.prop_seg <= 128; t.prop_seg += 9)
        for (t.phase_seg1 = 1; t.phase_seg1 <= 128; t.phase_seg1 += 7)
            for (t.phase_seg2 = 1; t.phase_seg2 <= 128; t.phase_seg2 += 5) {
                uint64_t quanta = 1u + t.prop_seg + t.phase_seg1 + t.phase_seg2;
                uint32_t shorter = least(t.phase_seg1, t.phase_seg2);
                t.sjw = shorter;

                assert_int_equal(timing_quanta(&t), quanta);
                assert_ppb(timing_sample_point_ppb(&t), quanta - t.phase_seg2, quanta);
                assert_ppb(timing_tolerance_of_sjw_ppb(&t), t.sjw, 20 * quanta);
                assert_ppb(timing_tolerance_of_phases_ppb(&t), shorter,
                           2 * (13 * quanta - t.phase_seg2));
            }
}

/* T10: the largest tolerance of classical CAN is 1.58 %. */
TEST(the_largest_classical_tolerance_is_that_of_bosch)
{
    const bit_timing t = {8 * MHZ, 1, 1, 4, 4, 4};

    assert_int_equal(timing_tolerance_ppb(&t) / 100000, 158);
}

TEST(bit_rates_are_compared_exactly)
{
    const bit_timing even = {16 * MHZ, 2, 4, 5, 6, 4};
    const bit_timing odd = {33333333, 6, 4, 4, 2, 1};
    const bit_timing slow = {UINT32_MAX, 1024, 128, 128, 128, 1};

    assert_true(timing_bitrate_is(&even, 500 * KBIT));
    assert_false(timing_bitrate_is(&even, 500 * KBIT + 1));
    assert_int_equal(timing_bit_clocks(&even), 32);
    assert_int_equal(timing_bitrate_bps(&odd), 505050);
    assert_false(timing_bitrate_is(&odd, 505050));
    assert_false(timing_bitrate_is(&slow, 4294967295u / 1024));
}

TEST(spans_are_rounded_up_to_quanta)
{
    static const struct {
        uint32_t clock_hz, brp;
        uint64_t ns, quanta;
    } cases[] = {
        {16 * MHZ, 2, 500, 4},
        {16 * MHZ, 1, 600, 10},
        {16 * MHZ, 1, 0, 0},
        {16 * MHZ, 1, 1, 1},
        {16 * MHZ, 1, 125, 2},
        {16 * MHZ, 1, 126, 3},
        {33333333, 1, 30, 1},
        {33333333, 1, 31, 2},
        {UINT32_MAX, 1, TIMING_NS_MAX, UINT32_MAX},
        {1, 1024, TIMING_NS_MAX, 1},
    };

    for (size_t i = 0; i < COUNT(cases); i++)
        assert_int_equal(timing_quanta_of_ns(cases[i].clock_hz, cases[i].brp, cases[i].ns),
                         cases[i].quanta);
}

TEST(quanta_have_a_length)
{
    const bit_timing t = {16 * MHZ, 1, 10, 2, 3, 2};
    const bit_timing third = {3, 1, 10, 2, 3, 2};

    assert_int_equal(timing_quanta_ps(&t, 1), 62500);
    assert_int_equal(timing_quanta_ps(&t, 10), 625000);
    assert_int_equal(timing_quanta_ps(&third, 1), UINT64_C(333333333333));
}

/* ---- Controllers ----------------------------------------------------------------------------- */

TEST(controllers_have_names_of_their_own_and_possible_limits)
{
    size_t count;
    const timing_limits *all = timing_controllers(&count);

    assert_string_equal(all[0].name, "any");
    for (size_t i = 0; i < count; i++) {
        assert_ptr_equal(timing_controller(all[i].name), &all[i]);
        assert_true(all[i].tseg1_min >= 1 && all[i].tseg1_min <= all[i].tseg1_max);
        assert_true(all[i].tseg2_min >= 1 && all[i].tseg2_min <= all[i].tseg2_max);
        assert_true(all[i].sjw_max >= 1 && all[i].sjw_max <= all[i].tseg2_max);
        assert_true(all[i].brp_step >= 1 && timing_has_brp(&all[i], all[i].brp_max));
    }
    assert_null(timing_controller("sja1001"));
    assert_null(timing_controller(""));
}

/* Rows of bittiming_const, data_bittiming_const and tdc_const of Linux drivers. */
TEST(data_phases_are_those_of_linux)
{
    static const struct {
        const char *name;
        uint32_t tseg1_max, tseg2_max, sjw_max, brp_max, tdco_max;
    } rows[] = {
        {"flexcan_fd", 39, 8, 4, 1024, 31},     {"m_can", 32, 16, 16, 32, 127},
        {"mcp251xfd", 32, 16, 16, 256, 63},     {"rcar_canfd_gen4", 32, 16, 16, 256, 256},
        {"rockchip_canfd", 32, 16, 16, 512, 63}, {"kvaser_pciefd", 512, 32, 16, 8192, 65535},
    };

    for (size_t i = 0; i < COUNT(rows); i++) {
        const timing_limits *limits = timing_controller(rows[i].name);
        const timing_limits *data = timing_data_limits(limits);
        assert_int_equal(data->tseg1_max, rows[i].tseg1_max);
        assert_int_equal(data->tseg2_max, rows[i].tseg2_max);
        assert_int_equal(data->sjw_max, rows[i].sjw_max);
        assert_int_equal(data->brp_max, rows[i].brp_max);
        assert_int_equal(timing_tdco_max(limits), rows[i].tdco_max);
    }
    assert_null(timing_data_limits(timing_controller("sja1000")));
}

/* As can_calc_tdco(): up to the sample point in clocks, or what the register holds. */
TEST(linux_compensates_up_to_the_sample_point)
{
    const bit_timing data = {80 * MHZ, 2, 7, 7, 5, 2};

    assert_int_equal(timing_linux_tdco(&data, timing_controller("any")), 30);
    assert_int_equal(timing_linux_tdco(&data, timing_controller("xilinx_canfd")), 30);
    const bit_timing long_bit = {80 * MHZ, 2, 15, 16, 8, 4};
    assert_int_equal(timing_linux_tdco(&long_bit, timing_controller("m_can")), 64);
    assert_int_equal(timing_linux_tdco(&long_bit, timing_controller("mcp251xfd")), 63);
    assert_int_equal(timing_linux_tdco(&long_bit, timing_controller("flexcan_fd")), 31);
}

TEST(the_message_names_the_segment_and_what_is_allowed)
{
    static const struct {
        const char *controller;
        bit_timing t;
        const char *problem; /* NULL: it fits */
    } cases[] = {
        {"sja1000", {MHZ, 64, 8, 8, 8, 4}, NULL},
        {"sja1000", {MHZ, 1, 0, 1, 1, 1}, NULL},
        {"sja1000", {MHZ, 1, 9, 8, 8, 4}, "prop-seg + phase-seg1 would be 17, sja1000 has 1 to 16"},
        {"mcp2515", {MHZ, 1, 1, 1, 2, 1}, "prop-seg + phase-seg1 would be 2, mcp2515 has 3 to 16"},
        {"sja1000", {MHZ, 1, 8, 8, 9, 4}, "phase-seg2 would be 9, sja1000 has 1 to 8"},
        {"any", {MHZ, 1, 8, 8, 129, 4}, "phase-seg2 would be 129, a controller has 1 to 128"},
        {"sja1000", {MHZ, 1, 8, 8, 8, 5}, "sjw would be 5, sja1000 has 1 to 4"},
        {"any",
         {MHZ, 1, 8, 3, 8, 4},
         "sjw would be 4, at most 3 and 8 are allowed, the length of the phase segments"},
        {"any",
         {MHZ, 1, 8, 8, 3, 4},
         "sjw would be 4, at most 8 and 3 are allowed, the length of the phase segments"},
        {"sja1000", {MHZ, 65, 8, 8, 8, 4}, "brp would be 65, sja1000 has 1 to 64"},
        {"at91", {MHZ, 1, 8, 8, 8, 4}, "brp would be 1, at91 has 2 to 128"},
        {"rockchip_canfd",
         {MHZ, 3, 8, 8, 8, 4},
         "brp would be 3, rockchip_canfd has multiples of 2"},
    };

    for (size_t i = 0; i < COUNT(cases); i++) {
        char problem[TIMING_PROBLEM_MAX] = "";
        bool fits = timing_fits(problem, &cases[i].t, timing_controller(cases[i].controller));

        assert_int_equal(fits, cases[i].problem == NULL);
        assert_string_equal(problem, cases[i].problem ? cases[i].problem : "");
    }
}

/* ---- From delays to segments ----------------------------------------------------------------- */

static timing_request request(uint32_t clock_hz, uint32_t bitrate_bps, uint32_t quanta)
{
    return (timing_request){.limits = timing_controller("any"),
                            .clock_hz = clock_hz,
                            .bitrate_bps = bitrate_bps,
                            .quanta = quanta};
}

static timing_request with_delay(timing_request r, uint64_t ns)
{
    r.has_round_trip = true;
    r.round_trip_ns = ns;
    return r;
}

static timing_request with_sample(timing_request r, uint32_t permille)
{
    r.sample_permille = permille;
    return r;
}

static void assert_segments(const timing_request *r, bit_timing expected)
{
    assert_found(timing_by_segments, r, expected);
}

static void assert_refused(const timing_request *r, const char *expected)
{
    assert_not_found(timing_by_segments, r, expected);
}

TEST(known_answers_of_the_classical_steps)
{
    static const struct {
        uint32_t clock_hz, bitrate_bps, quanta;
        uint64_t delay_ns;
        bit_timing t;
        uint32_t sample_ppb;
        uint32_t tolerance; /* in 0.001 %, to the nearest */
    } cases[] = {
        {16 * MHZ, 500 * KBIT, 16, 500, {0, 2, 4, 5, 6, 4}, 625000000, 1238},
        {16 * MHZ, 1000 * KBIT, 16, 600, {0, 1, 10, 2, 3, 2}, 812500000, 488},
        {10 * MHZ, 1000 * KBIT, 10, 600, {0, 1, 6, 1, 2, 1}, 800000000, 391},
        {16 * MHZ, 125 * KBIT, 16, 5300, {0, 8, 11, 2, 2, 2}, 875000000, 485},
        {16 * MHZ, 50 * KBIT, 20, 10300, {0, 16, 11, 4, 4, 4}, 800000000, 781},
    };

    for (size_t i = 0; i < COUNT(cases); i++) {
        timing_request r = with_delay(
            request(cases[i].clock_hz, cases[i].bitrate_bps, cases[i].quanta), cases[i].delay_ns);

        assert_segments(&r, cases[i].t);
        assert_int_equal(timing_sample_point_ppb(&cases[i].t), cases[i].sample_ppb);
        assert_int_equal((timing_tolerance_ppb(&cases[i].t) + 5000) / 10000, cases[i].tolerance);
    }
}

TEST(a_round_trip_that_leaves_too_little_is_refused)
{
    timing_request r = with_delay(request(8 * MHZ, 1000 * KBIT, 8), 600);

    assert_refused(&r,
                   "the round trip takes 5 of 8 tq: 2 tq left for the phase segments, 3 needed");
    r.round_trip_ns = 500;
    assert_segments(&r, (bit_timing){0, 1, 4, 1, 2, 1});
    r.round_trip_ns = 5000;
    assert_refused(&r,
                   "the round trip takes 40 of 8 tq: 0 tq left for the phase segments, 3 needed");
    r.round_trip_ns = TIMING_NS_MAX;
    assert_refused(&r, "the round trip takes 8000000 of 8 tq: 0 tq left for the phase segments, "
                       "3 needed");
}

TEST(a_delay_of_nothing_takes_one_quantum)
{
    const timing_request r = with_delay(request(10 * MHZ, 1000 * KBIT, 10), 0);

    assert_segments(&r, (bit_timing){0, 1, 1, 4, 4, 4});
}

TEST(what_phase_segments_cannot_take_goes_to_the_propagation_segment)
{
    const timing_request most = with_delay(request(25 * MHZ, 1000 * KBIT, 25), 40);
    const timing_request odd = with_delay(request(18 * MHZ, 1000 * KBIT, 18), 40);
    const timing_request odd_over = with_delay(request(19 * MHZ, 1000 * KBIT, 19), 40);

    assert_segments(&most, (bit_timing){0, 1, 8, 8, 8, 4});
    assert_segments(&odd, (bit_timing){0, 1, 1, 8, 8, 4});
    assert_segments(&odd_over, (bit_timing){0, 1, 2, 8, 8, 4});
}

TEST(a_wished_sample_point_decides_where_phase_segment_2_begins)
{
    static const struct {
        uint32_t permille;
        bit_timing t;
    } cases[] = {
        {875, {0, 2, 11, 2, 2, 2}}, {999, {0, 2, 11, 2, 2, 2}}, {813, {0, 2, 9, 3, 3, 3}},
        {750, {0, 2, 7, 4, 4, 4}},  {500, {0, 2, 1, 6, 8, 4}},  {100, {0, 2, 1, 6, 8, 4}},
        {782, {0, 2, 9, 3, 3, 3}},  {781, {0, 2, 7, 4, 4, 4}},
    };

    for (size_t i = 0; i < COUNT(cases); i++) {
        const timing_request r = with_sample(request(16 * MHZ, 500 * KBIT, 16), cases[i].permille);
        assert_segments(&r, cases[i].t);
    }
}

TEST(a_delay_limits_the_wished_sample_point)
{
    const timing_request r = with_sample(with_delay(request(16 * MHZ, 1000 * KBIT, 16), 600), 500);
    const timing_request free =
        with_sample(with_delay(request(16 * MHZ, 1000 * KBIT, 16), 60), 875);

    assert_segments(&r, (bit_timing){0, 1, 10, 1, 4, 1});
    assert_segments(&free, (bit_timing){0, 1, 11, 2, 2, 2});
}

TEST(without_a_wish_and_a_delay_the_sample_point_is_that_of_cia)
{
    const timing_request slow = request(16 * MHZ, 500 * KBIT, 0);
    const timing_request quick = request(16 * MHZ, 800 * KBIT, 0);
    const timing_request quickest = request(16 * MHZ, 1000 * KBIT, 0);

    assert_segments(&slow, (bit_timing){0, 2, 11, 2, 2, 2});
    assert_segments(&quick, (bit_timing){0, 1, 11, 4, 4, 4});
    assert_segments(&quickest, (bit_timing){0, 1, 7, 4, 4, 4});
}

TEST(a_wished_sjw_is_taken_or_refused)
{
    timing_request r = with_delay(request(16 * MHZ, 500 * KBIT, 16), 500);

    r.sjw = 1;
    assert_segments(&r, (bit_timing){0, 2, 4, 5, 6, 1});
    r.sjw = 5;
    assert_segments(&r, (bit_timing){0, 2, 4, 5, 6, 5});
    r.limits = timing_controller("sja1000");
    assert_refused(&r, "sjw would be 5, sja1000 has 1 to 4");
    r.limits = timing_controller("any");
    r.sjw = 6;
    assert_refused(&r,
                   "sjw would be 6, at most 5 and 6 are allowed, the length of the phase segments");
}

TEST(a_clock_that_cannot_be_divided_is_refused)
{
    const timing_request one = request(16 * MHZ, 500 * KBIT, 17);
    const timing_request all = request(33333333, 500 * KBIT, 0);
    const timing_request slow = request(1 * MHZ, 1000 * KBIT, 0);

    assert_refused(&one, "a clock of 16000000 Hz cannot be divided into 17 tq at 500000 bit/s");
    assert_refused(&all,
                   "a clock of 33333333 Hz cannot be divided into 8 to 25 tq at 500000 bit/s");
    assert_refused(&slow,
                   "a clock of 1000000 Hz cannot be divided into 8 to 25 tq at 1000000 bit/s");
}

TEST(limits_of_a_controller_count)
{
    timing_request r = with_delay(request(16 * MHZ, 10 * KBIT, 16), 500);

    assert_segments(&r, (bit_timing){0, 100, 1, 7, 7, 4});
    r.limits = timing_controller("sja1000");
    assert_refused(&r, "brp would be 100, sja1000 has 1 to 64");
    r.quanta = 0;
    assert_segments(&r, (bit_timing){0, 64, 8, 8, 8, 4});
}

/* ---- Properties ------------------------------------------------------------------------------ */

static const uint32_t clocks[] = {8 * MHZ,  10 * MHZ, 12 * MHZ, 16 * MHZ, 20 * MHZ, 24 * MHZ,
                                  25 * MHZ, 32 * MHZ, 40 * MHZ, 48 * MHZ, 60 * MHZ, 80 * MHZ};
static const uint32_t rates[] = {10 * KBIT,  20 * KBIT,  33333,      50 * KBIT,
                                 83333,      100 * KBIT, 125 * KBIT, 250 * KBIT,
                                 500 * KBIT, 800 * KBIT, 1000 * KBIT};
static const uint32_t samples[] = {0, 500, 750, 800, 875};
static const uint32_t delays[] = {0, 100, 600, 1000, 5300};

static void assert_rules(const bit_timing *t, const timing_request *r)
{
    char problem[TIMING_PROBLEM_MAX] = "";

    if (!timing_fits(problem, t, r->limits))
        fail_msg("%s", problem);
    assert_true(timing_bitrate_is(t, r->bitrate_bps));
    assert_in_range(timing_quanta(t), 8, 25);
    assert_true(t->prop_seg >= 1 && t->phase_seg1 >= 1);
    assert_true(t->phase_seg1 <= 8 && t->phase_seg2 >= 2 && t->phase_seg2 <= 8);
    assert_int_equal(t->sjw,
                     least(least(4, r->limits->sjw_max), least(t->phase_seg1, t->phase_seg2)));
    /* the propagation segment covers the round trip: prop_seg * brp / clock >= delay */
    assert_true((uint64_t)t->prop_seg * t->brp * 1000000000u >=
                (uint64_t)r->clock_hz * r->round_trip_ns);
}

static uint64_t sample_distance(const bit_timing *t, uint32_t permille)
{
    int64_t there = timing_sample_point_ppb(t), wished = (int64_t)permille * MHZ;

    return (uint64_t)(there < wished ? wished - there : there - wished);
}

/* Asserts that no number of quanta gives a nearer sample point, or a larger tolerance if there is
 * no wish. Returns true when there is any timing. */
static bool assert_best(const timing_request *r)
{
    timing_request one = *r;
    char problem[TIMING_PROBLEM_MAX];
    bit_timing best, other;
    bool any = false, found = timing_by_segments(&best, problem, r);

    for (one.quanta = 8; one.quanta <= 25; one.quanta++) {
        if (!timing_by_segments(&other, problem, &one))
            continue;
        any = true;
        assert_true(found);
        assert_rules(&other, r);
        if (r->sample_permille > 0)
            assert_true(sample_distance(&best, r->sample_permille) <=
                        sample_distance(&other, r->sample_permille) + 1);
        else if (r->has_round_trip)
            assert_true(timing_tolerance_ppb(&best) >= timing_tolerance_ppb(&other));
    }
    assert_int_equal(found, any);
    if (found)
        assert_rules(&best, r);
    return found;
}

static unsigned try_all_wishes(timing_request r)
{
    unsigned found = 0;

    for (size_t s = 0; s < COUNT(samples); s++) {
        r.sample_permille = samples[s];
        r.has_round_trip = false;
        r.round_trip_ns = 0;
        found += assert_best(&r);
        for (size_t d = 0; d < COUNT(delays); d++) {
            const timing_request delayed = with_delay(r, delays[d]);
            found += assert_best(&delayed);
        }
    }
    return found;
}

TEST(whatever_is_found_keeps_all_rules_and_is_the_best)
{
    size_t count;
    const timing_limits *all = timing_controllers(&count);
    unsigned found = 0;

    for (size_t i = 0; i < count; i++)
        for (size_t c = 0; c < COUNT(clocks); c++)
            for (size_t b = 0; b < COUNT(rates); b++)
                found += try_all_wishes((timing_request){
                    .limits = &all[i], .clock_hz = clocks[c], .bitrate_bps = rates[b]});
    assert_true(found > 50000);
}
