/* SPDX-License-Identifier: MIT
 *
 * real.h - the calls of the C library that the preloaded library stands before.
 */
#ifndef CANWIRE_PRELOAD_REAL_H
#define CANWIRE_PRELOAD_REAL_H

#include <net/if.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <sys/epoll.h>
#include <sys/resource.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <time.h>

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
    X(int, clock_gettime, (clockid_t, struct timespec *))                                          \
    X(int, gettimeofday, (struct timeval *, void *))                                               \
    X(time_t, time, (time_t *))                                                                    \
    X(int, timespec_get, (struct timespec *, int))                                                 \
    X(int, nanosleep, (const struct timespec *, struct timespec *))                                \
    X(int, clock_nanosleep, (clockid_t, int, const struct timespec *, struct timespec *))          \
    X(int, usleep, (useconds_t))                                                                   \
    X(unsigned, sleep, (unsigned))                                                                 \
    X(int, pause, (void))                                                                          \
    X(int, poll, (struct pollfd *, nfds_t, int))                                                   \
    X(int, ppoll, (struct pollfd *, nfds_t, const struct timespec *, const sigset_t *))            \
    X(int, __poll_chk, (struct pollfd *, nfds_t, int, size_t))                                     \
    X(int, __ppoll_chk,                                                                            \
      (struct pollfd *, nfds_t, const struct timespec *, const sigset_t *, size_t))                \
    X(int, select, (int, fd_set *, fd_set *, fd_set *, struct timeval *))                          \
    X(int, pselect,                                                                                \
      (int, fd_set *, fd_set *, fd_set *, const struct timespec *, const sigset_t *))              \
    X(int, epoll_wait, (int, struct epoll_event *, int, int))                                      \
    X(int, epoll_pwait, (int, struct epoll_event *, int, int, const sigset_t *))                   \
    X(int, epoll_pwait2,                                                                           \
      (int, struct epoll_event *, int, const struct timespec *, const sigset_t *))                 \
    X(unsigned, alarm, (unsigned))                                                                 \
    X(int, setitimer, (int, const struct itimerval *, struct itimerval *))                         \
    X(int, getitimer, (int, struct itimerval *))                                                   \
    X(int, timerfd_create, (int, int))                                                             \
    X(int, timerfd_settime, (int, int, const struct itimerspec *, struct itimerspec *))            \
    X(int, timerfd_gettime, (int, struct itimerspec *))                                            \
    X(pid_t, wait, (int *))                                                                        \
    X(pid_t, waitpid, (pid_t, int *, int))                                                         \
    X(pid_t, wait3, (int *, int, struct rusage *))                                                 \
    X(pid_t, wait4, (pid_t, int *, int, struct rusage *))                                          \
    X(int, waitid, (idtype_t, id_t, siginfo_t *, int))                                             \
    X(int, system, (const char *))                                                                 \
    X(int, pclose, (FILE *))                                                                       \
    X(int, pthread_create, (pthread_t *, const pthread_attr_t *, void *(*)(void *), void *))       \
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
