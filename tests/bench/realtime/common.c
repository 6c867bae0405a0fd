/* SPDX-License-Identifier: MIT
 *
 * common.c - clocks, processors, shared memory.
 */
#include "realtime.h"

#include <sched.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>

static int64_t read_clock(clockid_t id)
{
    struct timespec t;
    (void)clock_gettime(id, &t);
    return t.tv_sec * RT_NS_PER_S + t.tv_nsec;
}

int64_t rt_now_ns(void)
{
    return read_clock(CLOCK_MONOTONIC);
}

int64_t rt_cpu_ns(void)
{
    return read_clock(CLOCK_PROCESS_CPUTIME_ID);
}

void rt_fail(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    fputs("bench_realtime: ", stderr);
    vfprintf(stderr, format, arguments);
    fputc('\n', stderr);
    va_end(arguments);
    exit(1);
}

/* Processes inherit the processors of their parent, which are only a part later on. So those that
 * were allowed at the start count. */
static void run_on(bool engine_cpu)
{
    static cpu_set_t all;
    cpu_set_t set;
    CPU_ZERO(&set);
    if (CPU_COUNT(&all) == 0 && sched_getaffinity(0, sizeof all, &all) != 0)
        rt_fail("the processors are unknown");
    if (CPU_COUNT(&all) < 2)
        return;
    for (unsigned i = 0; i < CPU_SETSIZE; i++)
        if (CPU_ISSET(i, &all) && (i == RT_ENGINE_CPU) == engine_cpu)
            CPU_SET(i, &set);
    if (CPU_COUNT(&set) == 0 || sched_setaffinity(0, sizeof set, &set) != 0)
        rt_fail("the processors cannot be parted: processor %d must be allowed", RT_ENGINE_CPU);
}

void rt_run_on_engine_cpu(void)
{
    run_on(true);
}

void rt_run_elsewhere(void)
{
    run_on(false);
}

void rt_add_sample(rt_result *r, int64_t late_ns)
{
    if (r->sample_count < RT_SAMPLES_MAX)
        r->late_ns[r->sample_count++] = (int32_t)(late_ns < INT32_MAX ? late_ns : INT32_MAX);
}

rt_result *rt_share_results(unsigned count)
{
    rt_result *memory = mmap(NULL, count * sizeof(rt_result), PROT_READ | PROT_WRITE,
                        MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED)
        rt_fail("out of memory");
    for (unsigned i = 0; i < count; i++)
        if (sem_init(&memory[i].ready, 1, 0) != 0)
            rt_fail("out of semaphores");
    return memory;
}

void rt_unshare_results(rt_result *results, unsigned count)
{
    (void)munmap(results, count * sizeof *results);
}

bool rt_take_priority(void)
{
    const struct sched_param parameter = {.sched_priority = 10};
    return sched_setscheduler(0, SCHED_FIFO, &parameter) == 0;
}
