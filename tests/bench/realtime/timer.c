/* SPDX-License-Identifier: MIT
 *
 * timer.c - how late a bare timerfd is: the best that a program can do that sleeps.
 */
#include "realtime.h"

#include <signal.h>
#include <sys/timerfd.h>
#include <unistd.h>

#define WAIT_MIN_NS 100000
#define WAIT_MAX_NS 300000 /* about as often as frames end */

static volatile sig_atomic_t ended;

static void end(int number)
{
    (void)number;
    ended = 1;
}

static void measure(rt_result *result)
{
    int fd = timerfd_create(CLOCK_MONOTONIC, TFD_CLOEXEC);
    uint64_t expirations, random = 1;
    int64_t start_ns = rt_now_ns();
    while (!ended && fd >= 0) {
        random = random * UINT64_C(6364136223846793005) + 1;
        int64_t due_ns =
            rt_now_ns() + WAIT_MIN_NS + (int64_t)(random >> 33) % (WAIT_MAX_NS - WAIT_MIN_NS);
        const struct itimerspec at = {
            .it_value = {.tv_sec = due_ns / RT_NS_PER_S, .tv_nsec = due_ns % RT_NS_PER_S}};
        if (timerfd_settime(fd, TFD_TIMER_ABSTIME, &at, NULL) != 0 ||
            read(fd, &expirations, sizeof expirations) != sizeof expirations)
            break;
        rt_add_sample(result, rt_now_ns() - due_ns);
    }
    result->wall_ns = rt_now_ns() - start_ns;
    result->cpu_ns = rt_cpu_ns();
    result->good = ended;
}

pid_t rt_start_timer(rt_result *result)
{
    pid_t pid = fork();
    if (pid != 0)
        return pid;
    const struct sigaction action = {.sa_handler = end};
    (void)sigaction(SIGTERM, &action, NULL);
    rt_run_on_engine_cpu();
    (void)sem_post(&result->ready);
    measure(result);
    _exit(0);
}
