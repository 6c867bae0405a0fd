/* SPDX-License-Identifier: MIT
 *
 * queue.c - the transmit queue of a node: bounded, by priority or first in first out.
 */
#include "state/queue.h"

#include "format/bits.h"
#include "format/head.h"

#include <string.h>

#define STEPS 4u /* places that are looked at one by one */

void cw_queue_init(cw_queue *q, void *slots, cw_queue_place *order, uint16_t capacity,
                   cw_order mode, bool fd)
{
    *q = (cw_queue){.slots = slots, .order = order, .capacity = capacity,
                    .mode = (uint8_t)mode};
    const size_t words = cw_queue_slot_size(fd) / sizeof q->slots[0];
    assert(words * capacity <= UINT16_MAX);
    for (unsigned i = 0; i < capacity; i++)
        order[i].slot = (uint16_t)(i * words);
}

/* Returns the identifier as arbitration sees it: base id, then IDE, then the extension. RTR does
 * not count, so that a remote and a data frame of one identifier stay in order. */
uint32_t cw_queue_priority(const cw_frame *frame)
{
    return cw_key_with_rtr(frame, CW_DOMINANT);
}

/* Returns the key of a frame's place. Lower ones go first; with equal keys the order of arrival
 * counts. */
static uint32_t place_key(const cw_queue *q, const cw_frame *frame)
{
    return q->mode == CW_ORDER_PRIORITY ? cw_queue_priority(frame) : 0;
}

/* Finds the place of a new frame among so many that wait: after all that are at least as urgent. In
 * this binary search only the number of frames decides on branches, since the processor cannot
 * foresee keys. */
static unsigned search_place(const cw_queue *q, uint32_t key, unsigned rest)
{
    unsigned place = 0;
    if (rest == 0 || q->order[0].key <= key)
        return 0;
    while (rest > 1) {
        unsigned half = rest / 2;
        place += q->order[place + half].key > key ? half : 0;
        rest -= half;
    }
    return place + 1;
}

/* Makes room for a new frame at its place, which it returns. A full queue keeps frames that are not
 * urgent, and others are short. So the place is mostly near those that go first. */
static inline cw_queue_place *open_place(cw_queue *q, uint32_t key)
{
    cw_queue_place *place = q->order + q->count;
    if (!q->boxed) {
        const cw_queue_place *near = q->count > STEPS ? place - STEPS : q->order;
        for (; place > near && place[-1].key <= key; place--)
            *place = place[-1];
        if (place > near || near == q->order)
            return place;
    }
    const unsigned rest = (unsigned)(place - q->order) - q->boxed;
    cw_queue_place *found = q->order + search_place(q, key, rest);
    memmove(found + 1, found, (size_t)(place - found) * sizeof *found);
    return found;
}

__attribute__((noinline)) static void put_fd(cw_queue_slot *slot, const cw_frame *frame,
                                              uint64_t handed_in, uint32_t number)
{
    const cw_fd_length length = cw_bits_measure_fd(frame);
    *slot = (cw_queue_slot){.handed_in = handed_in, .number = number,
                            .wire_bits = length.bits, .behind_brs = length.behind_brs,
                            .bytes = (uint8_t)cw_frame_length(frame)};
    cw_frame_copy(slot->frame, frame);
}

/* Writes a classical frame into a slot, with all that is needed to send it. */
static inline void put_classical(cw_queue_slot *slot, const cw_frame *frame, uint64_t handed_in,
                                 uint32_t number, cw_lengths *lengths)
{
    const unsigned bytes = cw_dlc_length(frame->dlc, cw_frame_is_remote(frame));
    *slot = (cw_queue_slot){.handed_in = handed_in, .number = number,
                            .wire_bits = (uint16_t)cw_lengths_of(lengths, frame),
                            .bytes = (uint8_t)bytes};
    memcpy(slot->frame, frame, sizeof(cw_short_frame));
}

/* Finds the length here, where nothing waits for it, and not at the frame's turn. */
bool cw_queue_put(cw_queue *q, const cw_frame *frame, uint64_t handed_in, cw_lengths *lengths)
{
    if (q->count == q->capacity)
        return false;
    uint32_t key = place_key(q, frame);
    uint16_t slot = q->order[q->count].slot;
    *open_place(q, key) = (cw_queue_place){.key = key, .slot = slot};
    q->count++;
    q->newest = slot;
    cw_queue_slot *put = cw_queue_at(q, slot);
    if (cw_frame_is_fd(frame))
        put_fd(put, frame, handed_in, q->puts++);
    else
        put_classical(put, frame, handed_in, q->puts++, lengths);
    return true;
}

/* The comparison holds since far fewer frames wait than there are numbers. */
static bool came_after(const cw_queue *q, const cw_queue_place *a, const cw_queue_place *b)
{
    return (int32_t)(cw_queue_at(q, a->slot)->number - cw_queue_at(q, b->slot)->number) > 0;
}

/* Compares two places by key, then by arrival. */
static bool goes_after(const cw_queue *q, const cw_queue_place *a, const cw_queue_place *b)
{
    return a->key > b->key || (a->key == b->key && came_after(q, a, b));
}

void cw_queue_set_order(cw_queue *q, cw_order mode)
{
    q->mode = (uint8_t)mode;
    const unsigned waiting = q->count - (unsigned)q->boxed;
    for (unsigned i = 0; i < waiting; i++) {
        cw_queue_place moved = q->order[i];
        moved.key = place_key(q, cw_queue_at(q, moved.slot)->frame);
        unsigned place = i;
        for (; place > 0 && goes_after(q, &moved, &q->order[place - 1]); place--)
            q->order[place] = q->order[place - 1];
        q->order[place] = moved;
    }
}

void cw_queue_put_into_box(cw_queue *q, uint16_t slot, unsigned box, uint32_t key)
{
    const unsigned waiting = q->count - q->boxed;
    unsigned place = waiting - 1;
    while (q->order[place].slot != slot) {
        assert(place > 0);
        place--;
    }
    for (; place + 1 < q->count && (place + 1 < waiting || q->order[place + 1].key > key); place++)
        q->order[place] = q->order[place + 1];
    q->order[place] = (cw_queue_place){.key = key, .slot = slot, .box = (uint8_t)box};
    q->boxed++;
}

void cw_queue_change(cw_queue *q, uint16_t slot, const cw_frame *frame, cw_lengths *lengths)
{
    cw_queue_slot *s = cw_queue_at(q, slot);
    const cw_queue_slot before = *s;
    if (cw_frame_is_fd(frame))
        put_fd(s, frame, before.handed_in, before.number);
    else
        put_classical(s, frame, before.handed_in, before.number, lengths);
    s->source = before.source;
    s->tried = before.tried;
}

void cw_queue_remove(cw_queue *q, uint16_t slot)
{
    assert(q->count > 0);
    unsigned last = --q->count;
    unsigned place = last; /* usually the frame that goes first is removed */
    while (q->order[place].slot != slot) {
        assert(place > 0);
        place--;
    }
    if (q->boxed && place + q->boxed > last)
        q->boxed--;
    for (; place < last; place++)
        q->order[place] = q->order[place + 1];
    q->order[last].slot = slot;
}
