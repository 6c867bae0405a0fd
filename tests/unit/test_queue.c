/* SPDX-License-Identifier: MIT
 *
 * test_queue.c - the transmit queue of a node, against a slow model.
 */
#include "model.h"
#include "rig.h"

#include "state/queue.h"

#define SLOTS 32
#define STEPS 20000

typedef struct bench {
    cw_queue queue;
    uint64_t slots[SLOTS * sizeof(cw_queue_slot)];
    cw_queue_place order[SLOTS];
    cw_lengths lengths;
} bench;

static void open_queue(bench *b, uint16_t capacity, cw_order mode)
{
    cw_lengths_clear(&b->lengths);
    cw_queue_init(&b->queue, b->slots, b->order, capacity, mode, false);
}

static void put(bench *b, uint32_t id, unsigned flags, uint8_t mark)
{
    cw_frame f = {.id = id, .flags = (uint8_t)flags, .dlc = 1, .data = {mark}};
    assert_true(cw_queue_put(&b->queue, &f, mark, &b->lengths));
}

/* Takes the first frame out and returns the mark that it was handed in with. */
static unsigned take(bench *b)
{
    uint16_t slot = cw_queue_first(&b->queue);
    unsigned mark = cw_queue_at(&b->queue, slot)->frame->data[0];
    assert_int_equal(cw_queue_at(&b->queue, slot)->handed_in, mark);
    assert_int_equal(cw_queue_at(&b->queue, slot)->tried, false);
    cw_queue_remove(&b->queue, slot);
    return mark;
}

/* M1, and M3 for frames of one node. */
TEST(priority_is_that_of_arbitration)
{
    bench b;
    open_queue(&b, SLOTS, CW_ORDER_PRIORITY);
    put(&b, 0x7FF, 0, 6);
    put(&b, 0x123 << 18, CW_FRAME_EXTENDED, 3);     /* after the base frame with these top bits */
    put(&b, 0x123, 0, 2);
    put(&b, 0x124, 0, 5);
    put(&b, (0x123 << 18) + 1, CW_FRAME_EXTENDED, 4);
    put(&b, 0, CW_FRAME_EXTENDED, 1);
    for (unsigned mark = 1; mark <= 6; mark++)
        assert_int_equal(take(&b), mark);
    assert_int_equal(b.queue.count, 0);
}

TEST(equal_identifiers_stay_in_order_remote_or_not)
{
    bench b;
    open_queue(&b, SLOTS, CW_ORDER_PRIORITY);
    for (uint8_t mark = 1; mark <= 10; mark++)
        put(&b, 0x123, mark % 2 ? CW_FRAME_REMOTE : 0, mark);
    for (unsigned mark = 1; mark <= 10; mark++)
        assert_int_equal(take(&b), mark);
}

TEST(fifo_is_first_in_first_out)
{
    bench b;
    open_queue(&b, SLOTS, CW_ORDER_FIFO);
    for (uint8_t mark = 0; mark < SLOTS; mark++)
        put(&b, 0x7FFu - mark * 7u, 0, mark);
    for (unsigned mark = 0; mark < SLOTS; mark++)
        assert_int_equal(take(&b), mark);
}

TEST(a_full_queue_takes_nothing)
{
    bench b;
    cw_frame urgent = {.id = 0};
    open_queue(&b, 3, CW_ORDER_PRIORITY);
    for (uint8_t mark = 1; mark <= 3; mark++)
        put(&b, 0x100, 0, mark);
    assert_false(cw_queue_put(&b.queue, &urgent, 9, &b.lengths));
    assert_int_equal(b.queue.count, 3);
    assert_int_equal(take(&b), 1);
    put(&b, 0x100, 0, 4);
    for (unsigned mark = 2; mark <= 4; mark++)
        assert_int_equal(take(&b), mark);
}

/* The model's entry for a frame: arbitration text, number of its put. */
typedef struct entry {
    char text[MODEL_BITS_MAX];
    unsigned number;
    uint16_t slot;
} entry;

typedef struct slow_queue {
    entry entries[SLOTS];
    unsigned count;
} slow_queue;

/* Prints SOF to IDE without the RTR, or to the last identifier bit: the order of frames of one
 * node. */
static void arbitration_text(char *text, const cw_frame *frame)
{
    cw_frame data = *frame;
    data.flags &= (uint8_t)~CW_FRAME_REMOTE;
    model m = model_encode(&data);
    unsigned bits = frame->flags & CW_FRAME_EXTENDED ? 32 : 14;
    memcpy(text, m.plain, bits);
    text[bits] = '\0';
}

static unsigned slow_first(const slow_queue *q)
{
    unsigned best = 0;
    for (unsigned i = 1; i < q->count; i++) {
        int order = strcmp(q->entries[i].text, q->entries[best].text);
        if (order < 0 || (order == 0 && q->entries[i].number < q->entries[best].number))
            best = i;
    }
    return best;
}

/* Returns the slot whose hand-in time is the number of this put. */
static uint16_t find_slot(const bench *b, unsigned number)
{
    for (uint16_t i = 0; i < b->queue.count; i++)
        if (cw_queue_at(&b->queue, b->order[i].slot)->handed_in == number)
            return b->order[i].slot;
    fail_msg("frame %u is lost", number);
    return 0;
}

static void put_both(bench *b, slow_queue *slow, rig_random *random, unsigned number)
{
    cw_frame f = rig_random_frame(random);
    f.id &= f.flags & CW_FRAME_EXTENDED ? 0x180003u : 7u; /* few, so that many are equal */
    bool room = slow->count < SLOTS;
    assert_int_equal(cw_queue_put(&b->queue, &f, number, &b->lengths), room);
    if (!room)
        return;
    entry *e = &slow->entries[slow->count++];
    arbitration_text(e->text, &f);
    e->number = number;
    e->slot = find_slot(b, number);
}

/* Removes the first frame, or any: a frame that is being sent may no longer be the first. */
static void remove_both(bench *b, slow_queue *slow, bool first, rig_random *random)
{
    if (slow->count == 0)
        return;
    unsigned i = first ? slow_first(slow) : rig_below(random, slow->count);
    if (first)
        assert_int_equal(cw_queue_first(&b->queue), slow->entries[i].slot);
    cw_queue_remove(&b->queue, slow->entries[i].slot);
    slow->entries[i] = slow->entries[--slow->count];
}

TEST(random_use_agrees_with_a_slow_model)
{
    rig_random random = {77};
    slow_queue slow = {.count = 0};
    bench b;
    open_queue(&b, SLOTS, CW_ORDER_PRIORITY);
    for (unsigned i = 0; i < STEPS; i++) {
        uint32_t what = rig_below(&random, 5);
        if (what < 3)
            put_both(&b, &slow, &random, i);
        else
            remove_both(&b, &slow, what == 3, &random);
        assert_int_equal(b.queue.count, slow.count);
        if (i % 100 == 99 && i / 100 % 2) /* down to empty now and then */
            while (slow.count)
                remove_both(&b, &slow, true, &random);
    }
}
