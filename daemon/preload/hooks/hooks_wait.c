/* SPDX-License-Identifier: MIT
 *
 * hooks_wait.c - calls that wait for descriptors.
 */
#include "base/moment.h"
#include "preload/hooks/hook.h"
#include "preload/pump.h"
#include "preload/vtime.h"
#include "preload/waiting.h"

#include <stdlib.h>
#include <string.h>

/* Converts a time-out in ms. Returns NULL for a negative one, which has no end. */
static const struct timespec *span_of(struct timespec *span, int ms)
{
    *span = moment_of(ms > 0 ? ms * INT64_C(1000000) : 0);
    return ms < 0 ? NULL : span;
}

/* Ends the program, as the C library does, when a fortified call has less room than it says. */
static void check_room(nfds_t count, size_t room)
{
    if (room / sizeof(struct pollfd) < count)
        abort();
}

/* ---- poll() ---------------------------------------------------------------------------------- */

HOOK int poll(struct pollfd *fds, nfds_t count, int ms)
{
    struct timespec span;
    if (!vtime_is_on())
        return real()->poll(fds, count, ms);
    return waiting_poll(fds, count, span_of(&span, ms), NULL);
}

HOOK int ppoll(struct pollfd *fds, nfds_t count, const struct timespec *span,
               const sigset_t *mask)
{
    return waiting_poll(fds, count, span, mask);
}

int hook_poll_chk(struct pollfd *fds, nfds_t count, int ms, size_t room) __asm__("__poll_chk");
int hook_ppoll_chk(struct pollfd *fds, nfds_t count, const struct timespec *span,
                   const sigset_t *mask, size_t room) __asm__("__ppoll_chk");

HOOK int hook_poll_chk(struct pollfd *fds, nfds_t count, int ms, size_t room)
{
    check_room(count, room);
    return poll(fds, count, ms);
}

HOOK int hook_ppoll_chk(struct pollfd *fds, nfds_t count, const struct timespec *span,
                        const sigset_t *mask, size_t room)
{
    check_room(count, room);
    return ppoll(fds, count, span, mask);
}

/* ---- select() -------------------------------------------------------------------------------- */

typedef struct fd_sets {
    fd_set *set[3]; /* read, write, except; NULL: none */
} fd_sets;

static bool is_in(int fd, const fd_set *set)
{
    return set && FD_ISSET(fd, set);
}

/* Fills a list with the descriptors that others than the bus make ready. Returns its length. */
static nfds_t list_others(struct pollfd *out, int count, const fd_sets *sets)
{
    nfds_t listed = 0;
    for (int fd = 0; fd < count; fd++) {
        const int events = (is_in(fd, sets->set[0]) ? POLLIN : 0) |
                           (is_in(fd, sets->set[1]) ? POLLOUT : 0) |
                           (is_in(fd, sets->set[2]) ? POLLPRI : 0);
        if (events != 0 && !waiting_is_fed(fd))
            out[listed++] = (struct pollfd){.fd = fd, .events = (short)events};
    }
    return listed;
}

/* Looks without waiting; the sets keep what they ask for when nothing is ready. */
static int hooks_wait_look(int count, const fd_sets *sets, const sigset_t *mask)
{
    static const struct timespec none = {.tv_sec = 0};
    fd_set found[3];
    fd_set *given[3];
    pump_step();
    for (int i = 0; i < 3; i++) {
        given[i] = sets->set[i] ? &found[i] : NULL;
        if (given[i])
            found[i] = *sets->set[i];
    }
    const int ready = real()->pselect(count, given[0], given[1], given[2], &none, mask);
    for (int i = 0; ready > 0 && i < 3; i++)
        if (given[i])
            *sets->set[i] = found[i];
    return ready;
}

static void hooks_wait_clear(const fd_sets *sets)
{
    for (int i = 0; i < 3; i++)
        if (sets->set[i])
            FD_ZERO(sets->set[i]);
}

/* Looks, and ends the turn until something is ready or the time has come. A look without waiting
 * counts as one, too: programs that look again and again must let time go on. */
