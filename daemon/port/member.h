/* SPDX-License-Identifier: MIT
 *
 * member.h - one of several programs at a port, which speaks the protocol of messages.h.
 *
 * It has a socket of its own, and the kernel bounds what waits in it. So a client that does not
 * read loses messages alone, and is told how many.
 */
#ifndef CANWIRE_PORT_MEMBER_H
#define CANWIRE_PORT_MEMBER_H

#include "port/kind.h"
#include "port/messages.h"

#define MEMBER_NAME_MAX 32u

/* The progress of a connection. */
typedef enum member_state {
    MEMBER_NONE = 0, /* the place is free */
    MEMBER_NEW,      /* its hello has not come */
    MEMBER_WAITS,    /* its hello has come; it waits for a node of its own */
    MEMBER_THERE
} member_state;

typedef struct member {
    member_state state;
    int fd;
    uint32_t id; /* of the connection, which no other one of the port has; never 0 */
    uint32_t options;
    uint32_t error_mask;
    uint32_t lost;       /* messages that it had no room for */
    uint64_t read;       /* frames */
    uint64_t written;
    unsigned filter_count;
    struct can_filter *filters; /* NULL: all frames pass */
    char name[MEMBER_NAME_MAX + 1];
    bool peeked;
    int64_t next_ns; /* CLOCK_REALTIME at which its next message was sent, when peeked */
} member;

/* Takes over a connected socket. */
void member_open(member *c, int fd, uint32_t id);

/* Closes the socket; the place is free afterwards. */
void member_close(member *c);

/* The result of reading one message. */
typedef enum member_result {
    MEMBER_NOTHING = 0, /* no message waits */
    MEMBER_CONTROL,     /* a message about the client itself, or a wrong one */
    MEMBER_FRAME,
    MEMBER_GREETS,      /* its hello: the port answers */
    MEMBER_GONE         /* it has gone, or must go */
} member_result;

/* Reads one message. p counts what is wrong. */
member_result member_read(member *c, port *p, port_frame *out);

/* Answers the hello: the client is there from now on. */
void member_welcome(member *c, const char *node, bool fd);

/* Sends an error message. */
void member_refuse(member *c, unsigned type, int code, const char *text);

/* Sends a message with a code and a text. */
void member_tell(member *c, const message_head *head, int code, const char *text);

/* Returns when its next message was sent; INT64_MAX without one. */
int64_t member_next_ns(member *c);

/* Returns true when a client takes a frame, by its filters and options. frame: of this size. */
bool member_takes(const member *c, const void *frame, size_t size);

/* Sends a message with a frame. Returns false, and counts the loss, when there is no room. */
bool member_send(member *c, const message_head *head, const void *frame, size_t size);

#endif
