/* SPDX-License-Identifier: MIT
 *
 * test_timing_kernel.c - bit timings as Linux finds them. tests/tool/test_timing.py compares them
 * with can-calc-bit-timing of can-utils.
 */
#include "cases.h"
#include "timing/request.h"

#include "found_timing.h"

#define MHZ 1000000u
#define KBIT 1000u
#define RANDOM_REQUESTS 20000u
#define SEED UINT64_C(42)

static timing_request request(const char *controller, uint32_t clock_hz, uint32_t bitrate_bps)
{
    return (timing_request){
        .limits = timing_controller(controller), .clock_hz = clock_hz, .bitrate_bps = bitrate_bps};
}

static void assert_segments(const timing_request *r, bit_timing expected)
{
    assert_found(timing_by_kernel, r, expected);
}

static void assert_refused(const timing_request *r, const char *expected)
{
    assert_not_found(timing_by_kernel, r, expected);
}

TEST(segments_are_those_of_linux)
{
    static const struct {
        const char *controller;
        uint32_t clock_hz, bitrate_bps;
        bit_timing t;
    } cases[] = {
        {"sja1000", 8 * MHZ, 1000 * KBIT, {0, 1, 2, 3, 2, 1}},
        {"sja1000", 8 * MHZ, 800 * KBIT, {0, 1, 3, 4, 2, 1}},
        {"sja1000", 8 * MHZ, 500 * KBIT, {0, 1, 6, 7, 2, 1}},
        {"sja1000", 8 * MHZ, 10 * KBIT, {0, 50, 6, 7, 2, 1}},
        {"mscan", 32 * MHZ, 1000 * KBIT, {0, 2, 5, 6, 4, 2}},
        {"mscan", 32 * MHZ, 20 * KBIT, {0, 64, 8, 8, 8, 4}},
        {"mscan", 33 * MHZ, 800 * KBIT, {0, 3, 5, 5, 3, 1}},
        {"ti_hecc", 13 * MHZ, 125 * KBIT, {0, 13, 3, 3, 1, 1}},
        {"m_can", 80 * MHZ, 500 * KBIT, {0, 1, 69, 70, 20, 10}},
    };

    for (size_t i = 0; i < COUNT(cases); i++) {
        const timing_request r =
            request(cases[i].controller, cases[i].clock_hz, cases[i].bitrate_bps);
        assert_segments(&r, cases[i].t);
    }
}

TEST(a_wished_sample_point_is_not_exceeded)
{
    timing_request r = request("sja1000", 8 * MHZ, 500 * KBIT);

    r.sample_permille = 800;
    assert_segments(&r, (bit_timing){0, 1, 5, 6, 4, 2});
    r.sample_permille = 900;
    assert_segments(&r, (bit_timing){0, 1, 6, 7, 2, 1});
    r.sample_permille = 300;
    assert_segments(&r, (bit_timing){0, 2, 0, 1, 6, 1});
    r.sample_permille = 100;
    assert_refused(&r, "sja1000 has no segments for 500000 bit/s at a clock of 8000000 Hz with a "
                       "sample point up to 10.0 %");
}

TEST(linux_5_19_began_to_take_the_smallest_prescaler)
{
    timing_request r = request("mscan", 66660000, 1000 * KBIT);

    r.sjw = 1;
    assert_segments(&r, (bit_timing){0, 3, 7, 8, 6, 1});
    r.linux_version = 519;
    assert_segments(&r, (bit_timing){0, 3, 7, 8, 6, 1});
    r.linux_version = 518;
    assert_segments(&r, (bit_timing){0, 6, 3, 4, 3, 1});
}

TEST(linux_6_3_began_to_take_a_larger_sjw)
{
    timing_request r = request("mscan", 32 * MHZ, 20 * KBIT);

    r.linux_version = 603;
    assert_segments(&r, (bit_timing){0, 64, 8, 8, 8, 4});
    r.linux_version = 602;
    assert_segments(&r, (bit_timing){0, 64, 8, 8, 8, 1});
}

