/* SPDX-License-Identifier: MIT
 *
 * kind.h - the shared part of the kinds of ports; socketcan.c and unix.c are one each.
 *
 * All kinds carry frames of linux/can.h, one in each message of a socket.
 */
#ifndef CANWIRE_PORT_KIND_H
#define CANWIRE_PORT_KIND_H

#include "port/port.h"

#include <linux/can.h>
#include <sys/socket.h>
#include <time.h>

/* The kernel's data next to a message: its time stamp, and the number of dropped messages. */
#define PORT_STAMP_BYTES CMSG_SPACE(sizeof(struct timespec))
#define PORT_CONTROL_BYTES (PORT_STAMP_BYTES + CMSG_SPACE(sizeof(uint32_t)))

/* Of a connection over TCP: bytes that wait to be read, and that a segment has at most. */
#define PORT_TCP_BYTES (1 << 15)
#define PORT_TCP_SEGMENT_BYTES 1400

/* The result of sending a frame to the ECU. */
typedef enum port_sent {
    PORT_SENT = 0,
    PORT_SEND_FAILED, /* the kernel did not take it */
    PORT_UNHEARD,     /* no ECU is connected, or none that takes such frames */
    PORT_GATHERED,    /* it goes later, see port_gather() */
    PORT_SENT_COUNT
} port_sent;

/* The functions of a kind of ports. */
typedef struct port_kind {
    /* Closes and frees the port; all its file descriptors are open or -1. */
    void (*close)(port *p);
    /* See port_read(). */
    unsigned (*read)(port *p, port_frame frames[PORT_BATCH], unsigned max, bool *more);
    /* Sends a struct can_frame or canfd_frame, by its size. */
    port_sent (*send)(port *p, const void *frame, size_t size);
    /* Sends all frames that were gathered; NULL: it gathers none. */
    void (*flush)(port *p);
    /* Updates counters that are kept elsewhere; NULL: there are none. */
    void (*count)(port *p);
    /* See port_mtu(); NULL: it has no interface. */
    unsigned (*mtu)(const port *p);
    /* See port_share(), port_handed_in(), port_ended() and port_client(); NULL: its ECU is one
     * program, or the kernel knows how many. */
    void (*share)(port *p, const port_sharing *sharing);
    void (*crowd)(port *p); /* frames have to wait from now on */
    void (*handed_in)(port *p, const port_frame *frame);
    void (*ended)(port *p, const cw_event *event);
    bool (*client)(const port *p, unsigned n, port_client_info *out);
    bool (*is_over)(const port *p);
    /* See port_tunnel(); NULL: it is not one. */
    bool (*tunnel)(const port *p, port_tunnel_info *out);
    /* See port_obeyed(), port_tell_state() and port_settle(); NULL: it has no controller. */
    void (*obeyed)(port *p, const char *problem);
    void (*tell_state)(port *p, const message_state *state);
    void (*settle)(port *p);
    /* Bytes for the kernel's data next to a message, at most PORT_CONTROL_BYTES. More room would
     * accept file descriptors that a sender passes along. */
    size_t control_bytes;
} port_kind;

/* The messages of one read. */
typedef struct port_messages {
    struct mmsghdr headers[PORT_BATCH];
    struct iovec vectors[PORT_BATCH];
    struct canfd_frame frames[PORT_BATCH];
    unsigned char controls[PORT_BATCH][PORT_CONTROL_BYTES];
} port_messages;

/* Orders of the controller of the node, and the state that it has been told. */
typedef struct port_commands {
    port_command next;
    bool waits; /* `next` is to be obeyed; nothing is read before */
    char settings[MESSAGE_SETTINGS_BYTES]; /* those that were obeyed last */
    bool told_any;
    message_state told;
} port_commands;

/* The common part of all kinds, at their beginning. */
struct port {
    const port_kind *kind;
    int fd;         /* readable when frames wait; -1 while it is being opened */
    unsigned index; /* of its interface, or 0 */
    unsigned buffer_bytes; /* see port_buffer_bytes() */
    port_stats stats;
    uint32_t drops;        /* the kernel's counter, modulo 2^32 */
    uint64_t reported_dropped; /* part of stats.kernel_dropped that the ECU knows of ... */
    uint64_t reported_tick; /* ... and the time of that report */
    port_commands *commands; /* NULL: its node has no controller elsewhere */
    bool shared;           /* see port_is_shared() */
    uint64_t now_tick;     /* of what is sent now, see port_set_time() ... */
    int64_t now_realtime_ns;
    int read_error;        /* errno of the last read, or 0 */
    int reported_read_error;   /* see port_reading_changed() */
    bool gathers;          /* see port_gather() */
    errframe_limit limit;
    port_told told[PORT_TOLD_MAX]; /* see port_take_told() */
    unsigned told_count;
    bool loopless_begun;
    int64_t loopless_before; /* frames sent without loopback before it was opened */
    port_messages messages;
};

/* Makes a port of a kind, all zero except for the members set here. size: of the kind's struct.
 * Returns NULL without memory. */
port *port_new(const port_kind *kind, size_t size);

/* Reads up to max (PORT_BATCH at most) messages that wait at a socket into p->messages. Returns the
 * result of recvmmsg(). */
int port_receive(port *p, int socket, unsigned max);

/* Returns true when received message i is a frame; raw CAN sockets have no other messages. */
bool port_is_frame(const port *p, unsigned i);

/* Copies the frames for the bus among the received messages to `frames`, and error frames for other
 * programs; counts the other messages. Returns the number of frames. */
unsigned port_take(port *p, port_frame frames[PORT_BATCH], int received);

/* Takes a frame of linux/can.h, by its size. Returns false, and counts the reason, when it is
 * neither one for the bus nor an error frame for other programs. */
bool port_take_frame(port *p, port_frame *out, const struct canfd_frame *in, size_t size);

/* Makes a frame of linux/can.h of an error frame that a program has written. Returns its size. */
size_t port_make_error(struct canfd_frame *out, const cw_frame *in);

/* Makes a frame of linux/can.h. Returns its size. */
size_t port_make_frame(struct canfd_frame *out, const cw_frame *in);

/* Counts a frame of linux/can.h that was sent, or was not. */
void port_count_sent(port *p, uint32_t can_id, port_sent sent);

/* Reads the kernel's data next to a message: the arrival, 0 when unknown, and the number of
 * messages dropped before it. */
int64_t port_take_control(port *p, struct msghdr *header);

/* Notes what a process was told. */
void port_note_told(port *p, int pid, unsigned what);

/* Returns the process that has made a connection, 0 when it is not known. */
int port_peer_of(int fd);

/* Sets the kernel's count of dropped frames of a socket since it was opened, modulo 2^32. */
void port_count_drops(port *p, uint32_t drops);

/* Bounds what the kernel keeps of a peer over TCP that has to wait. To be called before listen()
 * and connect(); accepted connections have it, too. */
void port_bound_tcp(int fd);

#endif
