/* SPDX-License-Identifier: MIT
 *
 * response.h - worst-case response times of periodic messages on one CAN bus.
 *
 * The analysis is exact. It is that of Davis, Burns, Bril and Lukkien, "Controller Area Network
 * (CAN) schedulability analysis: refuted, revisited and revised", Real-Time Systems 35 (2007).
 * Nodes whose frames do not go by their identifiers have an upper bound. Each frame waits there for
 * all others of the node, after Davis, Kollmann, Pollex and Slomka (2011).
 *
 * Frames of time-triggered slots are tried once (L1, L5). One that is sent has begun in its slot.
 * If nothing of its node goes before it, it has also begun right behind the frame on the bus: it
 * has only one arbitration.
 */
#ifndef CANWIRE_CLI_ANALYSE_RESPONSE_H
#define CANWIRE_CLI_ANALYSE_RESPONSE_H

#include "canwire.h"

/* One message. All times are ticks. */
typedef struct response_message {
    uint32_t key;      /* the lower one wins arbitration, see response_key() */
    unsigned node;
    bool fifo;         /* its node sends first in, first out, or in another order of its own. Of a
                          boxed one this is found */
    bool boxed;        /* a mailbox of its node is free for it, as long as none of the node is late:
                          then two frames of one message may take those of others */
    uint64_t period;   /* shortest time between two; CW_NEVER: it comes once */
    uint64_t jitter;   /* at most that late after the start of its period */
    uint64_t slot;     /* it begins before so much time has passed since it came, or is given up;
                          0: it waits. Its response is from then on, without the jitter */
    uint64_t length;   /* of its longest frame, with the intermission */
    uint64_t blocking; /* found: the longest frame of lower priority, that has just begun; with a
                          slot the longest time to the start of the frame */
    uint64_t response; /* found: from the start of the period to the end of the frame and its
                          intermission; CW_NEVER: there is no bound */
    uint64_t instances; /* found: that had to be looked at */
    uint64_t delay;    /* of a fifo node: until it comes first in its queue */
} response_message;

typedef struct response_bus {
    uint64_t bit;        /* of the arbitration phase */
    uint64_t error_every; /* one error in each such time; CW_NEVER: none */
    response_message *messages;
    size_t count;
    unsigned errors;     /* without error_every: so many in all, whenever they come */
} response_bus;

/* Returns the priority of a frame: the lower one wins. */
uint32_t response_key(const cw_frame *frame);

/* Returns true when a message may come later than its period ends. */
bool response_is_late(const response_message *m);

/* Finds blocking and response of all messages. */
void response_find(response_bus *bus);

#endif
