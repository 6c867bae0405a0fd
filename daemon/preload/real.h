/* SPDX-License-Identifier: MIT
 *
 * real.h - the calls of the C library that the preloaded library stands before.
 */
#ifndef CANWIRE_PRELOAD_REAL_H
#define CANWIRE_PRELOAD_REAL_H

#include <net/if.h>
#include <stdbool.h>
#include <stdint.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <sys/types.h>
#include <sys/uio.h>

/* One line per call: result, name, parameters. */
#define REAL_CALLS(X)                                                                              \
    X(int, socket, (int, int, int))                                                                \
    X(int, bind, (int, const struct sockaddr *, socklen_t))                                        \
    X(int, connect, (int, const struct sockaddr *, socklen_t))                                     \
    X(int, listen, (int, int))                                                                     \
    X(int, shutdown, (int, int))                                                                   \
    X(int, close, (int))                                                                           \
    X(int, close_range, (unsigned, unsigned, int))                                                 \
    X(void, closefrom, (int))                                                                      \
    X(int, dup, (int))                                                                             \
    X(int, dup2, (int, int))                                                                       \
    X(int, dup3, (int, int, int))                                                                  \
    X(int, fcntl, (int, int, ...))                                                                 \
    X(int, fcntl64, (int, int, ...))                                                               \
    X(int, ioctl, (int, unsigned long, ...))                                                       \
    X(int, setsockopt, (int, int, int, const void *, socklen_t))                                   \
    X(int, getsockopt, (int, int, int, void *, socklen_t *))                                       \
    X(int, getsockname, (int, struct sockaddr *, socklen_t *))                                     \
    X(int, getpeername, (int, struct sockaddr *, socklen_t *))                                     \
    X(ssize_t, read, (int, void *, size_t))                                                        \
    X(ssize_t, readv, (int, const struct iovec *, int))                                            \
    X(ssize_t, recv, (int, void *, size_t, int))                                                   \
    X(ssize_t, recvfrom, (int, void *, size_t, int, struct sockaddr *, socklen_t *))               \
    X(ssize_t, recvmsg, (int, struct msghdr *, int))                                               \
    X(int, recvmmsg, (int, struct mmsghdr *, unsigned, int, struct timespec *))                    \
    X(ssize_t, __read_chk, (int, void *, size_t, size_t))                                          \
    X(ssize_t, __recv_chk, (int, void *, size_t, size_t, int))                                     \
    X(ssize_t, __recvfrom_chk,                                                                     \
      (int, void *, size_t, size_t, int, struct sockaddr *, socklen_t *))                          \
    X(ssize_t, write, (int, const void *, size_t))                                                 \
    X(ssize_t, writev, (int, const struct iovec *, int))                                           \
    X(ssize_t, send, (int, const void *, size_t, int))                                             \
    X(ssize_t, sendto, (int, const void *, size_t, int, const struct sockaddr *, socklen_t))       \
    X(ssize_t, sendmsg, (int, const struct msghdr *, int))                                         \
    X(int, sendmmsg, (int, struct mmsghdr *, unsigned, int))                                       \
    X(int, epoll_ctl, (int, int, int, struct epoll_event *))                                       \
    X(unsigned, if_nametoindex, (const char *))                                                    \
    X(char *, if_indextoname, (unsigned, char *))                                                  \
    X(struct if_nameindex *, if_nameindex, (void))                                                 \
    X(void, _exit, (int))                                                                          \
    X(void, _Exit, (int))

#define REAL_MEMBER(result, name, parameters) result(*name) parameters;

typedef struct real_calls {
    REAL_CALLS(REAL_MEMBER)
} real_calls;

extern real_calls real_found;
extern bool real_is_found;

void real_find(void);

/* Returns the calls. Constructors of other libraries may come before ours. */
static inline const real_calls *real(void)
{
    if (__builtin_expect(!real_is_found, 0))
        real_find();
    return &real_found;
}

#endif
