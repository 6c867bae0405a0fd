/* SPDX-License-Identifier: MIT
 *
 * test_quanta.c - the difference of two clocks that a pair of controllers stands, by the rules of
 * bit timing alone (T10, T11).
 */
#include "quanta.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#define FRAMES 48u
#define PHASES 6u
#define MILLION 1000000
#define PERCENT (MILLION / 100)

static uint64_t mix(uint64_t x)
{
    x += 0x9E3779B97F4A7C15u;
    x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9u;
    x = (x ^ x >> 27) * 0x94D049BB133111EBu;
    return x ^ x >> 31;
}

static bool open_for_frames; /* all have integrated */

/* Node 0 sends frames of 8 bytes. Every other one has falling edges ten bits apart: four bits of
 * one level, and a stuff bit of the other level with four more. */
static bool next_frame(cw_frame *frame, unsigned node, unsigned number)
{
    const uint8_t rows = (uint8_t)(0x0F0F >> number / 2 % 8);
    if (node != 0 || !open_for_frames)
        return false;
    *frame = (cw_frame){.id = mix(~(uint64_t)number) & CW_BASE_ID_MAX, .dlc = 8};
    for (unsigned i = 0; i < 8; i++)
        frame->data[i] = number % 2 ? (uint8_t)(mix(number) >> 8 * i) : rows;
    return true;
}

static void integrate(quanta *q)
{
    open_for_frames = false;
    while (cw_mac_get_phase(&q->nodes[0].mac) != CW_MAC_IDLE ||
           cw_mac_get_phase(&q->nodes[1].mac) != CW_MAC_IDLE)
        quanta_step(q);
    open_for_frames = true;
}

/* Returns true when all frames reach a receiver whose quantum is longer by so many millionths
 * (negative: shorter), without an error of anybody. */
static bool stands_from(const quanta_timing *timing, int64_t millionths, int64_t phase)
{
    quanta q = {.next_frame = next_frame};
    quanta_timing other = *timing;
    other.quantum += timing->quantum * millionths / MILLION;
    quanta_add(&q, timing, 0);
    quanta_add(&q, &other, phase);
    integrate(&q);
    while (q.nodes[0].sent < FRAMES && q.nodes[0].errors + q.nodes[1].errors == 0)
        quanta_step(&q);
    return q.nodes[0].sent == FRAMES && q.nodes[1].errors == 0 && q.nodes[1].received >= FRAMES - 1;
}

static bool stands(const quanta_timing *timing, int64_t millionths)
{
    for (unsigned i = 0; i < PHASES; i++)
        if (!stands_from(timing, millionths, timing->quantum * i / PHASES))
            return false;
    return true;
}

/* Timings with the first difference that fails, in percent: receiver slow, receiver fast. */
static const struct {
    const char *name;
    quanta_timing timing;
    double slow, fast;
} pairs[] = {
    {"1M 6-1-2/1", {100 * FS_PER_NS, 6, 1, 2, 1}, 1.15, 1.15},
    {"1M 10-2-3/2", {125 * FS_PER_NS / 2, 10, 2, 3, 2}, 1.37, 1.41},
    {"500k 4-5-6/4", {125 * FS_PER_NS, 4, 5, 6, 4}, 2.75, 2.83},
    {"125k 11-2-2/2", {500 * FS_PER_NS, 11, 2, 2, 2}, 1.27, 0.73},
    {"50k 11-4-4/4", {1000 * FS_PER_NS, 11, 4, 4, 4}, 2.05, 1.71},
    {"100k 1-4-4/4", {1000 * FS_PER_NS, 1, 4, 4, 4}, 4.17, 3.39},
};
#define PAIRS (sizeof pairs / sizeof pairs[0])

