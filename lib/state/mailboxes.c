/* SPDX-License-Identifier: MIT
 *
 * mailboxes.c - the mailboxes of controllers that have one for each message (FullCAN).
 *
 * A transmit mailbox has one frame. Frames that find no free one wait in the queue. So the frames
 * of a queue are of two kinds: those in mailboxes go first, and the others wait behind them.
 */
#include "state/state.h"

/* ---- Sets of mailboxes ----------------------------------------------------------------------- */

unsigned cw_mailbox_for(const cw_buffers *b, uint64_t boxes, const cw_frame *frame)
{
    for (; boxes; boxes &= boxes - 1) {
        const unsigned box = cw_lowest_node(boxes);
        if (cw_frame_matches(frame, &b->boxes[box].filter, 1))
            return box;
    }
    return CW_NO_BOX;
}

uint64_t cw_mailboxes_full(const cw_queue *q)
{
    uint64_t full = 0;
    for (unsigned n = 0; n < q->boxed; n++)
        full |= cw_box_bit(q->order[q->count - 1u - n].box);
    return full;
}

/* Returns the mailbox that a slot of the queue is in, or CW_NO_BOX. */
static unsigned box_of(const cw_queue *q, uint16_t slot)
{
    for (unsigned n = 0; n < q->boxed; n++)
        if (cw_queue_nth(q, n) == slot)
            return q->order[q->count - 1u - n].box;
    return CW_NO_BOX;
}

/* ---- Transmission ---------------------------------------------------------------------------- */

bool cw_mailboxes_take(const cw_bus *bus, unsigned i, const cw_frame *frame)
{
    const cw_buffers *b = &bus->buffers[i];
    return !b->boxes || cw_mailbox_for(b, b->transmit_boxes, frame) != CW_NO_BOX;
}

void cw_mailboxes_put_into(cw_bus *bus, unsigned i, uint16_t slot, unsigned box)
{
    const cw_buffers *b = &bus->buffers[i];
    cw_queue *q = &bus->nodes[i].queue;
    uint32_t key = 0;
    if (b->transmit == CW_TRANSMIT_PRIORITY)
        key = cw_queue_priority(cw_queue_at(q, slot)->frame);
    else if (b->transmit == CW_TRANSMIT_NUMBER)
        key = box;
    cw_queue_put_into_box(q, slot, box, key);
    if (b->reply_boxes & cw_box_bit(box))
        bus->replying |= cw_node_bit(i);
}

/* Moves a frame that waits into one of these mailboxes, if one takes it. */
static bool put_into_one(cw_bus *bus, unsigned i, uint16_t slot, uint64_t boxes)
{
    const cw_queue *q = &bus->nodes[i].queue;
    const unsigned box = cw_mailbox_for(&bus->buffers[i], boxes, cw_queue_at(q, slot)->frame);
    if (box == CW_NO_BOX)
        return false;
    cw_mailboxes_put_into(bus, i, slot, box);
    return true;
}

void cw_mailboxes_find_one(cw_bus *bus, unsigned i)
{
    const cw_buffers *b = &bus->buffers[i];
    const cw_queue *q = &bus->nodes[i].queue;
    const uint16_t slot = q->newest;
    if (b->boxes && !put_into_one(bus, i, slot, b->transmit_boxes & ~cw_mailboxes_full(q)) &&
        !cw_mailboxes_take(bus, i, cw_queue_at(q, slot)->frame))
        cw_mailboxes_put_into(bus, i, slot, CW_NO_BOX);
}

/* Only the mailbox that is free now can be one for frames that have waited. */
void cw_mailboxes_remove(cw_bus *bus, unsigned i, uint16_t slot)
{
    cw_queue *q = &bus->nodes[i].queue;
    const cw_buffers *b = &bus->buffers[i];
    const uint64_t box = cw_box_bit(box_of(q, slot));
    cw_queue_remove(q, slot);
    if (cw_mailbox_replies(bus, i) == 0)
        bus->replying &= ~cw_node_bit(i);
    for (unsigned n = q->boxed; (box & b->transmit_boxes) && n < q->count; n++)
        if (put_into_one(bus, i, cw_queue_nth(q, n), box))
            return;
}

/* ---- Replies --------------------------------------------------------------------------------- */

bool cw_mailboxes_is_reply(const cw_bus *bus, unsigned i, unsigned n)
{
    const cw_queue *q = &bus->nodes[i].queue;
    return bus->buffers && n < q->boxed &&
           (bus->buffers[i].reply_boxes & cw_box_bit(q->order[q->count - 1u - n].box));
}

unsigned cw_mailbox_replies(const cw_bus *bus, unsigned i)
{
    unsigned count = 0;
    for (unsigned n = 0; bus->buffers && n < bus->nodes[i].queue.boxed; n++)
        count += cw_mailboxes_is_reply(bus, i, n);
    return count;
}

bool cw_mailboxes_store(cw_bus *bus, unsigned i, const cw_frame *frame)
{
    cw_buffers *b = &bus->buffers[i];
    const unsigned box = cw_mailbox_for(b, b->reply_boxes, frame);
    if (box == CW_NO_BOX || cw_frame_is_remote(frame) || (bus->detached & cw_node_bit(i)))
        return false;
    b->boxes[box].filled = true;
    cw_frame_copy(&b->boxes[box].frame, frame);
    b->written |= cw_box_bit(box);
    b->newer |= cw_box_bit(box);
    bus->nodes[i].stats.stored++;
    return true;
}

/* ---- Reception ------------------------------------------------------------------------------- */

unsigned cw_mailboxes_for(const cw_buffers *b, const cw_frame *frame, uint64_t full)
{
    return cw_mailbox_for(b, b->receive_boxes & ~full, frame);
}

bool cw_mailbox_takes(const cw_buffers *b, unsigned box, const cw_frame *frame)
{
    return cw_mailbox_for(b, cw_box_bit(box), frame) == box;
}

/* ---- Take over ------------------------------------------------------------------------------- */

static bool same_filter(const cw_filter *a, const cw_filter *b)
{
    return a->value == b->value && a->mask == b->mask && a->inverted == b->inverted;
}

void cw_mailboxes_take_over(cw_bus *bus, unsigned i, const cw_buffers *old)
{
    cw_buffers *b = &bus->buffers[i];
    for (uint64_t rest = b->reply_boxes; rest; rest &= rest - 1) {
        cw_mailbox *box = &b->boxes[cw_lowest_node(rest)];
        for (uint64_t from = old->written; from; from &= from - 1) {
            const cw_mailbox *before = &old->boxes[cw_lowest_node(from)];
            if (!same_filter(&before->filter, &box->filter) ||
                (cw_frame_is_fd(&before->frame) && !bus->fd))
                continue;
            *box = *before;
            b->written |= rest & ~(rest - 1);
            b->newer |= rest & ~(rest - 1);
        }
    }
}

void cw_mailboxes_find_again(cw_bus *bus, unsigned i, bool reply)
{
    const uint64_t boxes = bus->buffers[i].reply_boxes;
    const cw_queue *q = &bus->nodes[i].queue;
    if (!reply || !put_into_one(bus, i, q->newest, boxes & ~cw_mailboxes_full(q)))
        cw_mailboxes_find_one(bus, i);
}
