/* SPDX-License-Identifier: MIT
 *
 * ring.c - the ring of events: bounded, nothing lost, in the order of time, then faults before
 * nodes, nodes in their order, and kinds (see cw_event_kind).
 *
 * Before each bit the bus asks for room for the worst case of that bit.
 */
#include "state/state.h"

#include <assert.h>
#include <string.h>

/* Returns the most events of a bit, with that many frames in queues, in the inbox and held by
 * rules. */
static uint64_t worst_bit(const cw_bus *bus, uint64_t queued, uint64_t handed_in, uint64_t held)
{
    const cw_rule_set *set = &bus->rules;
    const uint64_t of_nodes = (uint64_t)bus->node_count * CW_EVENTS_PER_NODE;
    const uint64_t of_rules = (bus->timed.bits_of_bit_time + 1u) * (uint64_t)set->count;
    return bus->timed.bits_of_bit_time * of_nodes + of_rules + queued + bus->triggers +
           (handed_in + held + bus->node_count) * (1 + set->host_rules + set->copies);
}

void cw_ring_find_enough(cw_bus *bus)
{
    uint64_t queues = 0;
    for (unsigned i = 0; i < bus->node_count; i++)
        queues += bus->nodes[i].queue.capacity;
    bus->ring.enough = worst_bit(bus, queues, bus->inbox.capacity,
                                 CW_HELD_FRAMES + bus->stored_most);
}

bool cw_ring_has_room_now(const cw_bus *bus)
{
    uint64_t worst = worst_bit(bus, bus->queued, bus->inbox.count,
                               bus->rules.held_count + bus->stored);
    uint64_t room = bus->ring.capacity - bus->ring.count;
    /* rules on the host side may need more room than the ring has. Then the ring is emptied first,
     * and events that still do not fit are counted as lost */
    return room >= worst || bus->ring.count == 0;
}

/* Returns the i-th event, the oldest first. */
static cw_event *event_at(const cw_event_ring *ring, unsigned i)
{
    unsigned place = ring->first + i;
    return cw_ring_at(ring, place < ring->capacity ? place : place - ring->capacity);
}

/* Copies an event, in the form that the bus keeps it in. On 32 bits an entry may end behind an
 * event, since it is aligned for 64. */
static void copy(const cw_event_ring *ring, cw_event *to, const cw_event *from)
{
    memcpy(to, from, (size_t)cw_least(ring->event_size, sizeof *to));
}

static cw_event *newest_event(cw_event_ring *ring)
{
    return event_at(ring, ring->count - 1);
}

/* Returns the first node of a set, as a set. */
static uint64_t lowest(uint64_t nodes)
{
    return nodes & (~nodes + 1);
}

/* Returns those nodes of an event that come after an event of the given kind and nodes at the same
 * tick. Nodes come in their order, then kinds. */
static uint64_t nodes_behind(const cw_event *e, cw_event_kind kind, uint64_t nodes)
{
    uint64_t self = lowest(nodes);
    uint64_t higher = ~(self | (self - 1));
    return e->nodes & (e->kind > kind ? higher | self : higher);
}

/* Faults come first, in the order of the rules. A bit may end before the hit of a rule that has
 * been reported already, if nodes have clocks of their own. */
uint64_t cw_event_part_behind(const cw_event *e, const cw_event *added)
{
    if (e->tick != added->tick)
        return e->tick > added->tick ? UINT64_MAX : 0;
    if (added->kind == CW_EVENT_FAULT)
        return e->kind != CW_EVENT_FAULT || e->rule > added->rule ? UINT64_MAX : 0;
    return e->kind == CW_EVENT_FAULT ? 0 : nodes_behind(e, added->kind, added->nodes);
}

/* Makes room for one more event at a place. */
static void open_gap(cw_event_ring *ring, unsigned place)
{
    for (unsigned i = ring->count++; i > place; i--)
        copy(ring, event_at(ring, i), event_at(ring, i - 1));
}

/* Finds the place of a new event. Splits an event for several nodes in two when the new one comes
 * in between. */
static unsigned ring_find_place(cw_event_ring *ring, const cw_event *added)
{
    unsigned place = ring->count;
    uint64_t behind = 0;
    while (place > 0 && (behind = cw_event_part_behind(event_at(ring, place - 1), added)) != 0) {
        cw_event *before = event_at(ring, place - 1);
        bool all = behind == UINT64_MAX || behind == before->nodes;
        if (!all && ring->count + 1 < ring->capacity) {
            open_gap(ring, place);
            copy(ring, event_at(ring, place), before);
            event_at(ring, place)->nodes = behind;
            before->nodes &= ~behind;
            break;
        }
        place--;
    }
    return place;
}

