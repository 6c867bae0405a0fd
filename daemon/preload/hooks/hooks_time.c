/* SPDX-License-Identifier: MIT
 *
 * hooks_time.c - calls that tell the time, and that sleep.
 */
#include "base/moment.h"
#include "preload/hooks/hook.h"
#include "preload/vtime.h"
#include "preload/waiting.h"

#include <unistd.h>

#define NS_PER_S INT64_C(1000000000)

/* ---- Clocks ---------------------------------------------------------------------------------- */

/* Returns true for clocks that virtual time has; those of the processor are the machine's. */
static bool is_wall(clockid_t clock)
{
    return clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE || clock == CLOCK_TAI ||
           clock == CLOCK_MONOTONIC || clock == CLOCK_MONOTONIC_RAW ||
           clock == CLOCK_MONOTONIC_COARSE || clock == CLOCK_BOOTTIME;
}

static struct timespec hooks_time_look(clockid_t clock)
{
    vtime_look();
    return moment_of(vtime_on(clock, vtime_now_ns()));
}

HOOK int clock_gettime(clockid_t clock, struct timespec *out)
{
    if (!is_wall(clock) || !vtime_is_on())
        return real()->clock_gettime(clock, out);
    *out = hooks_time_look(clock);
    return 0;
}

HOOK int gettimeofday(struct timeval *restrict out, void *restrict zone)
{
    if (!vtime_is_on())
        return real()->gettimeofday(out, zone);
    const struct timespec now = hooks_time_look(CLOCK_REALTIME);
    *out = (struct timeval){.tv_sec = now.tv_sec, .tv_usec = now.tv_nsec / 1000};
    return 0;
}

HOOK time_t time(time_t *out)
{
    if (!vtime_is_on())
        return real()->time(out);
    const time_t now = hooks_time_look(CLOCK_REALTIME).tv_sec;
    if (out)
        *out = now;
    return now;
}

HOOK int timespec_get(struct timespec *out, int base)
{
    if (base != TIME_UTC || !vtime_is_on())
        return real()->timespec_get(out, base);
    *out = hooks_time_look(CLOCK_REALTIME);
    return base;
}

/* ---- Sleeping -------------------------------------------------------------------------------- */

static bool is_span(const struct timespec *span)
{
    return span->tv_sec >= 0 && span->tv_nsec >= 0 && span->tv_nsec < NS_PER_S;
}

/* Sleeps until a time, and tells what is left of it. Returns 0 or EINTR. */
static int sleep_until(int64_t until_ns, struct timespec *left)
{
    const int error = vtime_sleep(until_ns);
    const int64_t left_ns = until_ns - vtime_now_ns();
    if (error && left)
        *left = moment_of(left_ns > 0 ? left_ns : 0);
    return error;
}

HOOK int nanosleep(const struct timespec *span, struct timespec *left)
{
    if (!vtime_is_on())
        return real()->nanosleep(span, left);
    return hook_result(is_span(span) ? sleep_until(waiting_until(span), left) : EINVAL);
}

HOOK int clock_nanosleep(clockid_t clock, int flags, const struct timespec *span,
                         struct timespec *left)
{
    if (!is_wall(clock) || !vtime_is_on())
        return real()->clock_nanosleep(clock, flags, span, left);
    if (!is_span(span))
        return EINVAL;
    if (!(flags & TIMER_ABSTIME))
        return sleep_until(waiting_until(span), left);
    return sleep_until(vtime_of(clock, span->tv_sec * NS_PER_S + span->tv_nsec), NULL);
}

HOOK int usleep(useconds_t span_us)
{
    if (!vtime_is_on())
        return real()->usleep(span_us);
    return hook_result(sleep_until(vtime_now_ns() + INT64_C(1000) * span_us, NULL));
}

HOOK unsigned sleep(unsigned span_s)
{
    struct timespec left = {.tv_sec = 0};
    if (!vtime_is_on())
        return real()->sleep(span_s);
    (void)sleep_until(vtime_now_ns() + NS_PER_S * span_s, &left);
    return (unsigned)left.tv_sec + (left.tv_nsec > 0);
}

HOOK int pause(void)
{
    if (!vtime_is_on())
        return real()->pause();
    return hook_result(vtime_sleep(VTIME_NEVER));
}
