/* SPDX-License-Identifier: MIT
 *
 * receive.h - what recvmsg() and its relatives do with CAN sockets.
 */
#ifndef CANWIRE_PRELOAD_RECEIVE_H
#define CANWIRE_PRELOAD_RECEIVE_H

#include "preload/table.h"

#include <sys/socket.h>

/* Receives a frame of CAN_RAW, or a message of CAN_BCM, as recvmsg(). */
ssize_t receive(cansock *s, int fd, struct msghdr *out, int flags);

/* The same into one buffer. */
ssize_t receive_into(cansock *s, int fd, void *to, size_t size, int flags);

/* Returns the size of the next message, 0 without one: FIONREAD. */
int receive_next_size(int fd);

#endif
