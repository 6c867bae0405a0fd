/* SPDX-License-Identifier: MIT
 *
 * bcm_op.h - the jobs of CAN_BCM sockets, as net/can/bcm.c of the kernel has them.
 */
#ifndef CANWIRE_PRELOAD_BCM_OP_H
#define CANWIRE_PRELOAD_BCM_OP_H

#include "preload/pump.h"
#include "preload/table.h"

#include <linux/can/bcm.h>

#define BCM_FRAMES_MAX 256u

/* The fixed part of struct bcm_msg_head. */
typedef struct bcm_head {
    uint32_t opcode;
    uint32_t flags;
    uint32_t count;
    struct bcm_timeval ival1;
    struct bcm_timeval ival2;
    canid_t can_id;
    uint32_t nframes;
} __attribute__((aligned(8))) bcm_head;

_Static_assert(sizeof(bcm_head) == sizeof(struct bcm_msg_head), "");

typedef struct bcm_op {
    struct bcm_op *next;
    cansock *socket;
    int index;              /* of the interface; 0: all */
    bcm_head as; /* flags, count, intervals, identifier and number of frames */
    size_t frame_bytes;
    unsigned room;          /* frames */
    unsigned current;       /* the one that is sent next */
    unsigned char *frames;  /* that are sent; or masks for those that are received */
    unsigned char *last;    /* frames that were received */
    int64_t told_ns;        /* when a change was told, while changes are held back; 0: not yet */
    uint64_t realtime_ns;   /* of the frame that was received */
    int from;               /* its interface */
    pump_item timer;
    pump_item throttle;
} bcm_op;

struct bcm {
    bool connected;
    bool foreign; /* the jobs are another process's */
    bcm_op *tx;
    bcm_op *rx;
};

/* A message of the program. */
typedef struct bcm_request {
    cansock *socket;
    int index;
    bcm_head head;
    size_t frame_bytes;
    const unsigned char *frames;
} bcm_request;

/* Returns the job of a request. */
bcm_op *bcm_op_find(bcm_op *first, const bcm_request *request);

/* Makes a job for that many frames, and puts it first. Returns NULL without memory. */
bcm_op *bcm_op_new(bcm_op **first, const bcm_request *request, unsigned room);

/* Removes one, or all. Returns false when there is none. */
bool bcm_op_delete(bcm_op **first, const bcm_request *request);
void bcm_op_delete_all(bcm_op **first);

/* Copies the frames of a request. Returns 0, or EINVAL when one is too long. */
int bcm_op_copy(unsigned char *to, const bcm_request *request);

/* Takes flags and number of frames, and with SETTIMER the intervals. */
void bcm_op_set(bcm_op *op, const bcm_request *request);

int64_t bcm_op_ns(const struct bcm_timeval *span);

/* Sends the current frame to the bus. */
void bcm_op_transmit(bcm_op *op);

/* Tells the program; frames may be NULL. */
void bcm_op_tell(const bcm_op *op, unsigned opcode, const void *frames, unsigned count);

/* Sends one frame. */
void bcm_transmit(cansock *s, int index, const void *frame, size_t size);

/* The jobs of both directions. These return 0 or an errno. */
int bcm_tx_setup(const bcm_request *request);
int bcm_rx_setup(const bcm_request *request);

/* Takes a frame of the bus. */
void bcm_rx_frame(bcm_op *op, int index, uint64_t realtime_ns, const void *frame, size_t size);

#endif
