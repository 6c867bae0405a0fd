/* SPDX-License-Identifier: MIT
 *
 * queue.h - the transmit queue of a node: bounded, by priority or first in first out.
 *
 * Frames of equal identifiers stay in the order in which they came, and none is merged. Memory is
 * the caller's. A slot keeps its number while its frame waits or is being sent.
 */
#ifndef CANWIRE_QUEUE_H
#define CANWIRE_QUEUE_H

#include "format/checked.h"
#include "format/lengths.h"

#include <assert.h>

typedef struct cw_queue_slot {
    uint64_t handed_in; /* tick */
    uint32_t number;    /* number of the put: the order in which frames came */
    uint16_t source;    /* for the owner: 0 after a put */
    uint16_t wire_bits; /* of the frame, SOF to EOF */
    uint8_t bytes;      /* of its data field */
    bool tried;         /* a transmission has begun; false after a put */
    uint8_t behind_brs; /* wire bit after BRS; 0: no FD frame */
    uint8_t trigger;    /* 1 + number of the trigger that it belongs to; 0: none */
    cw_frame frame[];   /* one, in its short form where the bus has no FD */
} cw_queue_slot;

/* A slot in use, or a free one. */
typedef struct cw_queue_place {
    uint32_t key; /* lower goes first */
    uint16_t slot; /* see cw_queue_at() */
    uint8_t box;   /* of a frame in a mailbox: its number */
} cw_queue_place;

typedef struct cw_queue {
    uint64_t *slots; /* capacity of them, see cw_queue_at() */
    cw_queue_place *order; /* the first `count` are slots in use, the next one to go last; the rest
                              are free */
    uint32_t puts;   /* modulo 2^32 */
    uint16_t count;
    uint16_t capacity;
    uint16_t newest; /* slot of the last put */
    uint8_t mode;    /* cw_order */
    uint8_t boxed;   /* frames in mailboxes: those that go first. The others wait for a mailbox, in
                        the order of `mode`. 0 where there are no mailboxes */
} cw_queue;

/* Returns the bytes of a slot, whole words. fd: it has room for FD frames. */
static inline size_t cw_queue_slot_size(bool fd)
{
    return cw_frame_entry_size(offsetof(cw_queue_slot, frame), fd);
}

/* Returns a slot. Its number is that of its first word, so that it is found without a
 * multiplication. */
static inline cw_queue_slot *cw_queue_at(const cw_queue *q, unsigned slot)
{
    return (cw_queue_slot *)(void *)&q->slots[slot];
}

/* Copies a frame as a receiver decodes it: bytes that are not on the wire are 0. */
static inline void cw_queue_copy_received(cw_frame *to, const cw_queue_slot *slot)
{
    cw_frame_copy(to, slot->frame);
    for (unsigned i = slot->bytes; i < CW_CLASSICAL_DATA_MAX; i++)
        to->data[i] = 0;
}

/* slots: of cw_queue_slot_size(fd) bytes each. */
void cw_queue_init(cw_queue *q, void *slots, cw_queue_place *order, uint16_t capacity,
                   cw_order mode, bool fd);

/* Puts a frame, which must be valid, into the queue. Returns false when the queue is full. */
bool cw_queue_put(cw_queue *q, const cw_frame *frame, uint64_t handed_in, cw_lengths *lengths);

/* Sorts the waiting frames anew; equal ones stay in the order in which they came. */
void cw_queue_set_order(cw_queue *q, cw_order mode);

/* Returns the slot that goes n-th, from 0; n < count. */
static inline uint16_t cw_queue_nth(const cw_queue *q, unsigned n)
{
    if (CW_CHECKED)
        assert(n < q->count);
    return q->order[q->count - 1u - n].slot;
}

/* Returns the slot that goes first; the queue must not be empty. */
static inline uint16_t cw_queue_first(const cw_queue *q)
{
    return cw_queue_nth(q, 0);
}

/* Returns the key of a frame where priority decides. */
uint32_t cw_queue_priority(const cw_frame *frame);

/* Moves a frame that waits into a mailbox. Among those in mailboxes it goes behind all keys up to
 * its own. */
void cw_queue_put_into_box(cw_queue *q, uint16_t slot, unsigned box, uint32_t key);

/* Gives a frame that is not on the wire other content. */
void cw_queue_change(cw_queue *q, uint16_t slot, const cw_frame *frame, cw_lengths *lengths);

/* Does the same as cw_queue_remove() for the slot that goes first, where no frame is in a
 * mailbox. */
static inline void cw_queue_remove_first(cw_queue *q)
{
    assert(q->count > 0 && !q->boxed);
    q->count--;
}

/* Takes a slot in use out of the queue; its contents stay readable until the next put. */
void cw_queue_remove(cw_queue *q, uint16_t slot);

#endif
