/* SPDX-License-Identifier: MIT
 *
 * replies.c - the replies of mailboxes to remote frames.
 *
 * A mailbox with a reply keeps what its host writes. A remote frame makes it send a copy, and it
 * puts the data last written into the copy whenever a transmission begins.
 */
#include "state/state.h"

/* A reply that still waits answers a further remote frame, too. */
bool cw_mailboxes_answer(cw_bus *bus, unsigned i, const cw_frame *frame)
{
    cw_buffers *b = &bus->buffers[i];
    const cw_drop why = cw_refusal(bus, i);
    const unsigned box = cw_frame_is_remote(frame) ? cw_mailbox_for(b, b->reply_boxes, frame)
                                                   : CW_NO_BOX;
    if (box == CW_NO_BOX || !b->boxes[box].filled ||
        !cw_knows_frame(bus, i, &b->boxes[box].frame) ||
        (why != CW_DROP_COUNT && why != CW_DROP_QUEUE_FULL))
        return false;
    b->stats.replies++;
    if (cw_mailboxes_full(&bus->nodes[i].queue) & cw_box_bit(box))
        return true;
    b->newer &= ~cw_box_bit(box);
    cw_enqueue_reply(bus, i, &b->boxes[box].frame, box);
    return true;
}

void cw_mailboxes_load_now(cw_bus *bus, unsigned i)
{
    cw_buffers *b = &bus->buffers[i];
    cw_bus_node *n = &bus->nodes[i];
    for (unsigned k = 0; b->newer && k < n->queue.boxed; k++) {
        const unsigned box = n->queue.order[n->queue.count - 1u - k].box;
        const uint16_t slot = cw_queue_nth(&n->queue, k);
        if (!(b->newer & b->reply_boxes & cw_box_bit(box)))
            continue;
        cw_queue_change(&n->queue, slot, &b->boxes[box].frame, bus->lengths);
        if (n->offered_slot == slot)
            n->mac.offered = false; /* not encoded */
        cw_queue_changed(bus, i);
    }
    b->newer = 0;
}
