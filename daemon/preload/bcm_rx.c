/* SPDX-License-Identifier: MIT
 *
 * bcm_rx.c - changes of frames that CAN_BCM receives.
 *
 * The kernel keeps two marks in a byte of the last frames that classical frames do not use. So does
 * this file.
 */
#include "preload/bcm_op.h"

#include <errno.h>
#include <string.h>

#define FLAGS_AT 5u
#define LENGTH_AT 4u
#define DATA_AT 8u
#define RECEIVED 0x40u
#define HELD_BACK 0x80u

/* Returns eight bytes of a frame. */
static uint64_t word(const unsigned char *frame, size_t at)
{
    uint64_t bytes;
    memcpy(&bytes, frame + DATA_AT + at, sizeof bytes);
    return bytes;
}

static unsigned char *last_of(const bcm_op *op, unsigned i)
{
    return op->last + i * op->frame_bytes;
}

/* ---- Telling --------------------------------------------------------------------------------- */

/* Tells a change. It is no longer held back. */
static void bcm_rx_tell(const bcm_op *op, unsigned i)
{
    unsigned char *last = last_of(op, i);
    last[FLAGS_AT] &= (unsigned char)~HELD_BACK;
    bcm_op_tell(op, RX_CHANGED, last, 1);
}

/* Tells the changes that were held back. Returns their number. */
static unsigned tell_held_back(const bcm_op *op)
{
    unsigned told = 0;
    const unsigned count = op->as.nframes;
    for (unsigned i = count > 1; i < (count > 0 ? count : 1); i++) {
        if (!(last_of(op, i)[FLAGS_AT] & HELD_BACK))
            continue;
        bcm_rx_tell(op, i);
        told++;
    }
    return told;
}

/* The time ival2 is over. If changes came meanwhile, they are told, and it begins again. */
static void on_throttle(pump_item *self, bool readable)
{
    bcm_op *op = self->user;
    (void)readable;
    self->due_ns = PUMP_NEVER;
    if (tell_held_back(op) > 0)
        self->due_ns = pump_now_ns() + bcm_op_ns(&op->as.ival2);
    else
        op->told_ns = 0;
}

/* Takes a change, and tells it, or holds it back for the rest of ival2. */
static void change(bcm_op *op, unsigned i, const void *frame)
{
    const int64_t pause = bcm_op_ns(&op->as.ival2), now_ns = pump_now_ns();
    unsigned char *last = last_of(op, i);
    memcpy(last, frame, op->frame_bytes);
    last[FLAGS_AT] |= RECEIVED | HELD_BACK;
    if (pause == 0) {
        bcm_rx_tell(op, i);
        return;
    }
    if (op->throttle.due_ns != PUMP_NEVER)
        return;
    if (op->told_ns != 0 && now_ns - op->told_ns < pause) {
        op->throttle.due_ns = op->told_ns + pause;
        op->throttle.run = on_throttle;
        pump_put(&op->throttle);
        return;
    }
    bcm_rx_tell(op, i);
    op->told_ns = now_ns;
}

/* ---- Frames ---------------------------------------------------------------------------------- */

/* Takes a frame when it differs from the last one in a bit of the mask. */
static void bcm_rx_compare(bcm_op *op, unsigned i, const unsigned char *frame)
{
    const unsigned char *mask = op->frames + i * op->frame_bytes, *last = last_of(op, i);
    bool differs = !(last[FLAGS_AT] & RECEIVED);
    for (size_t at = 0; !differs && at < frame[LENGTH_AT]; at += sizeof(uint64_t))
        differs = (word(mask, at) & word(frame, at)) != (word(mask, at) & word(last, at));
    if ((op->as.flags & RX_CHECK_DLC) && frame[LENGTH_AT] != last[LENGTH_AT])
        differs = true;
    if (differs)
        change(op, i, frame);
}

/* Takes a frame of a job with several masks: the first one says which bits choose another one. */
static void bcm_rx_choose(bcm_op *op, const unsigned char *frame)
{
    const uint64_t bits = word(op->frames, 0);
    for (unsigned i = 1; i < op->as.nframes; i++)
        if ((bits & word(frame, 0)) == (bits & word(op->frames + i * op->frame_bytes, 0))) {
            bcm_rx_compare(op, i, frame);
            return;
        }
}

