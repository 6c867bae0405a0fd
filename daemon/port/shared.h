/* SPDX-License-Identifier: MIT
 *
 * shared.h - the programs at a port, which take turns and see each other's frames. unix.c and tcp.c
 * let them in.
 *
 * The file descriptor of the port is an epoll set, which stays the same when programs come and go.
 */
#ifndef CANWIRE_PORT_SHARED_H
#define CANWIRE_PORT_SHARED_H

#include "base/alarm.h"
#include "port/kind.h"
#include "port/member.h"
#include "port/underway.h"

/* Marks of the epoll set: the place of a client, or one of these. */
#define SHARED_PLAIN PORT_CLIENTS_MAX
#define SHARED_LISTENER (PORT_CLIENTS_MAX + 1u)
#define SHARED_TIMER (PORT_CLIENTS_MAX + 2u)
#define SHARED_WATCHED_MAX (PORT_CLIENTS_MAX + 3u)

/* The functions of a kind of shared ports. */
typedef struct shared_ways {
    const member_kind *member;
    /* Accepts connections that wait. */
    void (*accept)(port *p);
    /* Answers a hello, by shared_greet() for example. */
    void (*greet)(port *p, member *c);
    /* The plain ECU, at SHARED_PLAIN; NULL: such ports have none. The first reads up to max
     * messages, and returns the number of frames; *waits: more may be there. */
    unsigned (*read_plain)(port *p, port_frame *frames, unsigned max, bool *waits);
    port_sent (*send_plain)(port *p, const void *frame, size_t size);
} shared_ways;

/* Counts of frames since the port was opened. */
typedef struct shared_traffic {
    uint64_t frames_in; /* of clients */
    uint64_t bytes_in;
    uint64_t frames_out; /* of the bus */
    uint64_t bytes_out;
} shared_traffic;

/* The common part of shared ports, at their beginning. */
typedef struct port_shared {
    port base;
    const shared_ways *ways;
    member programs[PORT_CLIENTS_MAX + 1]; /* at SHARED_PLAIN the plain ECU, without a state */
    unsigned client_count;
    wake_alarm timer; /* in the epoll set; closed: none */
    bool deaf;     /* the listener is not watched: accept() failed without resources */
    bool crowded;  /* frames had to wait: programs take turns */
    unsigned turn; /* the one that was read last */
    uint32_t last_id;
    port_sharing sharing;
    char node[MESSAGE_NAME_BYTES];
    underway underway;
    shared_traffic traffic;
} port_shared;

/* Makes a port, with functions that are those below or call them. size: of the kind's struct.
 * Returns NULL without memory; p->fd is -1 without descriptors. */
port *shared_new(const port_kind *kind, const shared_ways *ways, size_t size);

/* Closes all programs, and frees the port. */
void shared_close(port *p);

/* Watches a descriptor, with a mark of the epoll set. */
bool shared_watch(const port *p, int fd, unsigned what);

/* Stops or resumes watching the listener. A connection that cannot be accepted now would wake the
 * loop for ever; each read tries again. */
void shared_set_deaf(port *p, int listener, bool deaf);

/* Prepares a socket for frames and their time stamps. room: bytes that its program has not read. */
bool shared_prepare(int fd, int room);

/* Takes a client, or turns it away: its socket is the port's from now on. */
void shared_take_client(port *p, int fd);

/* Moves a client that has said hello to another port of its kind. Returns it, NULL without room. */
member *shared_move(port *from, member *c, port *to);

/* Lets a client in, or says that the port is full. */
void shared_greet(port *p, member *c);

void shared_disconnect(port *p, member *c);

/* Gives a new port a timer, so that programs can do something by themselves. */
bool shared_add_timer(port *p);

/* Wakes the port's loop at a time, CLOCK_MONOTONIC, if that is earlier than when it wakes anyway;
 * only for ports with a timer. */
void shared_wake_at(port *p, int64_t ns);

/* The functions of a port_kind. */
unsigned shared_read(port *p, port_frame frames[PORT_BATCH], unsigned max, bool *more);
port_sent shared_send(port *p, const void *frame, size_t size);
void shared_share(port *p, const port_sharing *sharing);
void shared_crowd(port *p);
void shared_handed_in(port *p, const port_frame *frame);
void shared_ended(port *p, const cw_event *event);
bool shared_client(const port *p, unsigned n, port_client_info *out);
void shared_obeyed(port *p, const char *problem);
void shared_tell_state(port *p, const message_state *state);
void shared_settle(port *p);

#endif
