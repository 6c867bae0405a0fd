/* SPDX-License-Identifier: MIT
 *
 * test_data_phase.c - both bit timings of a CAN FD node: one prescaler for both, and T10.
 * tests/tool/test_timing.py compares the tolerance with python-can.
 */
#include "cases.h"
#include "timing/data_phase.h"

#define MHZ 1000000u
#define KBIT 1000u

static timing_request request(const timing_limits *limits, uint32_t clock_hz, uint32_t bitrate_bps)
{
    return (timing_request){.limits = limits, .clock_hz = clock_hz, .bitrate_bps = bitrate_bps};
}

typedef struct both {
    timing_request slow, fast;
} both;

static both of(const char *controller, uint32_t clock_mhz, uint32_t kbit, uint32_t dkbit)
{
    const timing_limits *limits = timing_controller(controller);
    return (both){request(limits, clock_mhz * MHZ, kbit * KBIT),
                  request(timing_data_limits(limits), clock_mhz * MHZ, dkbit * KBIT)};
}

/* ---- One prescaler --------------------------------------------------------------------------- */

/* The sample points are 87.5 % and 75 %; one of 500 kbit/s in the data phase is 87.5 %. */
TEST(the_smallest_common_prescaler_is_taken)
{
    static const struct {
        const char *controller;
        uint32_t clock_mhz, kbit, dkbit, brp;
    } cases[] = {
        {"any", 80, 500, 2000, 1},
        {"m_can", 80, 500, 2000, 1},
        {"rockchip_canfd", 80, 500, 2000, 2}, /* it has only even ones */
        {"any", 40, 500, 2000, 1},
        {"any", 80, 125, 2000, 5},  /* neither 320 tq nor 10 tq have the sample point */
        {"ctucanfd", 80, 500, 500, 2}, /* 126 tq at most */
        {"any", 80, 500, 500, 5}, /* 33 tq at most before the sample point */
        {"any", 10, 500, 3000, 0}, /* 3.333 clocks */
    };

    for (size_t i = 0; i < COUNT(cases); i++) {
        const both b = of(cases[i].controller, cases[i].clock_mhz, cases[i].kbit, cases[i].dkbit);
        const uint32_t brp = timing_common_brp(&b.slow, &b.fast);
        if (brp != cases[i].brp)
            fail_msg("case %zu: %u", i, brp);
    }
}

TEST(without_a_common_prescaler_each_phase_is_as_linux_finds_it)
{
    timing_limits narrow = *timing_data_limits(timing_controller("any"));
    both b = of("any", 80, 500, 2000);
    bit_timing slow, fast, alone;
    char problem[TIMING_PROBLEM_MAX];

    narrow.brp_min = 5;
    narrow.brp_step = 5;
    b.fast.limits = &narrow; /* 8 tq: 75 %; 160 clocks in steps of 5: 32 tq, 87.5 % */
    assert_int_equal(timing_common_brp(&b.slow, &b.fast), 5);
    b.fast.sample_permille = 800; /* 8 tq do not have it, but come near */
    b.slow.sample_permille = 881; /* 141 of 160 tq: only brp 1 */
    assert_int_equal(timing_common_brp(&b.slow, &b.fast), 0);
    assert_true(timing_by_rates(&slow, &fast, problem, &b.slow, &b.fast));
    assert_true(timing_by_kernel(&alone, problem, &b.slow));
    assert_memory_equal(&slow, &alone, sizeof slow);
    assert_true(timing_by_kernel(&alone, problem, &b.fast));
    assert_memory_equal(&fast, &alone, sizeof fast);
    assert_int_equal(slow.brp, 1);
    assert_int_equal(fast.brp, 5);
}

