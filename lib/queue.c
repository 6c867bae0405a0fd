/* SPDX-License-Identifier: MIT
 *
 * queue.c - the transmit queue of a node: bounded, by priority or first in first out.
 */
#include "queue.h"

#include <string.h>

void cw_queue_init(cw_queue *q, cw_queue_slot *slots, uint16_t *order, uint16_t capacity,
                   cw_order mode)
{
    *q = (cw_queue){.slots = slots, .order = order, .capacity = capacity, .mode = mode};
    for (uint16_t i = 0; i < capacity; i++)
        order[i] = i;
}

/* The identifier as arbitration sees it: base id, then IDE, then the extension. RTR does not count,
 * so that a remote and a data frame of one identifier stay in order. */
static uint32_t priority_key(const cw_frame *frame)
{
    if (!(frame->flags & CW_FRAME_EXTENDED))
        return frame->id << 19;
    return (frame->id >> 18) << 19 | 1u << 18 | (frame->id & 0x3FFFFu);
}

/* Where a new frame goes: behind all that are at least as urgent. */
static unsigned find_place(const cw_queue *q, uint32_t key)
{
    unsigned low = 0;
    unsigned high = q->count;
    if (high == 0 || q->slots[q->order[0]].key <= key)
        return 0;
    while (low < high) {
        unsigned middle = (low + high) / 2;
        if (q->slots[q->order[middle]].key > key)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

bool cw_queue_put(cw_queue *q, const cw_frame *frame, uint64_t handed_in)
{
    if (q->count == q->capacity)
        return false;
    uint32_t key = q->mode == CW_ORDER_PRIORITY ? priority_key(frame) : 0;
    unsigned place = find_place(q, key);
    uint16_t slot = q->order[q->count];
    memmove(&q->order[place + 1], &q->order[place], (q->count - place) * sizeof q->order[0]);
    q->order[place] = slot;
    q->count++;
    q->newest = slot;
    q->slots[slot] = (cw_queue_slot){
        .frame = *frame, .handed_in = handed_in, .number = q->puts++, .key = key};
    return true;
}

static bool goes_after(const cw_queue_slot *a, const cw_queue_slot *b)
{
    return a->key > b->key || (a->key == b->key && a->number > b->number);
}

void cw_queue_set_order(cw_queue *q, cw_order mode)
{
    q->mode = mode;
    for (unsigned i = 0; i < q->count; i++) {
        uint16_t slot = q->order[i];
        q->slots[slot].key = mode == CW_ORDER_PRIORITY ? priority_key(&q->slots[slot].frame) : 0;
        unsigned place = i;
        for (; place > 0 && goes_after(&q->slots[slot], &q->slots[q->order[place - 1]]); place--)
            q->order[place] = q->order[place - 1];
        q->order[place] = slot;
    }
}

void cw_queue_remove(cw_queue *q, uint16_t slot)
{
    assert(q->count > 0);
    unsigned last = --q->count;
    unsigned place = last; /* mostly it is the one that goes first */
    while (q->order[place] != slot) {
        assert(place > 0);
        place--;
    }
    for (; place < last; place++)
        q->order[place] = q->order[place + 1];
    q->order[last] = slot;
}
