/* SPDX-License-Identifier: MIT
 *
 * thread.c - threads beside the thread of the bus, for calls that may wait: disks, networks.
 */
#include "base/thread.h"

#include <signal.h>

#define NS_PER_S 1000000000

int thread_start(pthread_t *thread, thread_run *run, void *argument)
{
    sigset_t all, before;
    sigfillset(&all);
    (void)pthread_sigmask(SIG_SETMASK, &all, &before);
    int error = pthread_create(thread, NULL, run, argument);
    (void)pthread_sigmask(SIG_SETMASK, &before, NULL);
    return error;
}

int thread_start_alone(thread_run *run, void *argument)
{
    pthread_t thread;
    int error = thread_start(&thread, run, argument);
    if (error == 0)
        (void)pthread_detach(thread);
    return error;
}

void thread_init_condition(pthread_cond_t *condition)
{
    pthread_condattr_t attributes;
    (void)pthread_condattr_init(&attributes);
    (void)pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    (void)pthread_cond_init(condition, &attributes);
    (void)pthread_condattr_destroy(&attributes);
}

struct timespec thread_in_seconds(unsigned seconds)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    t.tv_sec += (time_t)seconds;
    return t;
}

struct timespec thread_in_ns(long ns)
{
    struct timespec t = thread_in_seconds(0);
    t.tv_nsec += ns;
    if (t.tv_nsec >= NS_PER_S) {
        t.tv_nsec -= NS_PER_S;
        t.tv_sec++;
    }
    return t;
}

bool thread_is_past(const struct timespec *moment)
{
    struct timespec now = thread_in_seconds(0);
    return now.tv_sec > moment->tv_sec ||
           (now.tv_sec == moment->tv_sec && now.tv_nsec >= moment->tv_nsec);
}
