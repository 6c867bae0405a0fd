/* SPDX-License-Identifier: MIT
 *
 * inbox.c - frames that hosts have handed in, up to their ticks.
 */
#include "state/state.h"

#include <assert.h>
#include <string.h>

#define WORD sizeof(uint64_t)

/* An entry outside the inbox: whole words, as in it, also where a uint64_t has less alignment. */
typedef union entry_room {
    cw_inbox_entry entry;
    unsigned char bytes[(sizeof(cw_inbox_entry) + sizeof(cw_frame) + WORD - 1) / WORD * WORD];
} entry_room;

/* The bytes that each entry has. */
#define SHORT_ENTRY (offsetof(cw_inbox_entry, frame) + sizeof(cw_short_frame))

/* Copies the short form by itself, with a size that the compiler knows. */
static inline void copy_out(entry_room *room, const cw_inbox *box, const cw_inbox_entry *from)
{
    const unsigned char *entry = (const unsigned char *)from;
    memcpy(room, entry, SHORT_ENTRY);
    if (box->entry_size >= SHORT_ENTRY + CW_CLASSICAL_DATA_MAX)
        memcpy(room->bytes + SHORT_ENTRY, entry + SHORT_ENTRY, box->entry_size - SHORT_ENTRY);
}

/* Returns the entry that comes first, as cw_inbox_at() does. */
static inline cw_inbox_entry *front(const cw_inbox *box)
{
    return (cw_inbox_entry *)(void *)(box->entries + (size_t)box->first * box->entry_size);
}

/* Copies an entry, in the form that the bus keeps it in. */
static void copy(const cw_inbox *box, unsigned to, unsigned from)
{
    memcpy(cw_inbox_at(box, to), cw_inbox_at(box, from), box->entry_size);
}

/* Moves an entry to an earlier place; those between move on by one. */
static void move_forward(const cw_inbox *box, unsigned from, unsigned to)
{
    entry_room moved;
    copy_out(&moved, box, cw_inbox_at(box, from));
    for (unsigned i = from; i > to; i--)
        copy(box, i, i - 1);
    memcpy(cw_inbox_at(box, to), &moved, box->entry_size);
}

/* Finds the tick of the first frame to come. */
static void find_next(cw_inbox *box)
{
    box->next = box->count ? front(box)->at_tick : CW_NEVER;
}

/* Frames go by tick, then by node. */
static bool comes_after(const cw_inbox_entry *a, uint64_t at_tick, unsigned node)
{
    return a->at_tick > at_tick || (a->at_tick == at_tick && a->node > node);
}

/* Returns true when nothing comes before a frame for now: no other frame, and nothing that rules
 * and nodes do at this tick. Mailboxes may take it out of the queue. */
static inline bool is_next(const cw_bus *bus)
{
    return bus->inbox.count == 0 && cw_least(bus->rules.next_due, bus->node_due) > cw_now(bus) &&
           !bus->buffers && !bus->pending &&
           (bus->rules.hand_in_rules | bus->rules.traffic_rules | bus->rules.held_count) == 0;
}

/* Returns true when a node takes a frame that is next. A sender that is plain (cw_outlook) lacks
 * nothing but room. */
static inline bool takes_next(const cw_bus *bus, unsigned i)
{
    const cw_bus_node *n = &bus->nodes[i];
    return bus->outlook.plain >> i & 1u ? n->queue.count < n->queue_limit
                                        : cw_refusal(bus, i) == CW_DROP_COUNT;
}

/* Queues a frame for now that needs no place in the inbox. Returns false, with nothing done, when
 * the frame needs one. Returns false also when it would be dropped, since events come only while
 * the bus advances. All that it calls is inlined: this is the way of nearly all frames. */
__attribute__((flatten)) static bool hand_in_now(cw_bus *bus, unsigned i,
                                                 const cw_frame *frame)
{
    if (!is_next(bus) || !cw_knows_frame(bus, i, frame) || !takes_next(bus, i))
        return false;
    cw_share_lost(bus, i);
    bus->nodes[i].stats.handed_in++;
    cw_enqueue(bus, i, frame, cw_now(bus), 0);
    return true;
}

