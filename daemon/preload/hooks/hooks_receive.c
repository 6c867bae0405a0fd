/* SPDX-License-Identifier: MIT
 *
 * hooks_receive.c - calls that read.
 */
#include "preload/hooks/hook.h"
#include "preload/receive.h"
#include "preload/vtimer.h"
#include "preload/waiting.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

static ssize_t into(cansock *s, int fd, void *to, size_t size, int flags)
{
    const ssize_t result = receive_into(s, fd, to, size, flags);
    table_give(s);
    return result;
}

/* Ends the program, as the C library does, when a fortified call has less room than it says. */
static void check_room(size_t size, size_t room)
{
    if (size > room)
        abort();
}

HOOK ssize_t read(int fd, void *to, size_t size)
{
    cansock *s = table_take(fd);
    if (!s && vtimer_is_fd(fd))
        return waiting_read(fd, to, size);
    return s ? into(s, fd, to, size, 0) : real()->read(fd, to, size);
}

HOOK ssize_t recv(int fd, void *to, size_t size, int flags)
{
    cansock *s = table_take(fd);
    return s ? into(s, fd, to, size, flags) : real()->recv(fd, to, size, flags);
}

/* Those of _FORTIFY_SOURCE, whose names are the compiler's. */
ssize_t hook_read_chk(int fd, void *to, size_t size, size_t room) __asm__("__read_chk");
ssize_t hook_recv_chk(int fd, void *to, size_t size, size_t room, int flags) __asm__("__recv_chk");
ssize_t hook_recvfrom_chk(int fd, void *to, size_t size, size_t room, int flags,
                          struct sockaddr *address, socklen_t *length) __asm__("__recvfrom_chk");

HOOK ssize_t hook_read_chk(int fd, void *to, size_t size, size_t room)
{
    cansock *s = table_take(fd);
    if (!s)
        return real()->__read_chk(fd, to, size, room);
    check_room(size, room);
    return into(s, fd, to, size, 0);
}

HOOK ssize_t hook_recv_chk(int fd, void *to, size_t size, size_t room, int flags)
{
    cansock *s = table_take(fd);
    if (!s)
        return real()->__recv_chk(fd, to, size, room, flags);
    check_room(size, room);
    return into(s, fd, to, size, flags);
}

HOOK ssize_t readv(int fd, const struct iovec *parts, int count)
{
    cansock *s = table_take(fd);
    if (!s)
        return real()->readv(fd, parts, count);
    struct msghdr out = {.msg_iov = (struct iovec *)(uintptr_t)parts,
                         .msg_iovlen = (size_t)count};
    const ssize_t result = receive(s, fd, &out, 0);
    table_give(s);
    return result;
}

/* Receives with the address of the sender. address may be NULL, and length with it. */
static ssize_t from(cansock *s, int fd, void *to, size_t size, int flags, struct sockaddr *address,
                    socklen_t *length)
{
    struct iovec part = {.iov_base = to, .iov_len = size};
    struct msghdr out = {.msg_iov = &part, .msg_iovlen = 1, .msg_name = address};
    out.msg_namelen = address && length ? *length : 0;
    const ssize_t result = receive(s, fd, &out, flags);
    table_give(s);
    if (result >= 0 && length)
        *length = out.msg_namelen;
    return result;
}

HOOK ssize_t recvfrom(int fd, void *restrict to, size_t size, int flags, __SOCKADDR_ARG address,
                      socklen_t *restrict length)
{
    cansock *s = table_take(fd);
    if (!s)
        return real()->recvfrom(fd, to, size, flags, address.__sockaddr__, length);
    return from(s, fd, to, size, flags, address.__sockaddr__, length);
}

HOOK ssize_t hook_recvfrom_chk(int fd, void *to, size_t size, size_t room, int flags,
                               struct sockaddr *address, socklen_t *length)
{
    cansock *s = table_take(fd);
    if (!s)
        return real()->__recvfrom_chk(fd, to, size, room, flags, address, length);
    check_room(size, room);
    return from(s, fd, to, size, flags, address, length);
}

HOOK ssize_t recvmsg(int fd, struct msghdr *out, int flags)
{
    cansock *s = table_take(fd);
    if (!s)
        return real()->recvmsg(fd, out, flags);
    const ssize_t result = receive(s, fd, out, flags);
    table_give(s);
    return result;
}

/* Returns true when the time is over, which the kernel looks at after each message. */
static bool hooks_receive_is_over(const struct timespec *end)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec > end->tv_sec || (now.tv_sec == end->tv_sec && now.tv_nsec >= end->tv_nsec);
}

/* Returns the time of CLOCK_MONOTONIC after a span. */
static struct timespec hooks_receive_end_of(const struct timespec *span)
{
    struct timespec end;
    (void)clock_gettime(CLOCK_MONOTONIC, &end);
    end.tv_sec += span->tv_sec + (end.tv_nsec + span->tv_nsec) / 1000000000;
    end.tv_nsec = (end.tv_nsec + span->tv_nsec) % 1000000000;
    return end;
}

HOOK int recvmmsg(int fd, struct mmsghdr *out, unsigned count, int flags, struct timespec *span)
{
    cansock *s = table_take(fd);
    if (!s)
        return real()->recvmmsg(fd, out, count, flags, span);
    const bool wait_for_one = flags & MSG_WAITFORONE;
    const struct timespec end = span ? hooks_receive_end_of(span) : (struct timespec){.tv_sec = 0};
    unsigned done = 0;
    ssize_t size = 0;
    flags &= ~MSG_WAITFORONE;
    while (done < count && (done == 0 || !span || !hooks_receive_is_over(&end))) {
        size = receive(s, fd, &out[done].msg_hdr, flags);
        if (size < 0)
            break;
        out[done++].msg_len = (unsigned)size;
        flags |= wait_for_one ? MSG_DONTWAIT : 0;
    }
    table_give(s);
    return done > 0 || size >= 0 ? (int)done : -1;
}
