/* SPDX-License-Identifier: MIT
 *
 * hook.h - what the files of hooks share. A hook is the library's own version of a call of the C
 * library; for other descriptors than CAN sockets it makes the real call.
 */
#ifndef CANWIRE_PRELOAD_HOOK_H
#define CANWIRE_PRELOAD_HOOK_H

#include "preload/real.h"
#include "preload/table.h"

#include <errno.h>
#include <limits.h>

#define HOOK __attribute__((visibility("default")))

/* Returns what a call returns for 0 or an errno. */
static inline int hook_result(int error)
{
    if (error == 0)
        return 0;
    errno = error;
    return -1;
}

/* Returns true for a length of an address that the kernel refuses before it looks at the address;
 * also for a negative one. */
static inline bool hook_is_too_long(socklen_t length)
{
    return length > sizeof(struct sockaddr_storage);
}

/* Returns an errno for more parts than the kernel takes, else 0. It is EMSGSIZE for sendmsg() and
 * recvmsg(), and EINVAL for readv() and writev(). */
static inline int hook_check_parts(size_t count, int too_many)
{
    return count > IOV_MAX ? too_many : 0;
}

/* Returns the bytes of all parts. */
static inline size_t hook_bytes_of(const struct iovec *parts, size_t count)
{
    size_t bytes = 0;
    for (size_t i = 0; i < count; i++)
        bytes += parts[i].iov_len;
    return bytes;
}

#endif