static int select_virtually(int count, const fd_sets *sets, const struct timespec *span,
                            const sigset_t *mask)
{
    struct pollfd others[FD_SETSIZE];
    const int64_t until_ns = waiting_until(span);
    const vtime_wait wait = {.until_ns = until_ns,
                             .wants = TIMING_MESSAGES | (sets->set[1] ? TIMING_ROOM : 0),
                             .fds = others,
                             .count = list_others(others, count, sets),
                             .mask = mask};
    int ready = hooks_wait_look(count, sets, mask);
    while (ready == 0 && vtime_now_ns() < until_ns) {
        if (vtime_wait_for(&wait) != 0)
            return hook_result(EINTR);
        ready = hooks_wait_look(count, sets, mask);
    }
    if (ready == 0)
        hooks_wait_clear(sets);
    if (ready == 0 && span && span->tv_sec == 0 && span->tv_nsec == 0)
        vtime_look();
    return ready;
}

HOOK int pselect(int count, fd_set *restrict in, fd_set *restrict out, fd_set *restrict except,
                 const struct timespec *restrict span, const sigset_t *restrict mask)
{
    const fd_sets sets = {{in, out, except}};
    if (!vtime_is_on() || count < 0 || count > FD_SETSIZE)
        return real()->pselect(count, in, out, except, span, mask);
    return select_virtually(count, &sets, span, mask);
}

/* The kernel tells what is left of the time. */
HOOK int select(int count, fd_set *restrict in, fd_set *restrict out, fd_set *restrict except,
                struct timeval *restrict limit)
{
    const fd_sets sets = {{in, out, except}};
    if (!vtime_is_on() || count < 0 || count > FD_SETSIZE)
        return real()->select(count, in, out, except, limit);
    if (!limit)
        return select_virtually(count, &sets, NULL, NULL);
    const struct timespec span = {.tv_sec = limit->tv_sec, .tv_nsec = limit->tv_usec * 1000};
    const int64_t until_ns = waiting_until(&span);
    const int ready = select_virtually(count, &sets, &span, NULL);
    const int64_t left_ns = until_ns - vtime_now_ns();
    const struct timespec left = moment_of(left_ns > 0 ? left_ns : 0);
    *limit = (struct timeval){.tv_sec = left.tv_sec, .tv_usec = left.tv_nsec / 1000};
    return ready;
}

/* ---- epoll ----------------------------------------------------------------------------------- */

/* Waits for a set. It is readable itself when a descriptor in it is ready, which ends the wait,
 * too. With a message of the bus the turn begins anyway. */
static int wait_for_set(int set, struct epoll_event *events, int max, const struct timespec *span,
                        const sigset_t *mask)
{
    const int64_t until_ns = waiting_until(span);
    struct pollfd whole = {.fd = set, .events = POLLIN};
    const vtime_wait wait = {.until_ns = until_ns,
                             .wants = TIMING_MESSAGES | TIMING_ROOM,
                             .fds = &whole,
                             .count = 1,
                             .mask = mask};
    for (;;) {
        pump_step();
        const int found = real()->epoll_pwait(set, events, max, 0, mask);
        if (found == 0 && span && span->tv_sec == 0 && span->tv_nsec == 0)
            vtime_look();
        if (found != 0 || vtime_now_ns() >= until_ns)
            return found;
        if (vtime_wait_for(&wait) != 0)
            return hook_result(EINTR);
    }
}

HOOK int epoll_pwait(int set, struct epoll_event *events, int max, int ms, const sigset_t *mask)
{
    struct timespec span;
    if (!vtime_is_on())
        return real()->epoll_pwait(set, events, max, ms, mask);
    return wait_for_set(set, events, max, span_of(&span, ms), mask);
}

HOOK int epoll_wait(int set, struct epoll_event *events, int max, int ms)
{
    struct timespec span;
    if (!vtime_is_on())
        return real()->epoll_wait(set, events, max, ms);
    return wait_for_set(set, events, max, span_of(&span, ms), NULL);
}

HOOK int epoll_pwait2(int set, struct epoll_event *events, int max, const struct timespec *span,
                      const sigset_t *mask)
{
    if (vtime_is_on())
        return wait_for_set(set, events, max, span, mask);
    if (!real()->epoll_pwait2)
        return hook_result(ENOSYS);
    return real()->epoll_pwait2(set, events, max, span, mask);
}
