/* SPDX-License-Identifier: MIT
 *
 * waiting.c - calls that wait, in virtual time or in real time.
 *
 * In virtual time a call looks without waiting. As long as it finds nothing, the program's turn
 * ends, and the call looks again in its next one.
 */
#include "preload/waiting.h"

#include "preload/pump.h"
#include "preload/hooks/real.h"
#include "preload/table.h"
#include "preload/vtime.h"
#include "preload/vtimer.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>

#define NS_PER_S INT64_C(1000000000)

bool waiting_is_fed(int fd)
{
    return table_concerns(fd) || vtimer_is_fd(fd);
}

int64_t waiting_until(const struct timespec *span)
{
    const int64_t seconds = span ? span->tv_sec : INT64_MAX;
    if (seconds > VTIME_NEVER / NS_PER_S / 2)
        return VTIME_NEVER;
    return vtime_now_ns() + seconds * NS_PER_S + span->tv_nsec;
}

/* ---- Sockets --------------------------------------------------------------------------------- */

/* Returns when a blocking call of a socket ends, by its option. */
static int64_t waiting_end_of(int fd, int option)
{
    struct timeval limit = {.tv_sec = 0};
    socklen_t size = sizeof limit;
    (void)real()->getsockopt(fd, SOL_SOCKET, option, &limit, &size);
    const struct timespec span = {.tv_sec = limit.tv_sec, .tv_nsec = limit.tv_usec * 1000};
    return limit.tv_sec == 0 && limit.tv_usec == 0 ? VTIME_NEVER : waiting_until(&span);
}

static bool blocks(int fd, int flags)
{
    return !(flags & MSG_DONTWAIT) && !(real()->fcntl(fd, F_GETFL) & O_NONBLOCK);
}

/* Waits after a call has found nothing. Returns true when it is to look again, else false with
 * errno. */
static bool wait_again(int64_t until_ns, unsigned wants)
{
    const vtime_wait wait = {.until_ns = until_ns, .wants = wants, .restarts = true};
    errno = EAGAIN;
    if (vtime_now_ns() >= until_ns)
        return false;
    if (vtime_wait_for(&wait) == 0)
        return true;
    errno = EINTR;
    return false;
}

/* Looks without waiting, and ends the turn as long as nothing is there and the call may block. */
ssize_t waiting_recv(int fd, void *to, size_t size, int flags)
{
    if (!vtime_is_on())
        return real()->recv(fd, to, size, flags);
    const bool waits = blocks(fd, flags);
    const int64_t until_ns = waits ? waiting_end_of(fd, SO_RCVTIMEO) : 0;
    ssize_t result;
    pump_step();
    do
        result = real()->recv(fd, to, size, flags | MSG_DONTWAIT);
    while (result < 0 && errno == EAGAIN && waits && wait_again(until_ns, TIMING_MESSAGES));
    if (result < 0 && errno == EAGAIN && !waits)
        vtime_look();
    if (result < 0 && !waits)
        errno = errno == EINTR ? EAGAIN : errno;
    return result;
}

/* Sends, and ends the turn as long as there is no room and the call may block. Returns -1 with
 * errno. */
ssize_t waiting_send(int fd, const struct msghdr *whole, int flags)
{
    if (!vtime_is_on())
        return real()->sendmsg(fd, whole, flags);
    const bool waits = blocks(fd, flags);
    const int64_t until_ns = waits ? waiting_end_of(fd, SO_SNDTIMEO) : 0;
    ssize_t result;
    do
        result = real()->sendmsg(fd, whole, flags | MSG_DONTWAIT);
    while (result < 0 && errno == EAGAIN && waits && wait_again(until_ns, TIMING_ROOM));
    return result;
}

ssize_t waiting_read(int fd, void *to, size_t size)
{
    struct pollfd one = {.fd = fd, .events = POLLIN};
    if (blocks(fd, 0) && waiting_poll(&one, 1, NULL, NULL) < 0)
        return -1;
    return real()->read(fd, to, size);
}

/* ---- poll() ---------------------------------------------------------------------------------- */

/* Copies the descriptors that others than the bus make ready. Returns their number. */
static nfds_t copy_others(struct pollfd *out, const struct pollfd *fds, nfds_t count)
{
    nfds_t copied = 0;
    for (nfds_t i = 0; i < count; i++)
        if (fds[i].fd >= 0 && !waiting_is_fed(fds[i].fd))
            out[copied++] = fds[i];
    return copied;
}

/* Messages always count: a call that waits for room alone may still get an error. */
static unsigned wants_of(const struct pollfd *fds, nfds_t count)
{
    unsigned wants = TIMING_MESSAGES;
    for (nfds_t i = 0; i < count; i++)
        wants |= fds[i].events & POLLOUT ? TIMING_ROOM : 0;
    return wants;
}

/* Looks, and ends the turn until something is ready or the time has come. */
static int poll_virtually(struct pollfd *fds, nfds_t count, int64_t until_ns, const sigset_t *mask,
                          struct pollfd *others)
{
    static const struct timespec none = {.tv_sec = 0};
    vtime_wait wait = {.until_ns = until_ns,
                       .wants = wants_of(fds, count),
                       .fds = others,
                       .count = copy_others(others, fds, count),
                       .mask = mask};
    for (;;) {
        pump_step();
        const int found = real()->ppoll(fds, count, &none, mask);
        if (found != 0 || vtime_now_ns() >= until_ns)
            return found;
        if (vtime_wait_for(&wait) != 0) {
            errno = EINTR;
            return -1;
        }
    }
}

int waiting_poll(struct pollfd *fds, nfds_t count, const struct timespec *span,
                 const sigset_t *mask)
{
    struct pollfd few[16];
    if (!vtime_is_on())
        return real()->ppoll(fds, count, span, mask);
    const bool many = count > sizeof few / sizeof *few;
    struct pollfd *others = many ? calloc(count, sizeof *others) : few;
    if (!others)
        return -1;
    const int found = poll_virtually(fds, count, waiting_until(span), mask, others);
    const int error = errno;
    if (many)
        free(others);
    if (found == 0 && span && span->tv_sec == 0 && span->tv_nsec == 0)
        vtime_look();
    errno = error;
    return found;
}
