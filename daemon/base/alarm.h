/* SPDX-License-Identifier: MIT
 *
 * alarm.h - a timer for one moment of CLOCK_MONOTONIC, which is only set when that moment is
 * another one.
 *
 * An absolute timerfd, since libev's own timers have the granularity of a millisecond.
 */
#ifndef CANWIRE_BASE_ALARM_H
#define CANWIRE_BASE_ALARM_H

#include <stdbool.h>
#include <stdint.h>

#define ALARM_NEVER INT64_MAX

typedef struct wake_alarm {
    int fd;        /* readable when it rings; -1: not open */
    int64_t at_ns; /* what it is set to */
} wake_alarm;

#define ALARM_CLOSED ((wake_alarm){.fd = -1, .at_ns = ALARM_NEVER})

/* Not set to anything. False, with errno, when there is none. */
bool alarm_open(wake_alarm *a);

void alarm_close(wake_alarm *a);

/* To ring at that moment, at once when it has passed, and at no other. False, with errno, when it
 * cannot be set. */
bool alarm_set(wake_alarm *a, int64_t at_ns);

/* To be called when fd is readable: whether it rings; it is then not set to anything any more. */
bool alarm_take(wake_alarm *a);

#endif