/* A bus without FD drops an FD frame later. The event then has the start of its data. */
static void inbox_put(const cw_bus *bus, cw_inbox_entry *entry, unsigned node,
                      const cw_frame *frame, uint64_t at_tick, unsigned trigger)
{
    *entry = (cw_inbox_entry){.at_tick = at_tick,
                              .node = (uint8_t)node,
                              .trigger = (uint8_t)trigger,
                              .restarted = at_tick == cw_now(bus) && cw_restart_is_due(bus, node)};
    memcpy(entry->frame, frame, sizeof(cw_short_frame));
    if (!cw_frame_is_fd(frame))
        return;
    if (bus->fd)
        cw_frame_copy(entry->frame, frame);
    else
        cw_frame_cut(entry->frame);
}

/* Adds a frame, for which there must be room. */
static void inbox_add(cw_bus *bus, unsigned i, const cw_frame *frame, uint64_t at_tick,
                      unsigned trigger)
{
    cw_inbox *box = &bus->inbox;
    assert(box->count < box->capacity);
    unsigned place = box->count++;
    for (; place > 0 && comes_after(cw_inbox_at(box, place - 1), at_tick, i); place--)
        copy(box, place, place - 1);
    inbox_put(bus, cw_inbox_at(box, place), i, frame, at_tick, trigger);
    find_next(box);
}

/* Returns the frames of hosts for which there is room. */
static unsigned room(const cw_inbox *box)
{
    const unsigned of_hosts = box->count - (box->triggered ? cw_count_bits(box->triggered) : 0);
    return box->capacity - box->kept_free - of_hosts;
}

cw_status cw_node_send(cw_bus *bus, unsigned i, const cw_frame *frame, uint64_t at_tick)
{
    const cw_inbox *box = &bus->inbox;
    if (i >= bus->node_count)
        return CW_INVALID;
    if (at_tick < cw_now(bus))
        at_tick = cw_now(bus);
    if (at_tick == cw_now(bus) && hand_in_now(bus, i, frame))
        return CW_OK;
    if (room(box) == 0)
        return CW_FULL;
    inbox_add(bus, i, frame, at_tick, 0);
    bus->nodes[i].inbox++;
    return CW_OK;
}

void cw_inbox_put_triggered(cw_bus *bus, unsigned i, const cw_frame *frame, uint64_t tick,
                            unsigned trigger)
{
    bus->inbox.triggered |= cw_node_bit(i);
    inbox_add(bus, i, frame, tick > cw_now(bus) ? tick : cw_now(bus), trigger);
}

/* Frames for the same tick stay in their order. */
static void sort_inbox(cw_inbox *box)
{
    for (unsigned i = 1; i < box->count; i++) {
        const uint64_t tick = cw_inbox_at(box, i)->at_tick;
        unsigned place = i;
        while (place > 0 && cw_inbox_at(box, place - 1)->at_tick > tick)
            place--;
        if (place < i)
            move_forward(box, i, place);
    }
}

void cw_nodes_bring_forward(cw_bus *bus, uint64_t nodes, uint64_t ticks)
{
    for (unsigned i = 0; i < bus->inbox.count; i++) {
        cw_inbox_entry *e = cw_inbox_at(&bus->inbox, i);
        if (!(nodes >> e->node & 1u) || e->at_tick == CW_NEVER || e->at_tick <= cw_now(bus))
            continue;
        e->at_tick = e->at_tick - cw_now(bus) > ticks ? e->at_tick - ticks : cw_now(bus);
    }
    sort_inbox(&bus->inbox);
    find_next(&bus->inbox);
}

void cw_bus_bring_forward(cw_bus *bus, uint64_t ticks)
{
    cw_nodes_bring_forward(bus, bus->all, ticks);
}

uint64_t cw_bus_inbox_first(const cw_bus *bus)
{
    return cw_inbox_first(bus);
}

unsigned cw_bus_inbox_room(const cw_bus *bus)
{
    return room(&bus->inbox);
}

/* Queues a frame of a schedule; trigger: 1 + its number. Its host has nothing to do with it. A
 * frame that a mailbox keeps for its replies misses no slot. */
