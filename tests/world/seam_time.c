/* SPDX-License-Identifier: MIT
 *
 * seam_time.c - clocks, timers and waiting, in virtual time.
 */
#include "seam.h"

#include <assert.h>
#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/time.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

#define LOOK_NS 500       /* at a clock */
#define TASK_CLOCKS -1000 /* the first of the clocks of tasks; the kernel's own are greater */

/* ---- Clocks ---------------------------------------------------------------------------------- */

static struct timespec to_timespec(int64_t ns)
{
    return (struct timespec){.tv_sec = (time_t)(ns / S), .tv_nsec = (long)(ns % S)};
}

SEAM(int, clock_gettime, clockid_t id, struct timespec *t)
{
    if (!world_inside)
        return clock_gettime(id, t);
    world_charge(LOOK_NS);
    int64_t ns = world->now_ns;
    if (id == CLOCK_REALTIME || id == CLOCK_REALTIME_COARSE)
        ns += world->realtime_ns;
    else if (id == CLOCK_BOOTTIME)
        ns += world->boottime_ns;
    else if (id == CLOCK_THREAD_CPUTIME_ID || id == CLOCK_PROCESS_CPUTIME_ID)
        ns = world_me()->cpu_ns;
    else if (id <= TASK_CLOCKS)
        ns = world->tasks[TASK_CLOCKS - id].cpu_ns;
    *t = to_timespec(ns);
    return 0;
}

/* Of the thread that asks. */
SEAM(int, pthread_getcpuclockid, pthread_t thread, clockid_t *id)
{
    if (!world_inside)
        return pthread_getcpuclockid(thread, id);
    assert(pthread_equal(thread, pthread_self()));
    *id = TASK_CLOCKS - (clockid_t)(world_me() - world->tasks);
    return 0;
}

SEAM(int, gettimeofday, struct timeval *t, void *zone)
{
    struct timespec now;
    (void)zone;
    int result = seam_clock_gettime(CLOCK_REALTIME, &now);
    *t = (struct timeval){.tv_sec = now.tv_sec, .tv_usec = now.tv_nsec / 1000};
    return result;
}

SEAM(time_t, time, time_t *t)
{
    struct timespec now;
    (void)seam_clock_gettime(CLOCK_REALTIME, &now);
    if (t)
        *t = now.tv_sec;
    return now.tv_sec;
}

SEAM(int, nanosleep, const struct timespec *time, struct timespec *left)
{
    if (!world_inside)
        return nanosleep(time, left);
    world_enter("nanosleep");
    (void)world_block(WAIT_LOCK, time, world->now_ns + time->tv_sec * S + time->tv_nsec,
                      "nanosleep", NULL);
    return 0;
}

/* ---- Timers ---------------------------------------------------------------------------------- */

/* An eventfd stands for it: readable when it has been written to, which happens when it is due. */
SEAM(int, timerfd_create, int clock, int flags)
{
    if (!world_inside)
        return timerfd_create(clock, flags);
    world_enter("timerfd_create");
    if (seam_refuses(world->refuse_permille / 4, EMFILE, "timerfd_create"))
        return -1;
    int fd = seam_new_fd(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC), FD_TIMER);
    seam_fd_of(fd)->due_ns = NEVER;
    return fd;
}

SEAM(int, timerfd_settime, int fd, int flags, const struct itimerspec *new, struct itimerspec *old)
{
    uint64_t rung;
    seam_fd *f = seam_fd_of(fd);
    if (!world_inside)
        return timerfd_settime(fd, flags, new, old);
    world_enter("timerfd_settime");
    int64_t ns = new->it_value.tv_sec *S + new->it_value.tv_nsec;
    if (f->rung)
        (void)!read(fd, &rung, sizeof rung);
    f->rung = false;
    f->due_ns = ns == 0 ? NEVER : flags & TFD_TIMER_ABSTIME ? ns : world->now_ns + ns;
    return 0;
}

int64_t seam_ring_timers(void)
{
    const uint64_t one = 1;
    int64_t next_ns = NEVER;
    for (int fd = 0; fd < FDS_MAX; fd++) {
        seam_fd *f = seam_fd_of(fd);
        if (f->kind != FD_TIMER || f->due_ns == NEVER)
            continue;
        if (f->due_ns <= world->now_ns) {
            f->rung = write(fd, &one, sizeof one) == sizeof one;
            f->due_ns = NEVER;
        } else if (f->due_ns < next_ns) {
            next_ns = f->due_ns;
        }
    }
    return next_ns;
}

/* ---- Waiting --------------------------------------------------------------------------------- */

/* Measures the CPU time of the event loop since its last wait. */
static void end_turn(void)
{
    world_task *t = world_me();
    world_life *life = world_my_life();
    int64_t turn_ns = t->cpu_ns - t->turn_cpu_ns;
    if (t->turn_cpu_ns != 0 && turn_ns > life->longest_turn_ns)
        life->longest_turn_ns = turn_ns;
    t->turn_cpu_ns = t->cpu_ns;
}

/* Shuffles events: the kernel does not define the order of several. */
static void shuffle(struct epoll_event *events, int count)
{
    for (int i = count - 1; i > 0; i--) {
        int other = (int)world_draw((uint64_t)i + 1);
        struct epoll_event one = events[i];
        events[i] = events[other];
        events[other] = one;
    }
}

SEAM(int, epoll_wait, int fd, struct epoll_event *events, int max, int timeout)
{
    bool interrupted = false;
    if (!world_inside)
        return epoll_wait(fd, events, max, timeout);
    end_turn();
    world_enter("epoll_wait");
    const int64_t until_ns = timeout < 0 ? NEVER : world->now_ns + timeout * MS;
    for (;;) {
        int64_t timer_ns = seam_ring_timers();
        int count = epoll_wait(fd, events, max, 0);
        if (count > 0)
            shuffle(events, count);
        if (count != 0 || timeout == 0 || world->now_ns >= until_ns) {
            world_trace("epoll_wait(%d, %d ms) = %d", fd, timeout, count);
            return count;
        }
        (void)world_block(WAIT_FD, NULL, timer_ns < until_ns ? timer_ns : until_ns, "epoll_wait",
                          &interrupted);
        if (interrupted) {
            errno = EINTR;
            return -1;
        }
    }
}

SEAM(int, poll, struct pollfd *fds, nfds_t count, int timeout)
{
    bool interrupted = false;
    if (!world_inside)
        return poll(fds, count, timeout);
    world_enter("poll");
    const int64_t until_ns = timeout < 0 ? NEVER : world->now_ns + timeout * MS;
    for (;;) {
        int found = poll(fds, count, 0);
        if (found != 0 || world->now_ns >= until_ns) {
            world_trace("poll(%d ms) = %d", timeout, found);
            return found;
        }
        (void)world_block(WAIT_FD, NULL, until_ns, "poll", &interrupted);
        if (interrupted) {
            errno = EINTR;
            return -1;
        }
    }
}

SEAM(int, epoll_create1, int flags)
{
    if (world_inside) {
        world_enter("epoll_create1");
        if (seam_refuses(world->refuse_permille / 4, EMFILE, "epoll_create1"))
            return -1;
    }
    return seam_new_fd(epoll_create1(flags), FD_OTHER);
}
