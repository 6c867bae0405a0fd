/* SPDX-License-Identifier: MIT
 *
 * outlook.h - the part of each node in the next frame, while all nodes are idle.
 *
 * A look at all controllers finds the outlook, which then stays the same. A change of a controller
 * makes it invalid (`valid`), and the next decision looks again.
 */
#ifndef CANWIRE_OUTLOOK_H
#define CANWIRE_OUTLOOK_H

#include "canwire.h"

typedef struct cw_outlook {
    bool valid;
    bool calm;              /* each node is idle, or away until a call or rule changes it */
    uint64_t listeners;     /* idle nodes, which will receive the next frame or send it */
    uint64_t away;          /* off or bus-off */
    uint64_t senders;       /* listeners that may transmit */
    uint64_t acknowledgers; /* listeners that acknowledge */
    uint64_t counting;      /* acknowledgers whose REC a good frame lowers (R8) */
    uint64_t one_shot;      /* senders that try once (M13) */
} cw_outlook;

/* Looks at all controllers. They are idle or away, and so is the one that followers share. */
void cw_outlook_find(cw_bus *bus);

/* Asserts that a new look would find the same. */
void cw_assert_outlook(const cw_bus *bus);

#endif
