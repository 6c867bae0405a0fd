/* SPDX-License-Identifier: MIT
 *
 * bcm_tx.c - frames that CAN_BCM sends periodically.
 */
#include "preload/bcm_op.h"

#include <errno.h>

/* Returns the time to the next frame; 0: there is none. */
static int64_t span_of(const bcm_op *op)
{
    const int64_t first = bcm_op_ns(&op->as.ival1);
    return first > 0 && op->as.count > 0 ? first : bcm_op_ns(&op->as.ival2);
}

/* Sets the time of the next frame, which keeps its pace when this one was late. */
static void set_next(bcm_op *op, int64_t from_ns)
{
    const int64_t span = span_of(op), now_ns = pump_now_ns();
    const int64_t next = from_ns + span;
    op->timer.due_ns = span == 0 ? PUMP_NEVER : next > now_ns ? next : now_ns + span;
}

/* Sends the next frame: `count` frames in steps of ival1, then others in steps of ival2. */
static void bcm_tx_on_timer(pump_item *self, bool readable)
{
    bcm_op *op = self->user;
    const int64_t due_ns = self->due_ns;
    (void)readable;
    if (bcm_op_ns(&op->as.ival1) > 0 && op->as.count > 0) {
        op->as.count--;
        if (op->as.count == 0 && (op->as.flags & TX_COUNTEVT))
            bcm_op_tell(op, TX_EXPIRED, NULL, 0);
        bcm_op_transmit(op);
    } else if (bcm_op_ns(&op->as.ival2) > 0) {
        bcm_op_transmit(op);
    }
    set_next(op, due_ns);
}

/* Starts as the flags say. */
static void bcm_tx_start(bcm_op *op, unsigned flags)
{
    if (flags & TX_RESET_MULTI_IDX)
        op->current = 0;
    if ((flags & SETTIMER) && bcm_op_ns(&op->as.ival1) == 0 && bcm_op_ns(&op->as.ival2) == 0)
        op->timer.due_ns = PUMP_NEVER;
    if (flags & STARTTIMER)
        op->as.flags |= TX_ANNOUNCE;
    if (op->as.flags & TX_ANNOUNCE) {
        bcm_op_transmit(op);
        if (bcm_op_ns(&op->as.ival1) > 0 && op->as.count > 0)
            op->as.count--;
    }
    if (flags & STARTTIMER)
        set_next(op, pump_now_ns());
    op->timer.run = bcm_tx_on_timer;
    pump_put(&op->timer);
}

/* With TX_CP_CAN_ID all frames of a job have the identifier of the job. */
static void set_identifiers(bcm_op *op)
{
    for (unsigned i = 0; i < op->as.nframes; i++) {
        struct can_frame *frame = (struct can_frame *)(void *)(op->frames + i * op->frame_bytes);
        frame->can_id = op->as.can_id;
    }
}

int bcm_tx_setup(const bcm_request *request)
{
    struct bcm *b = request->socket->bcm;
    const unsigned count = request->head.nframes;
    bcm_op *op = bcm_op_find(b->tx, request);
    if (request->index == 0)
        return ENODEV;
    if (count < 1 || count > BCM_FRAMES_MAX)
        return EINVAL;
    if (op && count > op->room)
        return E2BIG;
    const bool fresh = !op;
    if (fresh)
        op = bcm_op_new(&b->tx, request, count);
    if (!op)
        return ENOMEM;
    if (bcm_op_copy(op->frames, request) != 0) {
        if (fresh)
            (void)bcm_op_delete(&b->tx, request);
        return EINVAL;
    }
    if (op->as.nframes != count)
        op->current = 0;
    bcm_op_set(op, request);
    if (request->head.flags & TX_CP_CAN_ID)
        set_identifiers(op);
    bcm_tx_start(op, request->head.flags);
    return 0;
}
