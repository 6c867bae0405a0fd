/* SPDX-License-Identifier: MIT
 *
 * programs.h - the connections of programs that have joined virtual time, by the protocol of
 * port/timing.h.
 */
#ifndef CANWIRE_ENGINE_PROGRAMS_H
#define CANWIRE_ENGINE_PROGRAMS_H

#include "engine/turns.h"

#include <ev.h>

typedef struct programs programs;

typedef struct programs_calls {
    /* Returns the place of a node, for the order of turns; CW_NODES_MAX: there is none. */
    unsigned (*find_node)(void *user, const char *name);
    /* A program has come, waits, or has gone. */
    void (*changed)(void *user);
} programs_calls;

/* Listens at a path; where: the FILE:LINE:COLUMN that asks for it. Returns NULL after logging the
 * reason. */
programs *programs_open(struct ev_loop *loop, const char *path, const char *where,
                        const programs_calls *calls, void *user);

/* Lets programs come from now on. */
void programs_begin(programs *p);

/* Takes those who have come up to now. */
void programs_let_in(programs *p);

/* Ends all connections. NULL is allowed. */
void programs_close(programs *p);

/* Their turns, which live as long as they. */
turns *programs_turns(programs *p);

/* Tells a program that its turn begins. */
void programs_tell_now(programs *p, unsigned place, int64_t bus_ns, int64_t realtime_ns);

#endif
