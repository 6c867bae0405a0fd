/* SPDX-License-Identifier: MIT
 *
 * found_timing.h - bit timings that a way of finding them gives, or refuses. cmocka.h comes before
 * it.
 */
#ifndef CANWIRE_TESTS_FOUND_TIMING_H
#define CANWIRE_TESTS_FOUND_TIMING_H

#include "timing/request.h"

typedef bool timing_find(bit_timing *found, char problem[TIMING_PROBLEM_MAX],
                         const timing_request *r);

static inline void assert_found(timing_find *find, const timing_request *r, bit_timing expected)
{
    char problem[TIMING_PROBLEM_MAX] = "";
    bit_timing found;

    if (!find(&found, problem, r))
        fail_msg("%s", problem);
    assert_int_equal(found.clock_hz, r->clock_hz);
    assert_int_equal(found.brp, expected.brp);
    assert_int_equal(found.prop_seg, expected.prop_seg);
    assert_int_equal(found.phase_seg1, expected.phase_seg1);
    assert_int_equal(found.phase_seg2, expected.phase_seg2);
    assert_int_equal(found.sjw, expected.sjw);
}

static inline void assert_not_found(timing_find *find, const timing_request *r,
                                    const char *expected)
{
    char problem[TIMING_PROBLEM_MAX] = "";
    bit_timing found;

    assert_false(find(&found, problem, r));
    assert_string_equal(problem, expected);
}

#endif
