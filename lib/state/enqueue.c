/* SPDX-License-Identifier: MIT
 *
 * enqueue.c - puts frames into the queues of their nodes, and takes them out.
 */
#include "state/state.h"

#include "format/bits.h"

#include <assert.h>

void cw_queue_changed(cw_bus *bus, unsigned i)
{
    if (bus->nodes[i].queue.count > 0 && !(bus->asleep >> i & 1u))
        bus->waiting |= cw_node_bit(i);
    else
        bus->waiting &= ~cw_node_bit(i);
    cw_rules_forget_frame(&bus->rules, i);
    bus->arbiter.stale |= cw_node_bit(i);
}

cw_drop cw_refusal(const cw_bus *bus, unsigned i)
{
    const cw_bus_node *n = &bus->nodes[i];
    if (bus->detached & cw_node_bit(i))
        return bus->removed & cw_node_bit(i) ? CW_DROP_REMOVED : CW_DROP_LINK_DOWN;
    if (cw_modes_of(bus, i) & (CW_MODE_LISTEN_ONLY | CW_MODE_RESTRICTED))
        return CW_DROP_LISTEN_ONLY;
    if (n->mac.phase == CW_MAC_BUS_OFF) /* R12: from the request on, frames wait */
        return CW_DROP_BUS_OFF;
    if (n->queue.count < n->queue_limit || n->queue.count - cw_mailbox_replies(bus, i) <
                                               n->queue_limit)
        return CW_DROP_COUNT;
    return CW_DROP_QUEUE_FULL;
}

void cw_pin_first(cw_bus_node *n)
{
    uint16_t slot = cw_queue_first(&n->queue);
    if (n->offered_slot != slot || n->deviates)
        n->mac.offered = false; /* not encoded */
    n->offered_slot = slot;
}

/* Keeps the frame with which a node has begun the arbitration under way, before another one comes
 * first. */
static void pin_frame(cw_bus *bus, unsigned i)
{
    cw_frame_step *step = &bus->frame_step;
    if (!step->active || !(step->hidden & ~step->pinned & cw_node_bit(i)))
        return;
    step->pinned |= cw_node_bit(i);
    cw_pin_first(&bus->nodes[i]);
}

/* Not inlined, so that classical frames need no room for it. */
__attribute__((noinline)) void cw_complete_fd(const cw_bus_node *n)
{
    cw_queue_slot *slot = cw_queue_at(&n->queue, n->queue.newest);
    const unsigned flags = cw_mac_fd_flags(&n->mac, slot->frame->flags);
    if (slot->frame->flags == flags)
        return;
    slot->frame->flags = (uint8_t)flags;
    slot->wire_bits = cw_bits_measure_fd(slot->frame).bits;
}

/* Puts a frame into its place in the queue, which must have room. */
static void enqueue_put(cw_bus *bus, unsigned i, const cw_frame *frame, uint64_t tick)
{
    cw_bus_node *n = &bus->nodes[i];
    pin_frame(bus, i);
    bool put = cw_queue_put(&n->queue, frame, tick, bus->lengths);
    assert(put);
    (void)put;
    if (cw_frame_is_fd(frame))
        cw_complete_fd(n);
    bus->queued++;
}

void cw_enqueue_reply(cw_bus *bus, unsigned i, const cw_frame *frame, unsigned box)
{
    cw_bus_node *n = &bus->nodes[i];
    cw_share_lost(bus, i);
    enqueue_put(bus, i, frame, cw_now(bus));
    cw_mailboxes_put_into(bus, i, n->queue.newest, box);
    cw_queue_changed(bus, i);
    n->stats.made_by_rules++;
    if (n->queue.count > n->stats.queue_peak)
        n->stats.queue_peak = n->queue.count;
}

void cw_enqueue(cw_bus *bus, unsigned i, const cw_frame *frame, uint64_t tick, unsigned source)
{
    cw_bus_node *n = &bus->nodes[i];
    enqueue_put(bus, i, frame, tick);
    if (bus->buffers)
        cw_mailboxes_find_one(bus, i);
    if (cw_queue_first(&n->queue) == n->queue.newest)
        cw_queue_changed(bus, i);
    if (source)
        cw_queue_at(&n->queue, n->queue.newest)->source = (uint16_t)source;
    if (n->queue.count > n->stats.queue_peak)
        n->stats.queue_peak = n->queue.count;
}

/* A babbling idiot needs no mailboxes. */
void cw_queue_frame(cw_bus *bus, unsigned i, const cw_frame *frame, uint64_t tick, unsigned source)
{
    cw_share_lost(bus, i);
    cw_drop why = cw_knows_frame(bus, i, frame) ? cw_refusal(bus, i) : CW_DROP_BAD_FRAME;
    if (bus->buffers && why != CW_DROP_BAD_FRAME && !cw_rules_is_steady(&bus->rules, source)) {
        if (cw_mailboxes_store(bus, i, frame))
            return;
        if (!cw_mailboxes_take(bus, i, frame))
            why = CW_DROP_BAD_FRAME;
    }
    if (why != CW_DROP_COUNT) {
        cw_push_drop(bus, i, CW_SIDE_TX, frame, why, tick);
        return;
    }
    cw_enqueue(bus, i, frame, tick, source);
    cw_rules_count_queued(&bus->rules, source);
}

void cw_remove_slot(cw_bus *bus, unsigned i, uint16_t slot)
{
    cw_bus_node *n = &bus->nodes[i];
    cw_share_lost(bus, i);
    cw_rules_count_gone(&bus->rules, cw_queue_at(&n->queue, slot)->source);
    if (bus->buffers)
        cw_mailboxes_remove(bus, i, slot);
    else
        cw_queue_remove(&n->queue, slot);
    bus->queued--;
    cw_queue_changed(bus, i);
}

void cw_flush_queue(cw_bus *bus, unsigned i, cw_drop why)
{
    cw_bus_node *n = &bus->nodes[i];
    while (n->queue.count > 0) {
        uint16_t slot = cw_queue_first(&n->queue);
        const cw_frame *frame = cw_queue_at(&n->queue, slot)->frame;
        cw_push_drop(bus, i, CW_SIDE_TX, frame, why, cw_now(bus));
        cw_remove_slot(bus, i, slot);
    }
}