/* Checks that the first difference that fails is about the one that is expected. */
static void check_pair(unsigned i, double percent, int sign)
{
    const double least = percent * 0.95, most = percent * 1.07;
    if (!stands(&pairs[i].timing, sign * (int64_t)(least * PERCENT)))
        fail_msg("%s: %+.2f %% fails, expected from %.2f %% on", pairs[i].name, sign * least,
                 percent);
    if (stands(&pairs[i].timing, sign * (int64_t)(most * PERCENT)))
        fail_msg("%s: %+.2f %% does not fail", pairs[i].name, sign * most);
}

static void two_clocks_fail_where_the_phase_error_says(void **state)
{
    (void)state;
    for (unsigned i = 0; i < PAIRS; i++) {
        check_pair(i, pairs[i].slow, 1);
        check_pair(i, pairs[i].fast, -1);
    }
}

static unsigned least_of(unsigned a, unsigned b)
{
    return a < b ? a : b;
}

static quanta_timing draw_timing(uint64_t seed)
{
    quanta_timing t = {.quantum = 100 * FS_PER_NS};
    t.prop = 1 + (unsigned)(mix(seed) % 8);
    t.seg1 = 1 + (unsigned)(mix(seed + 1) % 8);
    t.seg2 = 2 + (unsigned)(mix(seed + 2) % 7);
    t.sjw = 1 + (unsigned)(mix(seed + 3) % least_of(4, least_of(t.seg1, t.seg2)));
    return t;
}

/* Returns the sufficient limit for each of two clocks, in millionths (T10). */
static int64_t limit_of(const quanta_timing *t)
{
    const int64_t bit = quanta_bit(t);
    const int64_t by_width = MILLION * (int64_t)t->sjw / (20 * bit);
    const int64_t by_phase = MILLION * (int64_t)least_of(t->seg1, t->seg2 - 1) /
                             (2 * (13 * bit - t->seg2));
    return by_width < by_phase ? by_width : by_phase;
}

static void inside_the_sufficient_limit_nothing_fails(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 12; seed++) {
        quanta_timing t = draw_timing(10 * seed);
        if (quanta_bit(&t) < 8)
            continue;
        const int64_t limit = 2 * limit_of(&t);
        if (!stands(&t, limit) || !stands(&t, -limit))
            fail_msg("%u-%u-%u/%u fails at %lld millionths", t.prop, t.seg1, t.seg2, t.sjw,
                     (long long)limit);
    }
}

/* Returns the first error of the sender when its receiver is so far away; NULL when there is
 * none. */
static const cw_error *first_error_at(quanta *q, const quanta_timing *timing, int64_t delay)
{
    *q = (quanta){.next_frame = next_frame};
    quanta_add(q, timing, 0);
    quanta_add(q, timing, 0);
    q->delay[0][1] = q->delay[1][0] = delay;
    integrate(q);
    while (q->nodes[0].sent < FRAMES && q->nodes[0].errors == 0)
        quanta_step(q);
    return q->nodes[0].errors ? &q->nodes[0].first_error : NULL;
}

/* The acknowledgement comes after the sample point when the way there and back is longer than the
 * bit up to there. The receiver leads the edge by up to a quantum. */
static void a_line_too_long_breaks_the_acknowledgement(void **state)
{
    (void)state;
    for (unsigned i = 0; i < PAIRS; i++) {
        const quanta_timing *t = &pairs[i].timing;
        const int64_t to_sample = (1 + t->prop + t->seg1) * t->quantum;
        quanta q;
        assert_null(first_error_at(&q, t, t->prop * t->quantum / 2));
        assert_null(first_error_at(&q, t, (to_sample - t->quantum / 10) / 2));
        const cw_error *error = first_error_at(&q, t, to_sample / 2 + t->quantum);
        assert_non_null(error);
        assert_int_equal(error->type, CW_ERROR_ACK);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(two_clocks_fail_where_the_phase_error_says),
        cmocka_unit_test(inside_the_sufficient_limit_nothing_fails),
        cmocka_unit_test(a_line_too_long_breaks_the_acknowledgement),
    };
    return cmocka_run_group_tests_name("clocks that differ", tests, NULL, NULL);
}
