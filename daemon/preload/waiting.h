/* SPDX-License-Identifier: MIT
 *
 * waiting.h - calls that wait, in virtual time or in real time. They do what the call of the same
 * name does, and return what it returns.
 */
#ifndef CANWIRE_PRELOAD_WAITING_H
#define CANWIRE_PRELOAD_WAITING_H

#include <poll.h>
#include <signal.h>
#include <stdbool.h>
#include <stdint.h>
#include <sys/socket.h>
#include <time.h>

ssize_t waiting_recv(int fd, void *to, size_t size, int flags);
ssize_t waiting_send(int fd, const struct msghdr *whole, int flags);

/* Reads a timerfd of virtual time. */
ssize_t waiting_read(int fd, void *to, size_t size);

/* span: NULL waits for ever. */
int waiting_poll(struct pollfd *fds, nfds_t count, const struct timespec *span,
                 const sigset_t *mask);

/* Returns true for a descriptor that only the bus, or time, makes ready. */
bool waiting_is_fed(int fd);

/* Returns the end of a span in bus time, ns; NULL: VTIME_NEVER. */
int64_t waiting_until(const struct timespec *span);

#endif
