/* SPDX-License-Identifier: MIT
 *
 * kind.h - what the kinds of ports share; socketcan.c and unix.c are one each.
 *
 * All of them carry frames as Linux has them in linux/can.h, one in a message of a socket.
 */
#ifndef CANWIRE_PORT_KIND_H
#define CANWIRE_PORT_KIND_H

#include "port/port.h"

#include <linux/can.h>
#include <sys/socket.h>
#include <time.h>

/* What the kernel tells beside a message: its time stamp, and how many were dropped. */
#define PORT_STAMP_BYTES CMSG_SPACE(sizeof(struct timespec))
#define PORT_CONTROL_BYTES (PORT_STAMP_BYTES + CMSG_SPACE(sizeof(uint32_t)))

/* How it went with a frame for the ECU. */
typedef enum port_sent {
    PORT_SENT = 0,
    PORT_SEND_FAILED, /* the kernel did not take it */
    PORT_UNHEARD,     /* no ECU is connected */
    PORT_SENT_COUNT
} port_sent;

/* What a kind of ports does in its own way. */
typedef struct port_kind {
    /* Closes and frees it; all its file descriptors are open or -1. */
    void (*close)(port *p);
    /* As port_read(). */
    unsigned (*read)(port *p, port_frame frames[PORT_BATCH], unsigned max, bool *more);
    port_sent (*send)(port *p, const struct can_frame *frame);
    /* Brings those counters up to date that are kept elsewhere; NULL: there are none. */
    void (*count)(port *p);
    /* Room for what the kernel tells beside a message, at most PORT_CONTROL_BYTES. No more than
     * that: the file descriptors that somebody sends along must find none. */
    size_t control_bytes;
} port_kind;

/* Messages of one read. */
typedef struct port_messages {
    struct mmsghdr headers[PORT_BATCH];
    struct iovec vectors[PORT_BATCH];
    struct canfd_frame frames[PORT_BATCH];
    unsigned char controls[PORT_BATCH][PORT_CONTROL_BYTES];
} port_messages;

/* The first part of each kind's own. */
struct port {
    const port_kind *kind;
    int fd;         /* readable when frames wait; -1 while it is being opened */
    unsigned index; /* of its interface, or 0 */
    unsigned buffer_bytes; /* see port_buffer_bytes() */
    port_stats stats;
    uint32_t drops;        /* as the kernel counts them, modulo 2^32 */
    uint64_t told_dropped; /* of stats.kernel_dropped, what the ECU has been told of ... */
    uint64_t told_tick;    /* ... and when */
    int read_error;        /* errno of the last read, or 0 */
    int told_read_error;   /* see port_read_news() */
    errframe_limit limit;
    bool loopless_begun;
    int64_t loopless_before; /* what had been sent without loopback when it was opened */
    port_messages messages;
};

/* A port of that kind, all zero but for what is said here; size: of the kind's own. NULL: out of
 * memory. */
port *port_new(const port_kind *kind, size_t size);

/* Reads up to max (PORT_BATCH at most) messages that wait at a socket into p->messages. Returns
 * what recvmmsg() does. */
int port_receive(port *p, int socket, unsigned max);

/* Puts the frames for the bus among so many messages into frames; the others are counted. Returns
 * how many there are. */
unsigned port_take(port *p, port_frame frames[PORT_BATCH], int received);

/* The kernel has dropped so many frames of a socket since it was opened, modulo 2^32. */
void port_count_drops(port *p, uint32_t drops);

#endif