static void hand_in_triggered(cw_bus *bus, const cw_inbox_entry *entry)
{
    const unsigned i = entry->node;
    cw_bus_node *n = &bus->nodes[i];
    const unsigned before = n->queue.count;
    const uint64_t stored = n->stats.stored;
    bus->inbox.triggered &= ~cw_node_bit(i);
    n->stats.made_by_rules++;
    cw_queue_frame(bus, i, entry->frame, entry->at_tick, 0);
    if (n->queue.count > before)
        cw_queue_at(&n->queue, n->queue.newest)->trigger = entry->trigger;
    else if (n->stats.stored == stored)
        bus->tt[i].stats[entry->trigger - 1].missed++;
}

/* Rules on the host side see the frame before it is queued. */
__attribute__((flatten)) static void hand_in(cw_bus *bus, cw_inbox_entry *entry)
{
    cw_frame *frame = entry->frame; /* with room for what rules make of it */
    if (entry->trigger) {
        hand_in_triggered(bus, entry);
        return;
    }
    bus->nodes[entry->node].inbox--;
    bus->nodes[entry->node].stats.handed_in++;
    if (cw_rules_hand_in(&bus->rules, entry->node, frame, entry->at_tick))
        cw_queue_frame(bus, entry->node, frame, entry->at_tick, 0);
    cw_rules_passed(&bus->rules, entry->node, CW_SIDE_TX, entry->at_tick);
}

/* Takes the first frame out and hands it in. */
static void inbox_take_first(cw_bus *bus)
{
    cw_inbox *box = &bus->inbox;
    entry_room first;
    copy_out(&first, box, front(box));
    box->first = box->first + 1 < box->capacity ? box->first + 1 : 0;
    box->count--;
    find_next(box);
    hand_in(bus, &first.entry);
}

void cw_take_inbox_first(cw_bus *bus)
{
    inbox_take_first(bus);
}

/* Does the same for a frame in the middle. */
static void take_nth(cw_bus *bus, unsigned n)
{
    cw_inbox *box = &bus->inbox;
    entry_room nth;
    copy_out(&nth, box, cw_inbox_at(box, n));
    box->count--;
    for (unsigned i = n; i < box->count; i++)
        copy(box, i, i + 1);
    find_next(box);
    hand_in(bus, &nth.entry);
}

/* It is never inlined: its copies would take the registers that a clean frame needs. All that it
 * calls is inlined, as for hand_in_now(). */
__attribute__((noinline, flatten)) void cw_take_inbox(cw_bus *bus, uint64_t tick)
{
    while (cw_inbox_first(bus) < tick)
        inbox_take_first(bus);
}

void cw_take_inbox_of(cw_bus *bus, unsigned i)
{
    const cw_inbox *box = &bus->inbox;
    const bool restarts = cw_restart_is_due(bus, i);
    while (cw_inbox_first(bus) <= cw_now(bus) && cw_inbox_at(box, 0)->node == i &&
           !(restarts && cw_inbox_at(box, 0)->restarted))
        inbox_take_first(bus);
}

void cw_take_inbox_of_before(cw_bus *bus, unsigned i, uint64_t tick)
{
    const cw_inbox *box = &bus->inbox;
    for (unsigned n = 0; n < box->count && cw_inbox_at(box, n)->at_tick < tick;)
        if (cw_inbox_at(box, n)->node == i)
            take_nth(bus, n);
        else
            n++;
}

void cw_flush_inbox(cw_bus *bus, unsigned i)
{
    cw_inbox *box = &bus->inbox;
    unsigned kept = 0;
    for (unsigned k = 0; k < box->count; k++) {
        const cw_inbox_entry *entry = cw_inbox_at(box, k);
        if (entry->node != i) {
            copy(box, kept++, k);
            continue;
        }
        if (entry->trigger) {
            bus->nodes[i].stats.made_by_rules++;
        } else {
            bus->nodes[i].stats.handed_in++;
            bus->nodes[i].inbox--;
        }
        cw_push_drop(bus, i, CW_SIDE_TX, entry->frame, CW_DROP_REMOVED, cw_now(bus));
    }
    box->triggered &= ~cw_node_bit(i);
    box->count = kept;
    find_next(box);
}
