/* SPDX-License-Identifier: MIT
 *
 * linkwatch.h - reports changes of network interfaces, through rtnetlink. It needs no capability.
 */
#ifndef CANWIRE_PORT_LINKWATCH_H
#define CANWIRE_PORT_LINKWATCH_H

#include <ev.h>
#include <stdbool.h>

typedef struct linkwatch linkwatch;

/* The callbacks; all are called from the loop. */
typedef struct linkwatch_calls {
    /* Reports an interface, perhaps with another name or state than before. up: it can carry
     * frames; a vxcan needs a peer that is up, too. kind: as in `ip link`, such as "vcan"; ""
     * without a kind. */
    void (*seen)(void *user, unsigned index, const char *name, const char *kind, bool up);
    void (*gone)(void *user, unsigned index);
    /* Reports the end of a requested list of all interfaces. */
    void (*listed)(void *user);
    /* Reports the beginning of such a list. */
    void (*listing)(void *user);
    /* Reports that a list failed or broke off, for a reason that has been logged. Interfaces that
     * were not reported may exist. The user asks again some time later. */
    void (*failed)(void *user);
} linkwatch_calls;

/* Starts and asks for a first list. `calls` and `user` must live longer. Returns NULL after logging
 * the reason. */
linkwatch *linkwatch_start(struct ev_loop *loop, const linkwatch_calls *calls, void *user);

/* Stops. NULL is allowed. */
void linkwatch_stop(linkwatch *w);

/* Asks for a list of all interfaces. This happens automatically after messages were lost. */
void linkwatch_list(linkwatch *w);

#endif