TEST(both_have_their_rates_and_one_quantum)
{
    static const uint32_t clocks_mhz[] = {20, 24, 40, 60, 80, 160};
    static const uint32_t rates_kbit[] = {1000, 2000, 4000, 5000};
    char problem[TIMING_PROBLEM_MAX];
    unsigned common = 0;

    for (size_t i = 0; i < COUNT(clocks_mhz); i++)
        for (size_t k = 0; k < COUNT(rates_kbit); k++) {
            const both b = of("any", clocks_mhz[i], 500, rates_kbit[k]);
            bit_timing slow, fast;
            const uint32_t brp = timing_common_brp(&b.slow, &b.fast);
            if (brp == 0)
                continue;
            common++;
            assert_true(timing_by_rates(&slow, &fast, problem, &b.slow, &b.fast));
            assert_int_equal(slow.brp, brp);
            assert_int_equal(fast.brp, brp);
            assert_true(timing_bitrate_is(&slow, b.slow.bitrate_bps));
            assert_true(timing_bitrate_is(&fast, b.fast.bitrate_bps));
        }
    assert_true(common >= COUNT(clocks_mhz) * COUNT(rates_kbit) / 2);
}

TEST(a_known_nominal_bit_gives_its_prescaler)
{
    const both b = of("any", 80, 500, 2000);
    const bit_timing nominal = {80 * MHZ, 4, 17, 17, 5, 2};
    const bit_timing odd = {80 * MHZ, 16, 3, 4, 2, 1}; /* 16 clocks are no part of 40 */
    bit_timing data;
    char problem[TIMING_PROBLEM_MAX];

    assert_true(timing_data_beside(&data, problem, &nominal, &b.fast));
    assert_int_equal(data.brp, 4);
    assert_true(timing_bitrate_is(&data, 2000 * KBIT));
    assert_true(timing_data_beside(&data, problem, &odd, &b.fast));
    assert_int_equal(data.brp, 1);
    assert_true(timing_bitrate_is(&data, 2000 * KBIT));
}

TEST(a_message_says_which_phase_it_is_about)
{
    const both b = of("any", 3, 500, 2000);
    bit_timing slow, fast;
    char problem[TIMING_PROBLEM_MAX];

    assert_false(timing_by_rates(&slow, &fast, problem, &b.slow, &b.fast));
    assert_int_equal(strncmp(problem, "data phase: ", 12), 0);
}

/* ---- Tolerance (T10) ------------------------------------------------------------------------- */

/* 500 kbit/s and 2 Mbit/s of 80 MHz, 160 tq of 69-70-20/10 and 40 tq of 14-15-10/5:
 *   5 / (20 x 40)                           6250000 ppb
 *   20 / (2 x ((240 - 10) + 7 x 160))       20 / 2700
 *   5 / (2 x ((320 - 20) + 10 + 160))       5 / 940 */
TEST(the_tolerance_has_three_limits)
{
    const bit_timing slow = {80 * MHZ, 1, 69, 70, 20, 10};
    const bit_timing fast = {80 * MHZ, 1, 14, 15, 10, 5};

    assert_int_equal(timing_tolerance_of_sjw_ppb(&fast), 6250000);
    assert_int_equal(timing_tolerance_of_data_error_ppb(&slow, &fast), 7407407);
    assert_int_equal(timing_tolerance_of_switch_ppb(&slow, &fast), 5319148);
    assert_int_equal(timing_data_tolerance_ppb(&slow, &fast), 5319148);
}

/* Nominal quanta of 4 data quanta: 40 tq of 17-17-5/2 with brp 4.
 *   5 / (2 x ((240 - 10) / 4 + 7 x 40))     5 / 675
 *   (5 - 3) / (2 x ((80 - 5) x 4 + 10 + 160)) = 2 / 940; with a dsjw of 3 nothing is left */
TEST(a_coarser_nominal_quantum_takes_from_the_jump)
{
    const bit_timing slow = {80 * MHZ, 4, 17, 17, 5, 2};
    bit_timing fast = {80 * MHZ, 1, 14, 15, 10, 5};

    assert_int_equal(timing_tolerance_of_data_error_ppb(&slow, &fast), 7407407);
    assert_int_equal(timing_tolerance_of_switch_ppb(&slow, &fast), 2127659);
    fast.sjw = 3;
    assert_int_equal(timing_data_tolerance_ppb(&slow, &fast), 0);
    const bit_timing equal = {80 * MHZ, 1, 69, 70, 20, 10};
    fast = (bit_timing){80 * MHZ, 2, 7, 7, 5, 2}; /* 2 / (2 x (300 / 2 + 5 + 80)) */
    assert_int_equal(timing_tolerance_of_switch_ppb(&equal, &fast), 4255319);
}
