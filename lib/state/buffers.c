/* SPDX-License-Identifier: MIT
 *
 * buffers.c - acceptance filters, and buffers for frames that hosts have not fetched yet.
 *
 * A host fetches one frame after the other, and needs a time for each. Meanwhile further ones wait.
 * One that finds no free buffer is lost, and those that wait stay as they are.
 */
#include "state/state.h"

#define OVERLOAD_BITS 15u /* of an overload frame with the flags of all nodes */

/* ---- Delivery -------------------------------------------------------------------------------- */

/* Gives a frame to the host, past the rules on its way. */
static void deliver(cw_bus *bus, unsigned i, cw_frame *frame, const frame_origin *origin)
{
    if (cw_rules_hand_out(&bus->rules, i, frame, origin))
        cw_push_rx(bus, i, frame, origin);
    cw_rules_passed(&bus->rules, i, CW_SIDE_RX, cw_now(bus));
}

/* ---- Buffers --------------------------------------------------------------------------------- */

static stored_frame *stored_at(const cw_buffers *b, unsigned n)
{
    return &b->stored[(b->first + n) % (b->limit + 1)];
}

/* Returns the frames that the host has not fetched by now. */
static unsigned unfetched(const cw_buffers *b, uint64_t now)
{
    unsigned fetched = 0;
    while (fetched < b->count && stored_at(b, fetched)->due <= now)
        fetched++;
    return b->count - fetched;
}

static void overrun(cw_bus *bus, unsigned i, const cw_frame *frame)
{
    cw_event *e = cw_push_node_event(bus, CW_EVENT_OVERRUN, i);
    cw_frame_copy(&e->frame, frame);
    cw_rules_error(&bus->rules, i, e);
    bus->nodes[i].stats.rx_dropped[CW_DROP_QUEUE_FULL]++;
    bus->buffers[i].stats.overruns++;
}

/* Wants overload frames as long as the buffers will be full. The first one comes in place of the
 * intermission, which would begin a bit later. */
static void ask_for_time(cw_bus *bus, unsigned i)
{
    const cw_buffers *b = &bus->buffers[i];
    const uint64_t bit = cw_rate_ticks(cw_wire_rate(&bus->time), 1);
    const uint64_t free_at = stored_at(b, b->count - b->limit)->due;
    const bool second = free_at > cw_now(bus) + (1 + OVERLOAD_BITS) * bit;
    if (free_at <= cw_now(bus) + bit)
        return;
    cw_leave(bus, cw_node_bit(i));
    (void)cw_mac_request_overload(&bus->nodes[i].mac, second ? 2 : 1);
    bus->outlook.valid = false;
}

/* A frame that has been fetched in the bit in progress is still stored: hosts get their frames
 * between two bits. */
static void store(cw_bus *bus, unsigned i, const cw_frame *frame, const frame_origin *origin)
{
    cw_buffers *b = &bus->buffers[i];
    const uint64_t now = cw_now(bus);
    const uint64_t last = b->count ? stored_at(b, b->count - 1)->due : now;
    if (unfetched(b, now) == b->limit) {
        overrun(bus, i, frame);
        return;
    }
    stored_frame *s = stored_at(b, b->count++);
    s->due = cw_after(last > now ? last : now, b->service_ticks);
    s->origin = *origin;
    cw_frame_copy(&s->frame, frame);
    bus->stored++;
    if (b->overload && unfetched(b, now) == b->limit)
        ask_for_time(bus, i);
    bus->node_due = cw_least(bus->node_due, stored_at(b, 0)->due);
}

void cw_buffers_receive(cw_bus *bus, unsigned i, cw_frame *frame, const frame_origin *origin)
{
    const cw_buffers *b = bus->buffers ? &bus->buffers[i] : NULL;
    bus->nodes[i].stats.rx_accepted++;
    if (b && b->limit)
        store(bus, i, frame, origin);
    else
        deliver(bus, i, frame, origin);
}

/* Takes the frame that has waited longest. */
static void take_first(cw_bus *bus, cw_buffers *b, stored_frame *out)
{
    bus->stored--;
    *out = *stored_at(b, 0);
    b->first = (b->first + 1) % (b->limit + 1);
    b->count--;
}

void cw_buffers_run(cw_bus *bus, unsigned i)
{
    cw_buffers *b = bus->buffers ? &bus->buffers[i] : NULL;
    stored_frame s;
    while (b && b->count && stored_at(b, 0)->due <= cw_now(bus)) {
        take_first(bus, b, &s);
        deliver(bus, i, &s.frame, &s.origin);
    }
}

uint64_t cw_buffers_due(const cw_bus *bus, unsigned i)
{
    const cw_buffers *b = bus->buffers ? &bus->buffers[i] : NULL;
    return b && b->count ? stored_at(b, 0)->due : CW_NEVER;
}

uint32_t cw_buffers_count(const cw_bus *bus, unsigned i)
{
    return bus->buffers ? bus->buffers[i].count : 0;
}

void cw_buffers_flush(cw_bus *bus, unsigned i, cw_drop why)
{
    cw_buffers *b = bus->buffers ? &bus->buffers[i] : NULL;
    stored_frame s;
    while (b && b->count) {
        take_first(bus, b, &s);
        cw_push_drop(bus, i, CW_SIDE_RX, &s.frame, why, cw_now(bus));
    }
}

const stored_frame *cw_buffers_at(const cw_bus *bus, unsigned i, unsigned n)
{
    return stored_at(&bus->buffers[i], n);
}

/* A host without buffers has the frame at once. */
void cw_buffers_put(cw_bus *bus, unsigned i, const stored_frame *s)
{
    cw_buffers *b = bus->buffers ? &bus->buffers[i] : NULL;
    held_frame held = {.due = cw_now(bus), .rule = CW_NO_RULE, .node = (uint8_t)i,
                       .side = CW_SIDE_RX, .origin = s->origin};
    if (b && b->count < b->limit) {
        *stored_at(b, b->count++) = *s;
        bus->stored++;
        return;
    }
    cw_frame_copy(&held.frame, &s->frame);
    if (!cw_rules_hold(&bus->rules, &held))
        cw_push_drop(bus, i, CW_SIDE_RX, &s->frame, CW_DROP_REMOVED, cw_now(bus));
}

bool cw_buffers_accept(cw_bus *bus, unsigned i, const cw_frame *frame)
{
    cw_buffers *b = bus->buffers ? &bus->buffers[i] : NULL;
    const bool passive = bus->nodes[i].mac.protocol & CW_PROTOCOL_2_0B_PASSIVE;
    const bool known = !passive || !cw_frame_is_extended(frame);
    if (!b || (known && cw_frame_matches(frame, b->filters, b->filter_count)))
        return true;
    b->stats.filtered++;
    return false;
}
