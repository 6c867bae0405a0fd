/* SPDX-License-Identifier: MIT
 *
 * test_alarm.c - the timer of the engine rings when it is to, and is set only when that changes.
 */
#include "cases.h"
#include "base/alarm.h"

#include <poll.h>
#include <sys/syscall.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

#define WAIT_MS 60000 /* for what has to come */
#define NS_PER_S INT64_C(1000000000)

static unsigned calls;

/* Replaces libc's function and counts calls. */
int timerfd_settime(int fd, int flags, const struct itimerspec *at, struct itimerspec *before)
{
    calls++;
    return (int)syscall(SYS_timerfd_settime, fd, flags, at, before);
}

static int64_t now_ns(void)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * NS_PER_S + t.tv_nsec;
}

static bool rings(const wake_alarm *a, int wait_ms)
{
    struct pollfd p = {.fd = a->fd, .events = POLLIN};
    return poll(&p, 1, wait_ms) == 1;
}

TEST(what_it_is_set_to_is_not_set_again)
{
    wake_alarm a;
    const int64_t later = now_ns() + 3600 * NS_PER_S;
    assert_true(alarm_open(&a));
    calls = 0;
    alarm_set(&a, ALARM_NEVER);
    assert_int_equal(calls, 0);
    for (unsigned i = 0; i < 10; i++)
        alarm_set(&a, later);
    assert_int_equal(calls, 1);
    alarm_set(&a, later + 1);
    alarm_set(&a, later);
    assert_int_equal(calls, 3);
    alarm_set(&a, ALARM_NEVER);
    alarm_set(&a, ALARM_NEVER);
    assert_int_equal(calls, 4);
    assert_false(rings(&a, 0));
    assert_false(alarm_take(&a));
    alarm_close(&a);
}

/* An alarm that has rung can be set to the same moment again. */
TEST(it_rings_each_time)
{
    wake_alarm a;
    const int64_t past = now_ns() - 1;
    assert_true(alarm_open(&a));
    for (unsigned i = 0; i < 3; i++) {
        alarm_set(&a, past);
        alarm_set(&a, past);
        assert_true(rings(&a, WAIT_MS));
        assert_true(alarm_take(&a));
        assert_false(alarm_take(&a));
        assert_false(rings(&a, 0));
    }
    alarm_set(&a, now_ns() + NS_PER_S / 100);
    assert_true(rings(&a, WAIT_MS));
    assert_true(alarm_take(&a));
    alarm_set(&a, -1); /* before the clock began */
    assert_true(rings(&a, WAIT_MS));
    alarm_close(&a);
}

/* A moment that has come, but was not taken, is gone when another one is set. */
TEST(another_moment_replaces_one_that_has_come)
{
    wake_alarm a;
    assert_true(alarm_open(&a));
    alarm_set(&a, 1);
    assert_true(rings(&a, WAIT_MS));
    alarm_set(&a, now_ns() + 3600 * NS_PER_S);
    assert_false(alarm_take(&a));
    alarm_close(&a);
    assert_int_equal(a.fd, -1);
}
