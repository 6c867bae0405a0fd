/* SPDX-License-Identifier: MIT
 *
 * member.h - one of several programs at a port, which speaks a protocol: that of messages.h, or
 * that of socketcand.
 *
 * It has a socket of its own, and the kernel bounds what waits in it. So a client that does not
 * read loses messages alone, and is told how many.
 */
#ifndef CANWIRE_PORT_MEMBER_H
#define CANWIRE_PORT_MEMBER_H

#include "port/kind.h"
#include "port/messages.h"

#define MEMBER_NAME_MAX 32u
#define MEMBER_LABEL_BYTES 64u /* a name, or the address of a program, with the final 0 */

/* The progress of a connection. */
typedef enum member_state {
    MEMBER_NONE = 0, /* the place is free */
    MEMBER_NEW,      /* its hello has not come */
    MEMBER_WAITS,    /* its hello has come; it waits for a node of its own */
    MEMBER_THERE
} member_state;

typedef struct member_kind member_kind;

typedef struct member {
    member_state state;
    const member_kind *kind;
    int fd;
    int pid;     /* of the process that has connected; 0: not known */
    uint32_t id; /* of the connection, which no other one of the port has; never 0 */
    uint32_t options;
    uint32_t error_mask;
    uint32_t lost;       /* messages that it had no room for */
    uint64_t read;       /* frames */
    uint64_t written;
    uint64_t flushable;    /* frames that were read while it might ask for a flush ... */
    uint64_t handed_in;    /* ... and that have been handed in */
    bool flushing;         /* it waits for the end of its frames ... */
    uint64_t flush_at;     /* ... of which this many were read */
    uint32_t flush_number; /* of its question */
    unsigned filter_count;
    struct can_filter *filters; /* NULL: all frames pass */
    char name[MEMBER_LABEL_BYTES];
    void *more;      /* data of its kind */
    bool stuck;      /* a part of a message waits for room in its socket ... */
    bool room_watched; /* ... and the port is woken by that */
    int64_t wake_ns; /* CLOCK_MONOTONIC at which it has something to do by itself; 0: never */
    bool peeked;
    int64_t next_ns; /* CLOCK_REALTIME at which its next message was sent, when peeked */
} member;

/* Takes over a connected socket. Returns false without memory. */
bool member_open(member *c, const member_kind *kind, int fd, uint32_t id);

/* Closes the socket; the place is free afterwards. */
void member_close(member *c);

/* The result of reading one message. */
typedef enum member_result {
    MEMBER_NOTHING = 0, /* no message waits */
    MEMBER_CONTROL,     /* a message about the client itself, or a wrong one */
    MEMBER_FRAME,
    MEMBER_GREETS,      /* its hello: the port answers */
    MEMBER_COMMAND,     /* an order: port.commands has it */
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

/* Answers a flush. */
void member_flushed(member *c, const message_head *head);

/* Tells a controller the state of its node. */
void member_tell_state(member *c, const message_head *head, const message_state *state);

/* Receives into `room` bytes, with the time stamp of what has come, or 0. cut: a message had no
 * room. Returns the size, 0 at the end, and -1 with errno. */
ssize_t member_receive(const member *c, void *bytes, size_t room, int flags, int64_t *stamp_ns,
                       bool *cut);

/* Returns true when nothing more will come from it; messages that it has sent may wait to be
 * read. */
bool member_has_gone(const member *c);

/* Returns true when a message, or a part of one, waits to be read. */
bool member_waits(const member *c);

/* Returns when its next message was sent; INT64_MAX without one. */
int64_t member_next_ns(member *c);

/* Returns true when a client takes a frame, by its filters and options. frame: of this size. */
bool member_takes(const member *c, const void *frame, size_t size);

/* Sends a message with a frame. Returns false, and counts the loss, when there is no room. */
bool member_send(member *c, const message_head *head, const void *frame, size_t size);

/* The functions of a protocol; see above. */
struct member_kind {
    bool (*open)(member *c);   /* NULL: nothing to do */
    void (*close)(member *c);  /* NULL: nothing to do */
    member_result (*read)(member *c, port *p, port_frame *out);
    /* Reads all that a program has left behind, at once. Returns the number of its frames, or
     * commands. */
    uint64_t (*lose)(member *c);
    void (*welcome)(member *c, const char *node, bool fd);
    void (*tell)(member *c, const message_head *head, int code, const char *text);
    void (*flushed)(member *c, const message_head *head); /* NULL: it has no flush */
    /* NULL: it is never a controller */
    void (*tell_state)(member *c, const message_head *head, const message_state *state);
    bool (*takes)(const member *c, const void *frame, size_t size);
    bool (*send)(member *c, const message_head *head, const void *frame, size_t size);
};

/* The protocol of messages.h; for the other one see socketcand.h. */
extern const member_kind member_messages;

#endif
