/* SPDX-License-Identifier: MIT
 *
 * alarm.c - a timer for one moment of CLOCK_MONOTONIC, set anew only when the moment changes.
 */
#include "base/alarm.h"

#include "base/moment.h"

#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

bool alarm_open(wake_alarm *a)
{
    *a = ALARM_CLOSED;
    a->fd = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC);
    return a->fd >= 0;
}

void alarm_close(wake_alarm *a)
{
    if (a->fd >= 0)
        (void)close(a->fd);
    *a = ALARM_CLOSED;
}

/* All zeros would disarm the timer. */
static struct timespec time_of(int64_t ns)
{
    if (ns == ALARM_NEVER)
        return (struct timespec){.tv_sec = 0};
    return moment_of(ns < 1 ? 1 : ns);
}

bool alarm_set(wake_alarm *a, int64_t at_ns)
{
    const struct itimerspec at = {.it_value = time_of(at_ns)};
    if (at_ns == a->at_ns)
        return true;
    if (timerfd_settime(a->fd, TFD_TIMER_ABSTIME, &at, NULL) != 0)
        return false;
    a->at_ns = at_ns;
    return true;
}

bool alarm_set_earlier(wake_alarm *a, int64_t at_ns)
{
    return a->at_ns <= at_ns || alarm_set(a, at_ns);
}

bool alarm_take(wake_alarm *a)
{
    uint64_t expirations;
    if (read(a->fd, &expirations, sizeof expirations) != sizeof expirations)
        return false;
    a->at_ns = ALARM_NEVER;
    return true;
}
