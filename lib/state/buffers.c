/* SPDX-License-Identifier: MIT
 *
 * buffers.c - acceptance filters, and buffers for frames that hosts have not fetched yet.
 *
 * A host fetches one frame after the other, and needs a time for each. Meanwhile further ones wait.
 * One that finds no free buffer is lost, and those that wait stay as they are. In mailboxes it is
 * the other way round: the new frame takes the place of an older one.
 */
#include "state/state.h"

#include <assert.h>

#define OVERLOAD_BITS 15u /* of an overload frame with the flags of all nodes */

/* ---- Delivery -------------------------------------------------------------------------------- */

/* Gives a frame to the host, past the rules on its way. */
static void buffers_deliver(cw_bus *bus, unsigned i, cw_frame *frame, const cw_frame_origin *origin)
{
    if (cw_rules_hand_out(&bus->rules, i, frame, origin))
        cw_push_rx(bus, i, frame, origin);
    cw_rules_passed(&bus->rules, i, CW_SIDE_RX, cw_now(bus));
}

/* ---- Buffers --------------------------------------------------------------------------------- */

/* Returns the n-th of the frames that wait for the host, the oldest first. */
static cw_stored_frame *stored_at(const cw_buffers *b, unsigned n)
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

/* Returns the bytes that a frame takes in the receive buffer of the SJA1000. */
static unsigned bytes_of(const cw_frame *frame)
{
    return (cw_frame_is_extended(frame) ? 5u : 3u) + cw_frame_length(frame);
}

/* Returns true when a frame finds room behind that many that the host has not fetched. */
static bool buffers_fits(const cw_buffers *b, unsigned waiting, const cw_frame *frame)
{
    unsigned bytes = bytes_of(frame);
    for (unsigned n = b->count - waiting; b->byte_limit && n < b->count; n++)
        bytes += bytes_of(&stored_at(b, n)->frame);
    return waiting < b->limit && (b->byte_limit == 0 || bytes <= b->byte_limit);
}

/* Returns the tick from which on a frame finds room, 0: at once. */
static uint64_t room_at(const cw_buffers *b, uint64_t now, const cw_frame *frame)
{
    uint64_t at = 0;
    for (unsigned waiting = unfetched(b, now); waiting > 0 && !buffers_fits(b, waiting, frame);
         waiting--)
        at = stored_at(b, b->count - waiting)->due;
    return at;
}

/* Reports that a received frame is lost: the new one, or an older one. */
static void overrun(cw_bus *bus, unsigned i, const cw_frame *frame)
{
    cw_event *e = cw_push_node_event(bus, CW_EVENT_OVERRUN, i);
    cw_frame_copy(&e->frame, frame);
    cw_rules_error(&bus->rules, i, e);
    bus->nodes[i].stats.rx_dropped[CW_DROP_QUEUE_FULL]++;
}

/* Returns true when the bus does not see the flags of a node, or it sends none (M11, M15, D19). */
static bool asks_in_vain(const cw_bus *bus, unsigned i)
{
    const unsigned silent = CW_MODE_LISTEN_ONLY | CW_MODE_LOOPBACK | CW_MODE_RESTRICTED;
    return bus->nodes[i].mac.modes & silent;
}

/* Asks for overload frames for as long as there will be no room for another frame like this one.
 * The first one comes in place of the intermission, which would begin a bit later. */
static void ask_for_time(cw_bus *bus, unsigned i, const cw_frame *frame)
{
    const uint64_t bit = cw_rate_ticks(cw_wire_rate(&bus->time), 1);
    const uint64_t free_at = room_at(&bus->buffers[i], cw_now(bus), frame);
    const bool second = free_at > cw_now(bus) + (1 + OVERLOAD_BITS) * bit;
    if (free_at <= cw_now(bus) + bit || asks_in_vain(bus, i))
        return;
    cw_leave(bus, cw_node_bit(i));
    (void)cw_mac_request_overload(&bus->nodes[i].mac, second ? 2 : 1);
    cw_outlook_forget(bus);
}

/* Adds a frame behind those that wait. One that has been fetched in the bit in progress is still
 * among them: hosts get their frames between two bits. */
static void buffers_add(cw_bus *bus, unsigned i, const cw_frame *frame,
                        const cw_frame_origin *origin, unsigned box)
{
    cw_buffers *b = &bus->buffers[i];
    const uint64_t now = cw_now(bus);
    const uint64_t last = b->count ? stored_at(b, b->count - 1)->due : now;
    assert(b->count <= b->limit);
    cw_stored_frame *s = stored_at(b, b->count++);
    s->due = cw_after(last > now ? last : now, b->service_ticks);
    s->box = (uint8_t)box;
    s->origin = *origin;
    cw_frame_copy(&s->frame, frame);
    bus->stored++;
    bus->node_due = cw_least(bus->node_due, stored_at(b, 0)->due);
}

