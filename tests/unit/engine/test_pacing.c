/* SPDX-License-Identifier: MIT
 *
 * test_pacing.c - when the daemon wakes up, and how much of a processor `spin` takes.
 */

#include "cases.h"
#include "engine/pacing.h"

#define MS INT64_C(1000000)
#define S (1000 * MS)

TEST(precise_wakes_up_when_it_is_due)
{
    assert_int_equal(pacing_wake_ns(CFG_PACING_PRECISE, 123456789, false), 123456789);
    assert_int_equal(pacing_wake_ns(CFG_PACING_PRECISE, 123456789, true), 123456789);
}

TEST(tick_wakes_up_at_the_next_millisecond)
{
    assert_int_equal(pacing_wake_ns(CFG_PACING_TICK, 5 * MS + 1, true), 6 * MS);
    assert_int_equal(pacing_wake_ns(CFG_PACING_TICK, 6 * MS, true), 6 * MS);
    assert_int_equal(pacing_next_tick_ns(6 * MS), 7 * MS);
    assert_int_equal(pacing_next_tick_ns(7 * MS - 1), 7 * MS);
}

TEST(spin_wakes_up_before_it_is_due_while_it_may)
{
    assert_int_equal(pacing_wake_ns(CFG_PACING_SPIN, 5 * MS, true), 5 * MS - 50000);
    assert_int_equal(pacing_wake_ns(CFG_PACING_SPIN, 5 * MS, false), 5 * MS);
}

/* Runs a thread that only spins: a bus with something due all the time. Returns its running time in
 * ten-thousandths of ten seconds. */
static unsigned run_with_load(int64_t other_work_ns)
{
    pacing_duty duty = {.window_ns = 0};
    int64_t now_ns = 1000 * S, cpu_ns = 7 * S, ran_ns = 0;
    const int64_t end_ns = now_ns + 10 * S;
    while (now_ns < end_ns) {
        bool spins = pacing_may_spin(&duty, now_ns, cpu_ns);
        int64_t ran = (spins ? PACING_SPIN_NS : 0) + other_work_ns;
        now_ns += PACING_SPIN_NS + other_work_ns; /* the rest of the time it sleeps */
        cpu_ns += ran;
        ran_ns += ran;
    }
    return (unsigned)(ran_ns * 10000 / (10 * S));
}

TEST(spin_stays_below_nine_tenths_of_a_processor)
{
    assert_in_range(run_with_load(0), 8400, 8700);
    assert_in_range(run_with_load(10000), 8400, 8700);
    assert_in_range(run_with_load(50000), 8400, 8700);
    assert_in_range(run_with_load(450000), 9000, 9050); /* work alone is 90 %: nothing to burn */
}

TEST(a_new_window_begins_with_nothing_spent)
{
    pacing_duty duty = {.window_ns = 0};
    assert_true(pacing_may_spin(&duty, S, 0));
    assert_true(pacing_may_spin(&duty, S, PACING_ADVANCE_NS - PACING_SPIN_NS));
    assert_false(pacing_may_spin(&duty, S, PACING_ADVANCE_NS - PACING_SPIN_NS + 1));
    assert_true(pacing_may_spin(&duty, S + 50 * MS, 42 * MS));
    assert_false(pacing_may_spin(&duty, S + 50 * MS, 43 * MS));
    assert_false(pacing_may_spin(&duty, S + 99 * MS, 90 * MS));
    assert_true(pacing_may_spin(&duty, S + 100 * MS, 90 * MS)); /* the next one */
    assert_false(pacing_may_spin(&duty, S + 101 * MS, 92 * MS));
}
