/* SPDX-License-Identifier: MIT
 *
 * linkwatch.h - tells what becomes of network interfaces, as rtnetlink does. Needs no capability.
 */
#ifndef CANWIRE_PORT_LINKWATCH_H
#define CANWIRE_PORT_LINKWATCH_H

#include <ev.h>
#include <stdbool.h>

typedef struct linkwatch linkwatch;

/* All are called from the loop. */
typedef struct linkwatch_calls {
    /* An interface is there, perhaps with another name or state than before. up: it can carry
     * frames, which a vxcan does only when its peer is up, too. kind: as `ip link` has it, such as
     * "vcan"; "" where there is none. */
    void (*seen)(void *user, unsigned index, const char *name, const char *kind, bool up);
    void (*gone)(void *user, unsigned index);
    /* All interfaces of a list that was asked for have been seen. */
    void (*listed)(void *user);
    /* Such a list begins. */
    void (*listing)(void *user);
    /* There is no such list, or no more of it: what it has not told of may be there all the same.
     * Why has been logged. The user is to ask again, some time later. */
    void (*failed)(void *user);
} linkwatch_calls;

/* Asks for a first list. `calls` and `user` must live longer. NULL after logging why. */
linkwatch *linkwatch_start(struct ev_loop *loop, const linkwatch_calls *calls, void *user);

/* NULL is fine. */
void linkwatch_stop(linkwatch *w);

/* Asks for a list of all interfaces. It is asked for by itself after messages were lost. */
void linkwatch_list(linkwatch *w);

#endif