/* Keeps a received frame for the host, or loses it when the buffers are full. */
static void store(cw_bus *bus, unsigned i, const cw_frame *frame, const cw_frame_origin *origin)
{
    cw_buffers *b = &bus->buffers[i];
    if (buffers_fits(b, unfetched(b, cw_now(bus)), frame)) {
        buffers_add(bus, i, frame, origin, CW_NO_BOX);
    } else {
        overrun(bus, i, frame);
        b->stats.overruns++;
    }
    if (b->overload)
        ask_for_time(bus, i, frame);
}

/* ---- Receive mailboxes ----------------------------------------------------------------------- */

/* Returns the frame in a mailbox for another one that the host will fetch last. There is one. */
static cw_stored_frame *last_for(const cw_buffers *b, const cw_frame *frame)
{
    unsigned n = b->count - 1;
    while (!cw_mailbox_takes(b, stored_at(b, n)->box, frame)) {
        assert(n > 0);
        n--;
    }
    return stored_at(b, n);
}

/* Returns the receive mailboxes whose frames the host has not fetched yet. */
static uint64_t full_boxes(const cw_buffers *b, uint64_t now)
{
    uint64_t full = 0;
    for (unsigned n = b->count - unfetched(b, now); n < b->count; n++)
        full |= cw_node_bit(stored_at(b, n)->box);
    return full;
}

/* Its host fetches the newer frame when it would have fetched the older one. */
static void overwrite(cw_bus *bus, unsigned i, cw_stored_frame *s, const cw_frame *frame,
                      const cw_frame_origin *origin)
{
    overrun(bus, i, &s->frame);
    bus->buffers[i].stats.overwritten++;
    s->origin = *origin;
    cw_frame_copy(&s->frame, frame);
}

/* Keeps a received frame in a free mailbox that takes it, or in place of an older one. */
static void store_in_box(cw_bus *bus, unsigned i, const cw_frame *frame,
                         const cw_frame_origin *origin)
{
    const cw_buffers *b = &bus->buffers[i];
    const uint64_t now = cw_now(bus);
    const unsigned box = cw_mailboxes_for(b, frame, full_boxes(b, now));
    if (box == CW_NO_BOX)
        overwrite(bus, i, last_for(b, frame), frame, origin);
    else
        buffers_add(bus, i, frame, origin, box);
}

/* ---- Reception ------------------------------------------------------------------------------- */

void cw_buffers_receive(cw_bus *bus, unsigned i, cw_frame *frame, const cw_frame_origin *origin)
{
    const cw_buffers *b = bus->buffers ? &bus->buffers[i] : NULL;
    bus->nodes[i].stats.rx_accepted++;
    if (b && b->limit && b->boxed)
        store_in_box(bus, i, frame, origin);
    else if (b && b->limit)
        store(bus, i, frame, origin);
    else
        buffers_deliver(bus, i, frame, origin);
}

/* Takes the frame that has waited longest. */
static void buffers_take_first(cw_bus *bus, cw_buffers *b, cw_stored_frame *out)
{
    bus->stored--;
    *out = *stored_at(b, 0);
    b->first = (b->first + 1) % (b->limit + 1);
    b->count--;
}

void cw_buffers_run(cw_bus *bus, unsigned i)
{
    cw_buffers *b = bus->buffers ? &bus->buffers[i] : NULL;
    cw_stored_frame s;
    while (b && b->count && stored_at(b, 0)->due <= cw_now(bus)) {
        buffers_take_first(bus, b, &s);
        buffers_deliver(bus, i, &s.frame, &s.origin);
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
    cw_stored_frame s;
    while (b && b->count) {
        buffers_take_first(bus, b, &s);
        cw_push_drop(bus, i, CW_SIDE_RX, &s.frame, why, cw_now(bus));
    }
}

const cw_stored_frame *cw_buffers_at(const cw_bus *bus, unsigned i, unsigned n)
{
    return stored_at(&bus->buffers[i], n);
}

/* Returns true when a buffer or a mailbox, set in *box, takes a frame that waited in another
 * bus. */
static bool has_place(const cw_buffers *b, const cw_frame *frame, uint64_t now, uint8_t *box)
{
    *box = CW_NO_BOX;
    if (!b || b->count >= b->limit)
        return false;
    if (b->boxed)
        *box = (uint8_t)cw_mailboxes_for(b, frame, full_boxes(b, now));
    return !b->boxed || *box != CW_NO_BOX;
}

void cw_buffers_put(cw_bus *bus, unsigned i, const cw_stored_frame *s, bool waits)
{
    cw_buffers *b = bus->buffers ? &bus->buffers[i] : NULL;
    cw_held_frame held = {.due = cw_now(bus),
                          .rule = CW_NO_RULE,
                          .node = (uint8_t)i,
                          .side = CW_SIDE_RX,
                          .origin = s->origin};
    uint8_t box;
    if (waits && has_place(b, &s->frame, cw_now(bus), &box)) {
        cw_stored_frame *put = stored_at(b, b->count++);
        *put = *s;
        put->box = box;
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
    if (b && b->reply_boxes && cw_mailboxes_answer(bus, i, frame))
        return false;
    if (!b || (known && cw_frame_matches(frame, b->filters, b->filter_count) &&
               (!b->boxed || cw_mailboxes_for(b, frame, 0) != CW_NO_BOX)))
        return true;
    b->stats.filtered++;
    return false;
}
