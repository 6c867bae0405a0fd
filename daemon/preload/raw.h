/* SPDX-License-Identifier: MIT
 *
 * raw.h - sockets of CAN_RAW: binding, sending, and their end.
 */
#ifndef CANWIRE_PRELOAD_RAW_H
#define CANWIRE_PRELOAD_RAW_H

#include "preload/table.h"

#include <sys/socket.h>

/* These return 0 or an errno. */
int raw_bind(cansock *s, int fd, const struct sockaddr *address, socklen_t size);
int raw_send(cansock *s, int fd, const void *frame, size_t size, int index, int flags);

/* Sends options and filters to the ports. */
void raw_options_changed(cansock *s, int fd);
void raw_filters_changed(cansock *s, int fd);

/* The connection that the socket is has ended: it becomes one that waits for the bus. fail: the
 * program gets ENETDOWN later. */
void raw_went_down(cansock *s, int index, bool fail);

/* Waits until the bus has what the socket has sent, where it would be lost otherwise. */
void raw_flush(cansock *s, int fd);

/* Reads the index of an address. Returns 0 or an errno. */
int raw_index_of(int *index, const struct sockaddr *address, socklen_t size);

#endif