TEST(a_wished_sjw_was_shortened_before_linux_6_3_and_is_refused_since)
{
    timing_request r = request("sja1000", 8 * MHZ, 500 * KBIT);

    r.sjw = 3;
    assert_refused(&r,
                   "sjw would be 3, at most 7 and 2 are allowed, the length of the phase segments");
    r.linux_version = 602;
    assert_segments(&r, (bit_timing){0, 1, 6, 7, 2, 2});
    r.sample_permille = 500;
    r.sjw = 7;
    assert_segments(&r, (bit_timing){0, 1, 3, 4, 8, 4});
}

/* 5.03 %: a tenth of a percent hides it, a hundredth does not. */
TEST(linux_6_19_began_to_count_hundredths_of_a_percent)
{
    timing_request r = request("sja1000", 5971500, 1895000);

    assert_refused(&r, "the nearest bit rate is 5.03 % off, 5 % are allowed");
    r.linux_version = 618;
    assert_segments(&r, (bit_timing){0, 1, 0, 1, 1, 1});
}

TEST(what_is_not_possible_is_refused)
{
    timing_request r = request("mscan", 32 * MHZ, 10 * KBIT);

    assert_refused(&r, "mscan has no segments for 10000 bit/s at a clock of 32000000 Hz with a "
                       "sample point up to 87.5 %");
    r = request("mcp251x", 16 * MHZ, 10 * KBIT);
    r.sample_permille = 500;
    r.linux_version = 510;
    assert_refused(&r, "mcp251x has no segments for 10000 bit/s at a clock of 16000000 Hz with a "
                       "sample point up to 50.0 %");
    r = request("sja1000", 1 * MHZ, 1000 * KBIT);
    assert_refused(&r, "the nearest bit rate is 66.66 % off, 5 % are allowed");
}

/* Returns the next number of a simple generator (splitmix64). */
static uint64_t next(uint64_t *seed)
{
    uint64_t z = *seed += UINT64_C(0x9E3779B97F4A7C15);

    z = (z ^ z >> 30) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ z >> 27) * UINT64_C(0x94D049BB133111EB);
    return z ^ z >> 31;
}

static uint32_t between(uint64_t *seed, uint32_t lowest, uint32_t highest)
{
    return lowest + (uint32_t)(next(seed) % (highest - lowest + 1u));
}

static timing_request random_request(uint64_t *seed)
{
    static const uint32_t versions[] = {0, 408, 519, 603, 619};
    size_t count;
    const timing_limits *all = timing_controllers(&count);

    return (timing_request){
        .limits = &all[between(seed, 0, (uint32_t)count - 1)],
        .clock_hz = between(seed, 1, 200) * MHZ / between(seed, 1, 3),
        .bitrate_bps = between(seed, 5, 8000) * KBIT,
        .sample_permille = next(seed) % 2 == 0 ? 0 : between(seed, 100, 999),
        .linux_version = versions[next(seed) % COUNT(versions)],
    };
}

TEST(whatever_is_found_is_within_the_limits_and_near_the_bit_rate)
{
    uint64_t seed = SEED;
    unsigned found = 0;

    for (unsigned i = 0; i < RANDOM_REQUESTS; i++) {
        const timing_request r = random_request(&seed);
        char problem[TIMING_PROBLEM_MAX] = "";
        bit_timing t;

        if (!timing_by_kernel(&t, problem, &r)) {
            assert_true(problem[0] != '\0');
            continue;
        }
        found++;
        assert_true(timing_fits(problem, &t, r.limits));
        int64_t error = (int64_t)timing_bitrate_bps(&t) - r.bitrate_bps;
        assert_true(llabs(error) * 1000 < (int64_t)r.bitrate_bps * 51);
        uint32_t wish =
            r.sample_permille > 0 ? r.sample_permille : timing_cia_sample_permille(r.bitrate_bps);
        assert_true(timing_sample_point_ppb(&t) / MHZ <= wish);
    }
    assert_true(found > RANDOM_REQUESTS / 4);
}
