/* SPDX-License-Identifier: MIT
 *
 * vtimer.h - timers of a program in virtual time: alarm(), setitimer() and timerfd. Times are bus
 * time in ns.
 */
#ifndef CANWIRE_PRELOAD_VTIMER_H
#define CANWIRE_PRELOAD_VTIMER_H

#include <stdbool.h>
#include <stdint.h>

/* Returns when the first of them is due; VTIME_NEVER: none is. */
int64_t vtimer_due_ns(void);

/* Fires those that are due. Returns true when a signal was raised. */
bool vtimer_run(int64_t now_ns);

/* Returns true for a timerfd in virtual time. */
bool vtimer_is_fd(int fd);

/* Its descriptor is closed. */
void vtimer_forget(int fd);

/* In the child after fork(): it has no alarm. */
void vtimer_forked(void);

#endif
