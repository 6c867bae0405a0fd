/* SPDX-License-Identifier: MIT
 *
 * buffers.h - what sits between a controller and its host: acceptance filters (M12), buffers for
 * received frames that the host has not fetched yet, and mailboxes.
 */
#ifndef CANWIRE_STATE_BUFFERS_H
#define CANWIRE_STATE_BUFFERS_H

#include "canwire.h"
#include "rule/rule.h"

/* A received frame that the host has not fetched yet. */
typedef struct cw_stored_frame {
    uint64_t due; /* tick at which the host has fetched it */
    uint8_t box;  /* its mailbox */
    cw_frame_origin origin;
    cw_frame frame;
} cw_stored_frame;

/* The buffers of one node. All 0: its host takes each frame at once. */
typedef struct cw_buffers {
    const cw_filter *filters;
    unsigned filter_count;    /* 0: every frame is accepted */
    unsigned limit;           /* frames that may wait for the host; 0: frames are not stored */
    cw_stored_frame *stored;  /* a ring of limit + 1, in the order of the frames */
    unsigned first;
    unsigned count;
    unsigned byte_limit;      /* of them together, as the SJA1000 counts; 0: none */
    uint64_t service_ticks;   /* time that the host needs for each */
    bool overload;            /* overload frames are wanted while they are full (O1 a) */
    bool boxed;               /* the host gets what the receive mailboxes take */
    cw_mailbox *boxes;        /* the frame of one with a reply is what was written last */
    uint64_t receive_boxes;   /* sets of mailboxes by their numbers */
    uint64_t transmit_boxes;
    uint64_t reply_boxes;
    uint64_t written;         /* reply boxes that the host has written */
    uint64_t newer;           /* ... since their reply was queued */
    uint8_t transmit;         /* cw_transmit */
    cw_host_stats stats;
} cw_buffers;

#define CW_NO_BOX 0xFFu /* of a frame without mailbox that does not wait for one */

#endif
