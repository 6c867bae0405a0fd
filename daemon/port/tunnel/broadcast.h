/* SPDX-License-Identifier: MIT
 *
 * broadcast.h - frames that are sent again and again, and frames that are received by their
 * identifier, as by the kernel's broadcast manager (CAN_BCM).
 *
 * Times are CLOCK_MONOTONIC.
 */
#ifndef CANWIRE_PORT_BROADCAST_H
#define CANWIRE_PORT_BROADCAST_H

#include <linux/can.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define BROADCAST_MAX 256u       /* jobs, and subscriptions */
#define BROADCAST_LEAST_NS 100000 /* between two frames of a job */

/* A frame that is sent again and again. */
typedef struct broadcast_job {
    struct can_frame frame;
    int64_t interval_ns; /* 0: it has been sent once */
    int64_t next_ns;     /* 0: never again */
} broadcast_job;

/* An identifier whose frames are received. */
typedef struct broadcast_subscription {
    canid_t id;
    bool by_content;  /* a frame passes when a bit under the mask has changed */
    uint8_t mask[CAN_MAX_DLEN];
    bool received;
    uint8_t last[CAN_MAX_DLEN];
    int64_t interval_ns; /* least time between two frames; 0: none */
    int64_t free_ns;     /* when the next one may pass */
    bool held;           /* the frame below waits for that */
    struct can_frame frame;
    int64_t realtime_ns;
} broadcast_subscription;

typedef struct broadcast {
    broadcast_job *jobs;
    size_t job_count;
    broadcast_subscription *subscriptions;
    size_t subscription_count;
} broadcast;

void broadcast_free(broadcast *b);

/* Adds a job, or replaces the one of its identifier. Returns false when there are too many. */
bool broadcast_add(broadcast *b, const struct can_frame *frame, int64_t interval_ns,
                   int64_t now_ns);

/* Gives a job another frame. Returns false when there is none of its identifier. */
bool broadcast_update(broadcast *b, const struct can_frame *frame);

bool broadcast_delete(broadcast *b, canid_t id);

/* Takes the frame of a job that is due. Returns false without one. late_ns: since when. */
bool broadcast_due(broadcast *b, struct can_frame *frame, int64_t now_ns, int64_t *late_ns);

/* Subscribes to an identifier, instead of an earlier subscription. mask: NULL for any content.
 * Returns false when there are too many. */
bool broadcast_subscribe(broadcast *b, canid_t id, const uint8_t mask[CAN_MAX_DLEN],
                         int64_t interval_ns);

bool broadcast_unsubscribe(broadcast *b, canid_t id);

bool broadcast_wants(const broadcast *b, canid_t id);

/* Returns true when a frame passes now. One that comes too early is held back. */
bool broadcast_passes(broadcast *b, const struct can_frame *frame, int64_t realtime_ns,
                      int64_t now_ns);

/* Takes a frame that has been held back until now. Returns false without one. */
bool broadcast_held(broadcast *b, struct can_frame *frame, int64_t *realtime_ns, int64_t now_ns);

/* Returns when one of the functions above has something to do; 0: never. */
int64_t broadcast_next_ns(const broadcast *b);

#endif
