/* SPDX-License-Identifier: MIT
 *
 * conn.h - a connection to a port of a bus, by the protocol of port/messages.h.
 */
#ifndef CANWIRE_PRELOAD_CONN_H
#define CANWIRE_PRELOAD_CONN_H

#include "port/messages.h"
#include "preload/ifmap.h"

#include <stddef.h>

/* The wishes of a connection. */
typedef struct conn_wants {
    uint32_t options;
    uint32_t error_mask;
    bool filtered; /* otherwise all frames pass */
    unsigned filter_count;
    const struct can_filter *filters;
    bool quiet; /* a refusal is not told */
} conn_wants;

/* Makes a socket of type SOCK_SEQPACKET with room for frames. flags: of socket(). */
int conn_socket(int flags);

/* Connects such a socket. number: of the name of a guest, 1 for its own;
 * NAME-2, NAME-3 and so on for further ones. Returns 0 or an errno. */
int conn_start(int fd, const iface *in, const conn_wants *wants, unsigned number);

/* Makes a socket and connects it; a guest gets the first name that is free. Returns the descriptor,
 * or -1 with errno. */
int conn_open(const iface *in, const conn_wants *wants);

/* Changes options and error mask, or filters. They wait for room in the socket. */
void conn_set_options(int fd, const conn_wants *wants);
void conn_set_filters(int fd, const conn_wants *wants);

/* Sends a frame of CAN_MTU or CANFD_MTU bytes. Returns 0 or an errno; ENETDOWN: the bus has
 * gone. */
int conn_send(int fd, const void *frame, size_t size, int flags);

/* Waits until the bus has sent the frames of this connection, or dropped them, or for a time limit.
 * Messages of the port are lost meanwhile. Another thread that receives may read the answer. It
 * then counts *elsewhere up; NULL: there is none. */
void conn_flush(int fd, const unsigned *elsewhere);

/* Returns true for an errno that says that the bus has gone. */
bool conn_is_over(int error);

#endif
