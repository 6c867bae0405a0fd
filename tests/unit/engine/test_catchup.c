/* SPDX-License-Identifier: MIT
 *
 * test_catchup.c - when a bus that has fallen behind skips time, and how much.
 */

#include "cases.h"
#include "canwire.h"
#include "engine/catchup.h"

#define S UINT64_C(80000000) /* ticks */
#define NS_PER_S INT64_C(1000000000)

TEST(only_what_is_over_the_limit_is_skipped)
{
    static const struct {
        uint64_t due, now, limit, skipped;
    } cases[] = {
        {0, 0, S, 0},
        {CW_NEVER, 100 * S, S, 0}, /* nothing was missed */
        {CW_NEVER, CW_NEVER, 0, 0},
        {10 * S, 9 * S, S, 0}, /* early */
        {10 * S, 10 * S, 0, 0},
        {10 * S, 11 * S, S, 0}, /* just not too much */
        {10 * S, 11 * S + 1, S, S}, /* an even number of ticks */
        {10 * S, 11 * S + 2, S, S + 2},
        {0, 3600 * S, S, 3600 * S},
        {1, 3600 * S, S, 3600 * S - 2},
        {5, 7, 1, 2},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        assert_int_equal(catchup_excess(cases[i].due, cases[i].now, cases[i].limit),
                         cases[i].skipped);
}

TEST(a_machine_that_was_suspended_is_known_once)
{
    catchup c = {.skips = 0};
    catchup_begin(&c, 7 * NS_PER_S, 5 * NS_PER_S);
    assert_int_equal(catchup_suspended(&c, 8 * NS_PER_S, 6 * NS_PER_S), 0);
    /* the second clock was read late */
    assert_int_equal(catchup_suspended(&c, 9 * NS_PER_S, 7 * NS_PER_S + 500000000), 0);
    assert_int_equal(catchup_suspended(&c, 10 * NS_PER_S, 8 * NS_PER_S), 0);
    /* an hour */
    assert_int_equal(catchup_suspended(&c, 3611 * NS_PER_S, 9 * NS_PER_S), 3600 * NS_PER_S);
    assert_int_equal(catchup_suspended(&c, 3612 * NS_PER_S, 10 * NS_PER_S), 0);
    assert_int_equal(catchup_suspended(&c, 3613 * NS_PER_S + 9999999, 11 * NS_PER_S), 0);
    assert_int_equal(catchup_suspended(&c, 3613 * NS_PER_S + 10000000, 11 * NS_PER_S), 10000000);
}

TEST(all_that_is_skipped_is_counted_and_logged_in_time)
{
    catchup c = {.skips = 0};
    catchup_log(&c, 1);
    assert_false(c.logged);
    catchup_note(&c, 2000000000);
    catchup_log(&c, 5);
    assert_int_equal(c.logged_ns, 2000000000);
    catchup_note(&c, 1000000000);
    catchup_note(&c, 1000000000);
    assert_int_equal(c.skips, 3);
    assert_int_equal(c.skipped_ns, UINT64_C(4000000000));
    catchup_log(&c, 5 + CATCHUP_LOG_NS - 1);
    assert_int_equal(c.logged_ns, 2000000000);
    catchup_log(&c, 5 + CATCHUP_LOG_NS);
    assert_int_equal(c.logged_ns, UINT64_C(4000000000));
    catchup_note(&c, 1);
    catchup_log(&c, INT64_MAX); /* at the end, whenever that is */
    assert_int_equal(c.logged_ns, UINT64_C(4000000001));
}
