/* SPDX-License-Identifier: MIT
 *
 * inbox.c - frames that hosts have handed in, up to their ticks.
 */
#include "state/state.h"

static inbox_entry *inbox_at(const inbox *box, unsigned i)
{
    unsigned place = box->first + i;
    return &box->entries[place < box->capacity ? place : place - box->capacity];
}

static void find_next(inbox *box)
{
    box->next = box->count ? inbox_at(box, 0)->at_tick : CW_NEVER;
}

static bool comes_after(const inbox_entry *a, uint64_t at_tick, unsigned node)
{
    return a->at_tick > at_tick || (a->at_tick == at_tick && a->node > node);
}

/* Returns true when nothing comes before a frame for now: no other frame, and nothing that rules
 * and nodes do at this tick. */
static bool is_next(const cw_bus *bus)
{
    return bus->inbox.count == 0 && bus->rules.next_due > cw_now(bus) &&
           bus->next_restart > cw_now(bus) && !bus->pending && bus->rules.host_rules == 0 &&
           bus->rules.traffic_rules == 0 && bus->rules.held_count == 0;
}

/* Queues a frame for now that needs no place in the inbox. Returns false, with nothing done, when
 * the frame needs one. Returns false also when it would be dropped, since events come only while
 * the bus advances. */
static bool hand_in_now(cw_bus *bus, unsigned i, const cw_frame *frame)
{
    if (!is_next(bus) || !cw_frame_valid(frame) || cw_refusal(bus, i) != CW_DROP_COUNT)
        return false;
    cw_share_lost(bus, i);
    bus->nodes[i].stats.handed_in++;
    cw_enqueue(bus, i, frame, cw_now(bus), 0);
    return true;
}

cw_status cw_node_send(cw_bus *bus, unsigned i, const cw_frame *frame, uint64_t at_tick)
{
    inbox *box = &bus->inbox;
    if (i >= bus->node_count)
        return CW_INVALID;
    if (at_tick < cw_now(bus))
        at_tick = cw_now(bus);
    if (at_tick == cw_now(bus) && hand_in_now(bus, i, frame))
        return CW_OK;
    if (box->count == box->capacity)
        return CW_FULL;
    unsigned place = box->count++;
    for (; place > 0 && comes_after(inbox_at(box, place - 1), at_tick, i); place--)
        *inbox_at(box, place) = *inbox_at(box, place - 1);
    *inbox_at(box, place) = (inbox_entry){.at_tick = at_tick, .node = (uint8_t)i, .frame = *frame};
    find_next(box);
    bus->nodes[i].inbox++;
    return CW_OK;
}

/* Frames for the same tick stay in their order. */
static void sort_inbox(inbox *box)
{
    for (unsigned i = 1; i < box->count; i++) {
        const inbox_entry entry = *inbox_at(box, i);
        unsigned place = i;
        for (; place > 0 && inbox_at(box, place - 1)->at_tick > entry.at_tick; place--)
            *inbox_at(box, place) = *inbox_at(box, place - 1);
        *inbox_at(box, place) = entry;
    }
}

void cw_nodes_bring_forward(cw_bus *bus, uint64_t nodes, uint64_t ticks)
{
    for (unsigned i = 0; i < bus->inbox.count; i++) {
        inbox_entry *e = inbox_at(&bus->inbox, i);
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
    return bus->inbox.capacity - bus->inbox.count;
}

/* Rules on the host side see the frame first, then it is queued. */
static void hand_in(cw_bus *bus, const inbox_entry *entry)
{
    cw_frame frame = entry->frame;
    bus->nodes[entry->node].inbox--;
    bus->nodes[entry->node].stats.handed_in++;
    if (cw_rules_hand_in(&bus->rules, entry->node, &frame, entry->at_tick))
        cw_queue_frame(bus, entry->node, &frame, entry->at_tick, 0);
    cw_rules_passed(&bus->rules, entry->node, CW_SIDE_TX, entry->at_tick);
}

static void take_first(cw_bus *bus)
{
    inbox *box = &bus->inbox;
    const inbox_entry entry = *inbox_at(box, 0);
    box->first = box->first + 1 < box->capacity ? box->first + 1 : 0;
    box->count--;
    find_next(box);
    hand_in(bus, &entry);
}

static void take_nth(cw_bus *bus, unsigned n)
{
    inbox *box = &bus->inbox;
    const inbox_entry entry = *inbox_at(box, n);
    box->count--;
    for (unsigned i = n; i < box->count; i++)
        *inbox_at(box, i) = *inbox_at(box, i + 1);
    find_next(box);
    hand_in(bus, &entry);
}

/* It is never inlined: its copies would take the registers that a clean frame needs. */
__attribute__((noinline)) void cw_take_inbox(cw_bus *bus, uint64_t tick)
{
    while (cw_inbox_first(bus) < tick)
        take_first(bus);
}

void cw_take_inbox_of(cw_bus *bus, unsigned i)
{
    const inbox *box = &bus->inbox;
    while (cw_inbox_first(bus) <= cw_now(bus) && inbox_at(box, 0)->node == i)
        take_first(bus);
}

void cw_take_inbox_of_before(cw_bus *bus, unsigned i, uint64_t tick)
{
    const inbox *box = &bus->inbox;
    for (unsigned n = 0; n < box->count && inbox_at(box, n)->at_tick < tick;)
        if (inbox_at(box, n)->node == i)
            take_nth(bus, n);
        else
            n++;
}

void cw_flush_inbox(cw_bus *bus, unsigned i)
{
    inbox *box = &bus->inbox;
    unsigned kept = 0;
    for (unsigned k = 0; k < box->count; k++) {
        inbox_entry entry = *inbox_at(box, k);
        if (entry.node != i) {
            *inbox_at(box, kept++) = entry;
            continue;
        }
        bus->nodes[i].stats.handed_in++;
        bus->nodes[i].inbox--;
        cw_push_drop(bus, i, CW_SIDE_TX, &entry.frame, CW_DROP_REMOVED, cw_now(bus));
    }
    box->count = kept;
    find_next(box);
}
