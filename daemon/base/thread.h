/* SPDX-License-Identifier: MIT
 *
 * thread.h - threads beside the thread of the bus, for calls that may wait: disks, networks.
 *
 * They get no signals. Signals are for the thread of the bus, and exceeding the limit of file size
 * must be an error of write(). Waiting is by CLOCK_MONOTONIC, since somebody may set the other
 * clock.
 */
#ifndef CANWIRE_BASE_THREAD_H
#define CANWIRE_BASE_THREAD_H

#include <pthread.h>
#include <stdbool.h>
#include <time.h>

typedef void *thread_run(void *argument);

/* Starts a thread that is to be joined. Returns 0 or an errno. */
int thread_start(pthread_t *thread, thread_run *run, void *argument);

/* Starts a thread that is not joined. Returns 0 or an errno. */
int thread_start_alone(thread_run *run, void *argument);

/* Initialises a condition whose timeouts are moments of CLOCK_MONOTONIC. */
void thread_init_condition(pthread_cond_t *condition);

/* Return a moment that far in the future. */
struct timespec thread_in_seconds(unsigned seconds);
struct timespec thread_in_ns(long ns); /* less than a second */

bool thread_is_past(const struct timespec *moment);

#endif