/* Puts an event in its place in the order of time. One that nobody wants, or that has no room, goes
 * to a place of its own, where it can be completed all the same. */
static cw_event *ring_insert(cw_bus *bus, const cw_event *added)
{
    cw_event_ring *ring = &bus->ring;
    if (!cw_wants_event(bus, added->kind)) {
        bus->unwanted_event = *added;
        return &bus->unwanted_event;
    }
    if (ring->count == ring->capacity) {
        bus->stats.events_lost++;
        bus->lost_event = *added;
        return &bus->lost_event;
    }
    unsigned place = ring_find_place(ring, added);
    bus->work += ring->count - place;
    open_gap(ring, place);
    copy(ring, event_at(ring, place), added);
    ring->newest_tick = newest_event(ring)->tick;
    return event_at(ring, place);
}

/* Begins a new event. Clears it, but for most data of its frame. In two halves: compilers clear
 * that much with a few wide stores, and more in a slow way. */
static inline void begin_event(cw_event *event, cw_event_kind kind, uint64_t tick, uint64_t nodes)
{
    const size_t size = offsetof(cw_event, frame) + sizeof(cw_short_frame), half = size / 2;
    memset(event, 0, half);
    memset((unsigned char *)event + half, 0, size - half);
    event->tick = tick;
    event->kind = kind;
    event->nodes = nodes;
}

/* Returns true when the newest event comes after a new one that is not a fault. */
static bool newest_comes_behind(cw_event_ring *ring, cw_event_kind kind, uint64_t tick,
                                uint64_t nodes)
{
    return ring->count > 0 && (ring->newest_tick > tick ||
           (ring->newest_tick == tick && nodes_behind(newest_event(ring), kind, nodes)));
}

/* Adds a wanted event after all others, which is the usual case. Returns NULL when it does not
 * belong there. */
static cw_event *append(cw_bus *bus, cw_event_kind kind, uint64_t tick, uint64_t nodes)
{
    cw_event_ring *ring = &bus->ring;
    if (newest_comes_behind(ring, kind, tick, nodes) || ring->count == ring->capacity)
        return NULL;
    cw_event *added = event_at(ring, ring->count++);
    ring->newest_tick = tick;
    begin_event(added, kind, tick, nodes);
    return added;
}

/* Adds an event in the rare case. It is a function of its own, so that the usual case needs no room
 * for an event. */
static __attribute__((noinline)) cw_event *insert_new(cw_bus *bus, cw_event_kind kind,
                                                      uint64_t tick, uint64_t nodes)
{
    const cw_event event = {.kind = kind, .tick = tick, .nodes = nodes};
    return ring_insert(bus, &event);
}

cw_event *cw_push_event(cw_bus *bus, cw_event_kind kind, uint64_t tick, uint64_t nodes)
{
    if (!cw_wants_event(bus, kind)) {
        begin_event(&bus->unwanted_event, kind, tick, nodes);
        return &bus->unwanted_event;
    }
    cw_event *added = append(bus, kind, tick, nodes);
    return added ? added : insert_new(bus, kind, tick, nodes);
}

/* Gives the event of a node its counters. */
static inline void count_errors(cw_event *e, const cw_bus *bus, unsigned i)
{
    e->tec = bus->nodes[i].mac.confinement.tec;
    e->rec = bus->nodes[i].mac.confinement.rec;
}

bool cw_push_rx_tx(cw_bus *bus, cw_rx_tx *pair)
{
    const uint32_t both = 1u << CW_EVENT_RX | 1u << CW_EVENT_TX;
    cw_event_ring *ring = &bus->ring;
    const unsigned place = ring->first + ring->count;
    if ((bus->wanted & both) == 0) {
        pair->rx = pair->tx = &bus->unwanted_event;
        return true;
    }
    if ((bus->wanted & both) != both || place + 2 > ring->capacity ||
        (ring->count > 0 && ring->newest_tick >= pair->accepted))
        return false;
    pair->rx = cw_ring_at(ring, place);
    pair->tx = (cw_event *)(void *)((unsigned char *)pair->rx + ring->event_size);
    begin_event(pair->rx, CW_EVENT_RX, pair->accepted, pair->receivers);
    begin_event(pair->tx, CW_EVENT_TX, pair->ended, cw_node_bit(pair->sender));
    count_errors(pair->rx, bus, cw_lowest_node(pair->receivers));
    count_errors(pair->tx, bus, pair->sender);
    ring->count += 2;
    ring->newest_tick = pair->ended;
    return true;
}

