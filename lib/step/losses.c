/* SPDX-License-Identifier: MIT
 *
 * losses.c - lost arbitration in the frame step: finds the bit of each loss, and counts it.
 *
 * The single losses can mostly not be seen. Then all are counted at SOF: they are hidden.
 * Statistics read before the end of arbitration leave out the losses that lie ahead.
 */
#include "step/frame.h"

#include "format/bits.h"
#include "format/head.h"

/* The frame on the wire, to which the contenders lose. */
typedef struct victor {
    cw_stuffing room;
    const cw_stuffing *stuffing;
    uint32_t key;
} victor;

/* Finds what the losers need to know of the frame on the wire. */
static void find_victor(victor *v, const cw_bus *bus)
{
    v->stuffing = cw_frame_step_stuffing(bus, &v->room);
    v->key = cw_arbitration_key(&bus->frame_step.frame);
}

/* Returns the bit in which a contender loses with the frame that it began with, as the SJA1000
 * counts. */
static unsigned find_lost_bit(const cw_bus *bus, unsigned i, const victor *v)
{
    const cw_bus_node *n = &bus->nodes[i];
    bool pinned = bus->frame_step.pinned >> i & 1u;
    const uint16_t slot = pinned ? n->offered_slot : cw_queue_first(&n->queue);
    const cw_frame *frame = cw_queue_at(&n->queue, slot)->frame;
    return (unsigned)__builtin_clz(cw_arbitration_key(frame) ^ v->key);
}

/* Notes the next loss, if this one comes before it. */
static void note_loss(cw_frame_step *step, unsigned i)
{
    if (step->lost_at[i] < step->next_loss)
        step->next_loss = step->lost_at[i];
}

/* Finds the bit in which a node loses, and keeps its frame first in the queue until then. */
static void find_loss(cw_bus *bus, unsigned i, const victor *v)
{
    cw_frame_step *step = &bus->frame_step;
    step->lost_bit[i] = (uint8_t)find_lost_bit(bus, i, v);
    step->lost_at[i] = (uint8_t)cw_wire_index(v->stuffing, 1u + step->lost_bit[i]);
    if (!(step->pinned >> i & 1u))
        cw_pin_first(&bus->nodes[i]);
    step->pinned |= cw_node_bit(i);
}

/* Counts the attempt, which is a retransmission if the frame has been tried before. */
static void begin_attempt(cw_bus *bus, unsigned i)
{
    cw_bus_node *n = &bus->nodes[i];
    cw_share_lost(bus, i);
    cw_queue_slot *slot = cw_queue_at(&n->queue, n->offered_slot);
    n->stats.retransmissions += slot->tried;
    slot->tried = true;
}

/* Returns the nodes that begin with the winner and lose. */
static uint64_t losers(const cw_frame_step *step)
{
    return step->contenders & ~cw_node_bit(step->node);
}

void cw_losses_begin(cw_bus *bus)
{
    cw_frame_step *step = &bus->frame_step;
    victor v;
    find_victor(&v, bus);
    step->undecided = losers(step);
    step->pinned = 0;
    for (uint64_t rest = step->undecided; rest; rest &= rest - 1) {
        find_loss(bus, cw_lowest_node(rest), &v);
        note_loss(step, cw_lowest_node(rest));
        begin_attempt(bus, cw_lowest_node(rest));
    }
    begin_attempt(bus, step->node);
}

void cw_losses_hide(cw_bus *bus)
{
    cw_frame_step *step = &bus->frame_step;
    cw_bus_node *n = &bus->nodes[step->node];
    cw_set_contenders(bus, step->contenders);
    begin_attempt(bus, step->node);
    bus->shares.lost++;
    n->lost_before = bus->shares.lost;
    bus->stats.arbitration_lost += bus->shares.contender_count - 1;
    step->undecided = 0;
    step->hidden = losers(step);
    step->pinned = 0;
}

void cw_losses_show(cw_bus *bus)
{
    cw_frame_step *step = &bus->frame_step;
    uint64_t shown = step->hidden;
    step->hidden = 0;
    if (shown == 0 || step->at >= cw_frame_step_arbitration_bits(bus))
        return;
    victor v;
    find_victor(&v, bus);
    for (; shown; shown &= shown - 1) {
        unsigned i = cw_lowest_node(shown);
        find_loss(bus, i, &v);
        if (step->lost_at[i] < step->at)
            continue;
        cw_share_lost(bus, i);
        bus->nodes[i].stats.arbitration_lost--;
        bus->stats.arbitration_lost--;
        step->undecided |= cw_node_bit(i);
        note_loss(step, i);
    }
}

uint64_t cw_losses_ahead(const cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    uint64_t ahead = 0;
    if (!step->active || step->at >= cw_frame_step_arbitration_bits(bus))
        return 0;
    victor v;
    find_victor(&v, bus);
    for (uint64_t rest = step->hidden; rest; rest &= rest - 1) {
        unsigned bit = find_lost_bit(bus, cw_lowest_node(rest), &v);
        if (cw_wire_index(v.stuffing, 1u + bit) >= step->at)
            ahead |= rest & (~rest + 1);
    }
    return ahead;
}

void cw_losses_report(cw_bus *bus)
{
    cw_frame_step *step = &bus->frame_step;
    step->next_loss = UINT8_MAX;
    for (uint64_t rest = step->undecided; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        if (step->lost_at[i] + 1u == step->at) {
            step->undecided &= ~cw_node_bit(i);
            cw_report_arbitration_lost(bus, i, step->lost_bit[i]);
        } else {
            note_loss(step, i);
        }
    }
}
