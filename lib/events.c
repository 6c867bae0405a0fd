/* SPDX-License-Identifier: MIT
 *
 * events.c - the ring of events: bounded, in time order, nothing lost.
 *
 * Before each bit the bus asks for room for the worst that can happen in it.
 */
#include "bus_private.h"

#include <assert.h>
#include <string.h>

/* Events that one node can have in one bit besides drops of frames. */
#define EVENTS_PER_NODE 8u

bool cw_ring_has_room(const cw_bus *bus)
{
    const cw_fault_set *f = &bus->faults;
    uint64_t frames = (uint64_t)bus->inbox.count + bus->held_count + bus->node_count;
    uint64_t worst = (uint64_t)bus->node_count * EVENTS_PER_NODE + 2u * f->count + bus->queued +
                     frames * (1 + f->host_rules + f->copies);
    uint64_t room = bus->ring.capacity - bus->ring.count;
    /* rules on the host side may want more than there is at all; then the ring is emptied first,
     * and what does not fit even so is counted as lost */
    return room >= worst || bus->ring.count == 0;
}

unsigned cw_ring_least(const cw_bus_config *c)
{
    unsigned events = c->node_count * EVENTS_PER_NODE + 2u * c->rule_count + 2u * c->rule_room +
                      2u * c->inbox + CW_HELD_FRAMES + c->node_count;
    for (unsigned i = 0; i < c->node_count; i++)
        events += c->nodes[i].queue;
    return events;
}

static cw_event *event_at(event_ring *ring, unsigned i)
{
    return &ring->events[(ring->first + i) % ring->capacity];
}

static cw_event *newest_event(event_ring *ring)
{
    return event_at(ring, ring->count - 1);
}

cw_event *cw_push_event(cw_bus *bus, cw_event_kind kind, uint64_t tick, uint64_t nodes)
{
    event_ring *ring = &bus->ring;
    cw_event *e = &bus->lost_event;
    if (ring->count < ring->capacity) {
        ring->count++;
        e = newest_event(ring);
    } else {
        bus->stats.events_lost++;
    }
    memset(e, 0, sizeof *e);
    e->kind = kind;
    e->tick = tick;
    e->nodes = nodes;
    return e;
}

cw_event *cw_push_node_event(cw_bus *bus, cw_event_kind kind, unsigned i)
{
    cw_event *e = cw_push_event(bus, kind, bus->now, cw_node_bit(i));
    e->tec = bus->nodes[i].mac.confinement.tec;
    e->rec = bus->nodes[i].mac.confinement.rec;
    return e;
}

static bool comes_behind_fault(const cw_event *e, uint64_t tick, unsigned rule)
{
    return e->tick == tick && (e->kind != CW_EVENT_FAULT || e->rule > rule);
}

void cw_push_fault(cw_bus *bus, unsigned rule, uint64_t tick)
{
    cw_event *e = cw_push_event(bus, CW_EVENT_FAULT, tick, 0);
    e->rule = (uint16_t)rule;
    e->hit = (uint32_t)bus->faults.faults[rule].hits;
    bus->stats.faults++;
    if (e == &bus->lost_event)
        return;
    for (unsigned i = bus->ring.count - 1; i > 0; i--) {
        cw_event *before = event_at(&bus->ring, i - 1);
        if (!comes_behind_fault(before, tick, rule))
            return;
        cw_event swapped = *before;
        *before = *event_at(&bus->ring, i);
        *event_at(&bus->ring, i) = swapped;
    }
}

void cw_push_drop(cw_bus *bus, unsigned i, const cw_frame *frame, cw_drop why, uint64_t tick)
{
    cw_event *e = cw_push_event(bus, CW_EVENT_DROP, tick, cw_node_bit(i));
    e->why = why;
    e->frame = *frame;
    bus->nodes[i].stats.dropped[why]++;
}

void cw_push_rx(cw_bus *bus, unsigned i, const cw_frame *frame)
{
    bus->nodes[i].stats.rx_frames++;
    bus->nodes[i].stats.rx_bytes += cw_frame_length(frame);
    cw_event *e = bus->ring.count ? newest_event(&bus->ring) : NULL;
    bool joins = e && e->kind == CW_EVENT_RX && e->tick == bus->now &&
                 !(e->nodes & cw_node_bit(i)) && cw_frame_equal(&e->frame, frame);
    if (joins)
        e->nodes |= cw_node_bit(i);
    else
        cw_push_node_event(bus, CW_EVENT_RX, i)->frame = *frame;
}

bool cw_bus_poll(cw_bus *bus, cw_event *event)
{
    event_ring *ring = &bus->ring;
    if (ring->count == 0)
        return false;
    *event = ring->events[ring->first];
    ring->first = (ring->first + 1) % ring->capacity;
    ring->count--;
    return true;
}
