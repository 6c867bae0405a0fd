/* SPDX-License-Identifier: MIT
 *
 * alarm.h - a timer for one moment of CLOCK_MONOTONIC, set anew only when the moment changes.
 *
 * It is an absolute timerfd: libev's own timers have the granularity of a millisecond.
 */
#ifndef CANWIRE_BASE_ALARM_H
#define CANWIRE_BASE_ALARM_H

#include <stdbool.h>
#include <stdint.h>

#define ALARM_NEVER INT64_MAX

typedef struct wake_alarm {
    int fd;        /* readable when the alarm rings; -1: not open */
    int64_t at_ns; /* the moment that is set */
} wake_alarm;

#define ALARM_CLOSED ((wake_alarm){.fd = -1, .at_ns = ALARM_NEVER})

/* Opens an alarm that is not set. Returns false, with errno, when that fails. */
bool alarm_open(wake_alarm *a);

void alarm_close(wake_alarm *a);

/* Sets the alarm to that moment only; it rings at once when the moment has passed. Returns false,
 * with errno, when that fails. */
bool alarm_set(wake_alarm *a, int64_t at_ns);

/* Does the same unless the alarm is set to an earlier moment. */
bool alarm_set_earlier(wake_alarm *a, int64_t at_ns);

/* Returns true when the alarm rings, which is then no longer set. Call it when fd is readable. */
bool alarm_take(wake_alarm *a);

#endif
