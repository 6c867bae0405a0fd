/* SPDX-License-Identifier: MIT
 *
 * acceptor.h - accepts the connections of a socket that listens, some at a time.
 *
 * Without descriptors or memory the socket would stay readable and the loop spin. So it pauses for
 * a second each time. The first pause of such a lack is logged, and its end.
 */
#ifndef CANWIRE_SERVE_ACCEPTOR_H
#define CANWIRE_SERVE_ACCEPTOR_H

#include <ev.h>
#include <stdbool.h>

/* Takes a connection over. Its descriptor does not block. */
typedef void acceptor_take(void *user, int fd);

typedef struct acceptor {
    struct ev_loop *loop;
    acceptor_take *take;
    void *user;
    const char *kind; /* for messages: "control", "metrics" ... */
    const char *name; /* ... and where it listens */
    ev_io io;
    ev_timer tick;
    bool listens;
    unsigned pauses; /* in the present lack; 0: none */
    ev_tstamp paused; /* the last of them */
} acceptor;

/* Prepares an acceptor, which accepts nothing yet. kind and user must live longer. */
void acceptor_init(acceptor *a, struct ev_loop *loop, const char *kind, acceptor_take *take,
                   void *user);

/* Accepts at this socket, whose name must live until acceptor_stop() or a call with another. */
void acceptor_listen(acceptor *a, int fd, const char *name);

/* Accepts no more, until acceptor_listen(). The end of a lack is still told. */
void acceptor_stop(acceptor *a);

/* Ends it for good. */
void acceptor_end(acceptor *a);

#endif
