/* SPDX-License-Identifier: MIT
 *
 * gathered.h - frames of linux/can.h that one call of the kernel is to send to a socket.
 */
#ifndef CANWIRE_PORT_GATHERED_H
#define CANWIRE_PORT_GATHERED_H

#include "port/kind.h"

#define GATHERED_MAX 32u

typedef struct gathered {
    unsigned count;
    struct mmsghdr headers[GATHERED_MAX];
    struct iovec vectors[GATHERED_MAX];
    struct canfd_frame frames[GATHERED_MAX];
} gathered;

/* Sends one frame of a port, and returns the result. */
typedef port_sent gathered_one(port *p, const void *frame, size_t size);

/* Copies a frame of the port behind the others. All go at once when there is no room for more. */
port_sent gathered_take(gathered *self, port *p, const void *frame, size_t size);

/* Sends all frames in their order, at once as far as the kernel takes them. The others go by `one`,
 * so that each has a result of its own. Counts them for the port. Returns the number of those that
 * went at once. */
unsigned gathered_send(gathered *self, port *p, int socket, gathered_one *one);

#endif