cw_event *cw_push_node_event(cw_bus *bus, cw_event_kind kind, unsigned i)
{
    cw_event *e = cw_push_event(bus, kind, cw_now(bus), cw_node_bit(i));
    count_errors(e, bus, i);
    return e;
}

/* Does so for the hit of a rule. */
static __attribute__((noinline)) void insert_fault(cw_bus *bus, unsigned rule, uint32_t hit,
                                                   uint64_t tick)
{
    const cw_event event = {.kind = CW_EVENT_FAULT, .tick = tick, .rule = (uint16_t)rule,
                            .hit = hit};
    (void)ring_insert(bus, &event);
}

void cw_push_fault(cw_bus *bus, unsigned rule, uint64_t tick)
{
    const uint32_t hit = (uint32_t)bus->rules.rules[rule].hits;
    const bool last = bus->ring.count == 0 || bus->ring.newest_tick < tick;
    cw_event *added = last && cw_wants_event(bus, CW_EVENT_FAULT)
                          ? append(bus, CW_EVENT_FAULT, tick, 0) : NULL;
    if (added) {
        added->rule = (uint16_t)rule;
        added->hit = hit;
    } else {
        insert_fault(bus, rule, hit, tick);
    }
    bus->stats.faults++;
}

cw_event *cw_push_drop(cw_bus *bus, unsigned i, cw_side side, const cw_frame *frame, cw_drop why,
                       uint64_t tick)
{
    cw_event *e = cw_push_event(bus, CW_EVENT_DROP, tick, cw_node_bit(i));
    e->why = (uint8_t)why;
    cw_frame_copy(&e->frame, frame);
    if (side == CW_SIDE_TX)
        e->frame.flags &= (uint8_t)~CW_FRAME_ESI; /* it has not been sent */
    cw_node_stats *stats = &bus->nodes[i].stats;
    if (side == CW_SIDE_TX)
        stats->dropped[why]++;
    else
        stats->rx_dropped[why]++;
    return e;
}

void cw_push_rx(cw_bus *bus, unsigned i, const cw_frame *frame, const cw_frame_origin *origin)
{
    cw_node_stats *stats = &bus->nodes[i].stats;
    cw_event *e = bus->ring.count ? newest_event(&bus->ring) : NULL;
    bool joins = e && e->kind == CW_EVENT_RX && e->tick == cw_now(bus) && e->from == origin->from &&
                 e->nodes < cw_node_bit(i) && cw_frame_equal(&e->frame, frame);
    if (joins)
        e->nodes |= cw_node_bit(i);
    else
        e = cw_push_node_event(bus, CW_EVENT_RX, i);
    if (e == &bus->lost_event) {
        stats->rx_dropped[CW_DROP_QUEUE_FULL]++;
        return;
    }
    cw_frame_copy(&e->frame, frame);
    e->from = origin->from;
    e->handed_in = origin->handed_in;
    stats->rx_frames++;
    stats->rx_bytes += cw_frame_length(frame);
}

bool cw_bus_poll(cw_bus *bus, cw_event *event)
{
    const cw_event_ring *ring = &bus->ring;
    if (ring->count == 0)
        return false;
    copy(ring, event, event_at(ring, 0));
    cw_bus_take(bus, 1);
    return true;
}

cw_event_row cw_bus_peek(const cw_bus *bus)
{
    const cw_event_ring *ring = &bus->ring;
    const unsigned in_a_row = ring->capacity - ring->first;
    return (cw_event_row){.first = ring->events + (size_t)ring->first * ring->event_size,
                          .size = ring->event_size,
                          .count = ring->count < in_a_row ? ring->count : in_a_row};
}

void cw_bus_take(cw_bus *bus, unsigned count)
{
    cw_event_ring *ring = &bus->ring;
    assert(count <= ring->count && count <= ring->capacity - ring->first);
    ring->count -= count;
    ring->first += count;
    if (ring->count == 0 || ring->first == ring->capacity) /* an empty ring stays in the cache */
        ring->first = 0;
}