/* No frame has come for ival1. With RX_ANNOUNCE_RESUME the next one counts as a change. */
static void bcm_rx_on_timer(pump_item *self, bool readable)
{
    bcm_op *op = self->user;
    (void)readable;
    self->due_ns = PUMP_NEVER;
    bcm_op_tell(op, RX_TIMEOUT, NULL, 0);
    if (op->as.flags & RX_ANNOUNCE_RESUME)
        memset(op->last, 0, op->room * op->frame_bytes);
}

/* Watches the time to the next frame; without ival1 that is not limited. */
static void start_timer(bcm_op *op)
{
    if (bcm_op_ns(&op->as.ival1) == 0)
        return;
    op->timer.due_ns = pump_now_ns() + bcm_op_ns(&op->as.ival1);
    op->timer.run = bcm_rx_on_timer;
    pump_put(&op->timer);
}

/* Returns true for an identifier of the job, as can_rx_register() of the kernel compares it. */
static bool is_for(const bcm_op *op, canid_t can_id)
{
    const canid_t id = op->as.can_id;
    const canid_t bits = id & CAN_EFF_FLAG ? CAN_EFF_MASK : CAN_SFF_MASK;
    return ((can_id ^ id) & (bits | CAN_EFF_FLAG | CAN_RTR_FLAG)) == 0;
}

void bcm_rx_frame(bcm_op *op, int index, uint64_t realtime_ns, const void *frame, size_t size)
{
    canid_t can_id;
    memcpy(&can_id, frame, sizeof can_id);
    if (size != op->frame_bytes || (op->index != 0 && op->index != index) || !is_for(op, can_id))
        return;
    op->timer.due_ns = PUMP_NEVER;
    op->realtime_ns = realtime_ns;
    op->from = index;
    if (op->as.flags & RX_RTR_FRAME) {
        bcm_op_transmit(op);
        return;
    }
    if (op->as.flags & RX_FILTER_ID)
        change(op, 0, frame);
    else if (op->as.nframes == 1)
        bcm_rx_compare(op, 0, frame);
    else
        bcm_rx_choose(op, frame);
    if (!(op->as.flags & RX_NO_AUTOTIMER))
        start_timer(op);
}

/* ---- Setting up ------------------------------------------------------------------------------ */

/* The answer to a remote frame must not ask for itself. */
static void prepare_answer(bcm_op *op)
{
    struct can_frame *frame = (struct can_frame *)(void *)op->frames;
    op->timer.due_ns = op->throttle.due_ns = PUMP_NEVER;
    if (frame->can_id == op->as.can_id)
        frame->can_id &= ~CAN_RTR_FLAG;
}

/* SETTIMER takes new times, and tells all changes that the old ones held back. */
static void bcm_rx_start(bcm_op *op, unsigned flags)
{
    if (flags & SETTIMER) {
        if (bcm_op_ns(&op->as.ival1) == 0)
            op->timer.due_ns = PUMP_NEVER;
        op->told_ns = 0;
        op->throttle.due_ns = PUMP_NEVER;
        (void)tell_held_back(op);
    }
    if (flags & STARTTIMER)
        start_timer(op);
}

/* Refuses what the kernel refuses. Returns 0 or an errno. */
static int check(const bcm_head *head)
{
    if (head->nframes > BCM_FRAMES_MAX + 1)
        return EINVAL;
    if ((head->flags & RX_RTR_FRAME) && (head->nframes != 1 || !(head->can_id & CAN_RTR_FLAG)))
        return EINVAL;
    return 0;
}

int bcm_rx_setup(const bcm_request *asked)
{
    bcm_request request = *asked;
    struct bcm *b = request.socket->bcm;
    if ((request.head.flags & RX_FILTER_ID) || request.head.nframes == 0) {
        request.head.flags |= RX_FILTER_ID;
        request.head.nframes = 0;
    }
    if (check(&request.head) != 0)
        return EINVAL;
    bcm_op *op = bcm_op_find(b->rx, &request);
    const unsigned count = request.head.nframes;
    if (op && count > op->room)
        return E2BIG;
    const bool fresh = !op;
    if (fresh)
        op = bcm_op_new(&b->rx, &request, count > 0 ? count : 1);
    if (!op)
        return ENOMEM;
    if (bcm_op_copy(op->frames, &request) != 0) {
        if (fresh)
            (void)bcm_op_delete(&b->rx, &request);
        return EINVAL;
    }
    if (fresh)
        op->from = op->index;
    else if (count > 0)
        memset(op->last, 0, op->room * op->frame_bytes);
    bcm_op_set(op, &request);
    if (request.head.flags & RX_RTR_FRAME)
        prepare_answer(op);
    else
        bcm_rx_start(op, request.head.flags);
    return 0;
}
