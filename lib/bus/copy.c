/* SPDX-License-Identifier: MIT
 *
 * copy.c - copies of a bus, which take it back to where it was, also from a look ahead.
 *
 * A copy has the memory of the bus, and behind it the records of its nodes. The room behind its
 * state is part of a copy only when something may have been in it.
 */
#include "bus/bus_private.h"

#include <assert.h>
#include <string.h>

/* Returns true while nothing of the room has been in use. */
static bool is_new(const cw_bus *bus)
{
    if (cw_now(bus) > 0 || bus->rules.count > 0 || bus->inbox.count > 0 || bus->ring.count > 0)
        return false;
    for (unsigned i = 0; i < bus->node_count; i++)
        if (bus->nodes[i].stats.handed_in > 0 || bus->nodes[i].stats.queue_peak > 0)
            return false;
    return true;
}

/* Returns the bytes of its own memory that a copy has. */
static size_t memory_copied(const cw_bus *bus)
{
    return is_new(bus) ? bus->state_size : bus->size;
}

/* Returns the bytes of its records. */
static size_t records_size(const cw_bus *bus)
{
    return bus->timed.records ? bus->node_count * sizeof *bus->timed.records : 0;
}

size_t cw_bus_copy_size(const cw_bus *bus)
{
    return memory_copied(bus) + records_size(bus);
}

void cw_bus_copy(const cw_bus *bus, void *copy)
{
    const size_t size = memory_copied(bus);
    memcpy(copy, bus, size);
    if (bus->timed.records)
        memcpy((unsigned char *)copy + size, bus->timed.records, records_size(bus));
}

void cw_bus_restore(cw_bus *bus, const void *copy)
{
    memcpy(bus, copy, bus->state_size); /* it says how much there is */
    const size_t size = memory_copied(bus);
    const size_t room = size - bus->state_size;
    memcpy((unsigned char *)bus + bus->state_size,
           (const unsigned char *)copy + bus->state_size, room);
    if (bus->timed.records)
        memcpy(bus->timed.records, (const unsigned char *)copy + size, records_size(bus));
}

void cw_bus_begin_again(cw_bus *bus, const void *copy, uint64_t seed)
{
    cw_bus_restore(bus, copy);
    assert(is_new(bus));
    bus->rules.bus.seed = seed;
}

/* Takes the events that the bus has. Returns the tick of the first one, or CW_NEVER. */
static uint64_t take_all(cw_bus *bus)
{
    cw_event event;
    uint64_t first = CW_NEVER;
    while (cw_bus_poll(bus, &event))
        first = cw_least(first, event.tick);
    return first;
}

uint64_t cw_bus_next_event(cw_bus *bus, void *copy, uint32_t kinds, uint64_t until)
{
    uint64_t first = CW_NEVER;
    cw_status status = CW_AGAIN;
    cw_bus_copy(bus, copy);
    (void)take_all(bus);
    cw_bus_set_events(bus, kinds);
    /* nodes with bits of their own may have earlier events in the next step */
    while (status != CW_OK && (first == CW_NEVER || cw_bus_now(bus) < first)) {
        status = cw_bus_advance_some(bus, until, 1); /* a step of the engine */
        first = cw_least(first, take_all(bus));
    }
    cw_bus_restore(bus, copy);
    return first;
}
