/* SPDX-License-Identifier: MIT
 *
 * mailboxes.c - the mailboxes of controllers that have one for each message (FullCAN).
 *
 * A transmit mailbox has one frame. Frames that find no free one wait in the queue. So the frames
 * of a queue are of two kinds: those in mailboxes go first, and the others wait behind them.
 * A mailbox with a reply keeps what its host writes. A remote frame makes it send a copy, and it
 * puts the data last written into the copy whenever a transmission begins.
 */
#include "state/state.h"

/* ---- Sets of mailboxes ----------------------------------------------------------------------- */

static uint64_t box_bit(unsigned box)
{
    return box < CW_MAILBOXES_MAX ? UINT64_C(1) << box : 0;
}

/* Returns the first of some mailboxes that takes a frame, or CW_NO_BOX. */
static unsigned first_for(const cw_buffers *b, uint64_t boxes, const cw_frame *frame)
{
    for (; boxes; boxes &= boxes - 1) {
        const unsigned box = cw_lowest_node(boxes);
        if (cw_frame_matches(frame, &b->boxes[box].filter, 1))
            return box;
    }
    return CW_NO_BOX;
}

/* Returns the mailboxes with frames of the queue. */
static uint64_t full_boxes(const cw_queue *q)
{
    uint64_t full = 0;
    for (unsigned n = 0; n < q->boxed; n++)
        full |= box_bit(q->order[q->count - 1u - n].box);
    return full;
}

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
    return !b->boxes || first_for(b, b->transmit_boxes, frame) != CW_NO_BOX;
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
    if (b->reply_boxes & box_bit(box))
        bus->replying |= cw_node_bit(i);
}

/* Moves a frame that waits into one of these mailboxes, if one takes it. */
static bool put_into_one(cw_bus *bus, unsigned i, uint16_t slot, uint64_t boxes)
{
    const cw_queue *q = &bus->nodes[i].queue;
    const unsigned box = first_for(&bus->buffers[i], boxes, cw_queue_at(q, slot)->frame);
    if (box == CW_NO_BOX)
        return false;
    cw_mailboxes_put_into(bus, i, slot, box);
    return true;
}

void cw_mailboxes_find_one(cw_bus *bus, unsigned i)
{
    const cw_buffers *b = &bus->buffers[i];
    const cw_queue *q = &bus->nodes[i].queue;
    if (b->boxes)
        (void)put_into_one(bus, i, q->newest, b->transmit_boxes & ~full_boxes(q));
}

/* Only the mailbox that is free now can be one for frames that have waited. */
void cw_mailboxes_remove(cw_bus *bus, unsigned i, uint16_t slot)
{
    cw_queue *q = &bus->nodes[i].queue;
    const cw_buffers *b = &bus->buffers[i];
    const uint64_t box = box_bit(box_of(q, slot));
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
           (bus->buffers[i].reply_boxes & box_bit(q->order[q->count - 1u - n].box));
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
    const bool off = bus->detached & cw_node_bit(i);
    const unsigned box = cw_frame_is_remote(frame) || off ? CW_NO_BOX
                                                          : first_for(b, b->reply_boxes, frame);
    if (box == CW_NO_BOX)
        return false;
    b->boxes[box].filled = true;
    cw_frame_copy(&b->boxes[box].frame, frame);
    b->written |= box_bit(box);
    b->newer |= box_bit(box);
    bus->nodes[i].stats.stored++;
    return true;
}

/* A reply that still waits answers a further remote frame, too. */
bool cw_mailboxes_answer(cw_bus *bus, unsigned i, const cw_frame *frame)
{
    cw_buffers *b = &bus->buffers[i];
    const cw_drop why = cw_refusal(bus, i);
    const unsigned box = cw_frame_is_remote(frame) ? first_for(b, b->reply_boxes, frame)
                                                   : CW_NO_BOX;
    if (box == CW_NO_BOX || !b->boxes[box].filled ||
        !cw_knows_frame(bus, i, &b->boxes[box].frame) ||
        (why != CW_DROP_COUNT && why != CW_DROP_QUEUE_FULL))
        return false;
    b->stats.replies++;
    if (full_boxes(&bus->nodes[i].queue) & box_bit(box))
        return true;
    b->newer &= ~box_bit(box);
    cw_enqueue_reply(bus, i, &b->boxes[box].frame, box);
    return true;
}

void cw_mailboxes_load_now(cw_bus *bus, unsigned i)
{
    cw_buffers *b = &bus->buffers[i];
    bus_node *n = &bus->nodes[i];
    for (unsigned k = 0; b->newer && k < n->queue.boxed; k++) {
        const unsigned box = n->queue.order[n->queue.count - 1u - k].box;
        const uint16_t slot = cw_queue_nth(&n->queue, k);
        if (!(b->newer & b->reply_boxes & box_bit(box)))
            continue;
        cw_queue_change(&n->queue, slot, &b->boxes[box].frame);
        if (n->offered_slot == slot)
            n->mac.offered = false; /* not encoded */
        cw_queue_changed(bus, i);
    }
    b->newer = 0;
}

/* ---- Reception ------------------------------------------------------------------------------- */

unsigned cw_mailboxes_for(const cw_buffers *b, const cw_frame *frame, uint64_t full, bool *taken)
{
    const unsigned empty = first_for(b, b->receive_boxes & ~full, frame);
    unsigned last = CW_NO_BOX;
    *taken = empty == CW_NO_BOX;
    for (uint64_t rest = *taken ? b->receive_boxes : 0; rest; rest &= rest - 1)
        if (cw_frame_matches(frame, &b->boxes[cw_lowest_node(rest)].filter, 1))
            last = cw_lowest_node(rest);
    return *taken ? last : empty;
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
    const cw_buffers *b = &bus->buffers[i];
    const cw_queue *q = &bus->nodes[i].queue;
    const uint16_t slot = q->newest;
    if (!b->boxes)
        return;
    if (reply && put_into_one(bus, i, slot, b->reply_boxes & ~full_boxes(q)))
        return;
    if (!put_into_one(bus, i, slot, b->transmit_boxes & ~full_boxes(q)) &&
        !cw_mailboxes_take(bus, i, cw_queue_at(q, slot)->frame))
        cw_mailboxes_put_into(bus, i, slot, CW_NO_BOX);
}
