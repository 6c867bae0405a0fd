/* SPDX-License-Identifier: MIT
 *
 * hooks_send.c - calls that write.
 */
#include "preload/bcm.h"
#include "preload/hooks/hook.h"
#include "preload/raw.h"

#include <linux/can.h>
#include <string.h>
#include <unistd.h>

#define BYTES_MAX 20000 /* of the longest message of CAN_BCM, 256 CAN FD frames */

/* Gathers what a call sends. Returns the bytes in all, more than BYTES_MAX when they do not fit. */
static size_t gather(unsigned char bytes[BYTES_MAX], const struct msghdr *in)
{
    size_t size = 0;
    for (size_t i = 0; i < in->msg_iovlen; i++) {
        const size_t part = in->msg_iov[i].iov_len;
        if (part > BYTES_MAX - size)
            return BYTES_MAX + 1;
        if (part > 0)
            memcpy(bytes + size, in->msg_iov[i].iov_base, part);
        size += part;
    }
    return size;
}

/* Sends. Returns what the call returns. */
static ssize_t transmit(cansock *s, int fd, const struct msghdr *in, int flags)
{
    unsigned char bytes[BYTES_MAX];
    int index = s->index;
    const size_t size = gather(bytes, in);
    int error = size > BYTES_MAX ? EINVAL : 0;
    if (!error && in->msg_name)
        error = raw_index_of(&index, in->msg_name, in->msg_namelen);
    if (!error)
        error = s->kind == CANSOCK_RAW ? raw_send(s, fd, bytes, size, index, flags)
                                       : bcm_send(s, bytes, size, index);
    return error ? hook_result(error) : (ssize_t)size;
}

static ssize_t transmit_and_give(cansock *s, int fd, const struct msghdr *in, int flags)
{
    const ssize_t result = transmit(s, fd, in, flags);
    table_give(s);
    return result;
}

static ssize_t transmit_one(cansock *s, int fd, const void *bytes, size_t size, int flags)
{
    struct iovec part = {.iov_base = (void *)(uintptr_t)bytes, .iov_len = size};
    const struct msghdr in = {.msg_iov = &part, .msg_iovlen = 1};
    return transmit_and_give(s, fd, &in, flags);
}

HOOK ssize_t write(int fd, const void *bytes, size_t size)
{
    cansock *s = table_take(fd);
    return s ? transmit_one(s, fd, bytes, size, 0) : real()->write(fd, bytes, size);
}

HOOK ssize_t send(int fd, const void *bytes, size_t size, int flags)
{
    cansock *s = table_take(fd);
    return s ? transmit_one(s, fd, bytes, size, flags) : real()->send(fd, bytes, size, flags);
}

HOOK ssize_t writev(int fd, const struct iovec *parts, int count)
{
    cansock *s = table_take(fd);
    if (!s)
        return real()->writev(fd, parts, count);
    const struct msghdr in = {.msg_iov = (struct iovec *)(uintptr_t)parts,
                              .msg_iovlen = (size_t)count};
    return transmit_and_give(s, fd, &in, 0);
}

HOOK ssize_t sendto(int fd, const void *bytes, size_t size, int flags,
                    __CONST_SOCKADDR_ARG address, socklen_t length)
{
    cansock *s = table_take(fd);
    if (!s)
        return real()->sendto(fd, bytes, size, flags, address.__sockaddr__, length);
    struct iovec part = {.iov_base = (void *)(uintptr_t)bytes, .iov_len = size};
    const struct msghdr in = {.msg_iov = &part,
                              .msg_iovlen = 1,
                              .msg_name = (void *)(uintptr_t)address.__sockaddr__,
                              .msg_namelen = length};
    return transmit_and_give(s, fd, &in, flags);
}

HOOK ssize_t sendmsg(int fd, const struct msghdr *in, int flags)
{
    cansock *s = table_take(fd);
    return s ? transmit_and_give(s, fd, in, flags) : real()->sendmsg(fd, in, flags);
}

HOOK int sendmmsg(int fd, struct mmsghdr *in, unsigned count, int flags)
{
    cansock *s = table_take(fd);
    if (!s)
        return real()->sendmmsg(fd, in, count, flags);
    unsigned done = 0;
    ssize_t size = 0;
    while (done < count && (size = transmit(s, fd, &in[done].msg_hdr, flags)) >= 0)
        in[done++].msg_len = (unsigned)size;
    table_give(s);
    return done > 0 || size >= 0 ? (int)done : -1;
}
