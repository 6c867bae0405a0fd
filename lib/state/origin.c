/* SPDX-License-Identifier: MIT
 *
 * origin.c - finds the nodes that have sent what a node receives, and the frame in which it finds
 * an error.
 */
#include "state/state.h"

#include "format/head.h"

#define PASSIVE_BITS 16u /* see sends_now() */

/* Returns the slot of the frame that a node sends. */
static const cw_queue_slot *offered_slot(const cw_bus *bus, unsigned i)
{
    const cw_bus_node *n = &bus->nodes[i];
    return cw_queue_at(&n->queue, n->offered_slot);
}

/* Returns true when an error of its own has ended a transmission, and its event is still to
 * come. */
static bool stops_now(const cw_bus *bus, unsigned i)
{
    const cw_mac_report *r = bus->timed.active ? &bus->timed.nodes[i].report : NULL;
    return r && (r->what & CW_REPORT_ERROR) && r->error.role == CW_ROLE_TRANSMITTER;
}

/* Returns true for a node that sends a frame, or whose error ends it in this very bit. */
static bool is_at_frame(const cw_bus *bus, unsigned i)
{
    const cw_mac *m = &bus->nodes[i].mac;
    if (m->role == CW_ROLE_RECEIVER || (m->modes & CW_MODE_LOOPBACK))
        return false;
    if (bus->starts[i].stopped == 0)
        return m->role == CW_ROLE_TRANSMITTER || stops_now(bus, i);
    return cw_mac_is_sending(m);
}

/* Returns true for a node whose transmission has ended a few bits ago. */
static bool has_just_stopped(const cw_bus *bus, unsigned i)
{
    const cw_mac *m = &bus->nodes[i].mac;
    const uint64_t stopped = bus->starts[i].stopped;
    return stopped != 0 && m->role != CW_ROLE_RECEIVER && !(m->modes & CW_MODE_LOOPBACK) &&
           cw_now(bus) - stopped < cw_rate_ticks(cw_wire_rate(&bus->time), PASSIVE_BITS);
}

/* Returns true for a sender of the frame whose last but one bit has come. An error may have stopped
 * it in this very bit. The node may then have left the bus (R10), or a rule or its host may have
 * taken it away. Behind a passive flag, or none, its frame goes on, too, when it would have been
 * recessive anyway. That is in up to 5 bits of the CRC, its delimiter, 3 bits of
 * acknowledgement, and 6 of EOF. With an older end the node has left the frame to other senders,
 * in the arbitration, or is still at a frame before. */
static bool sends_now(const cw_bus *bus, unsigned i)
{
    return is_at_frame(bus, i) || (has_just_stopped(bus, i) && bus->starts[i].end != CW_END_EARLY);
}

uint64_t cw_find_senders(const cw_bus *bus, unsigned receiver)
{
    uint64_t self = cw_node_bit(receiver);
    uint64_t nodes = 0;
    if (bus->frame_step.active)
        return cw_node_bit(bus->frame_step.node);
    if (bus->nodes[receiver].mac.modes & CW_MODE_LOOPBACK)
        return self;
    for (unsigned i = 0; i < bus->node_count; i++)
        if (sends_now(bus, i))
            nodes |= cw_node_bit(i);
    nodes |= bus->rules.raw & ~bus->rules.cut;
    for (unsigned g = 0; g < bus->group_count; g++)
        if (bus->groups[g] & self)
            nodes &= bus->groups[g];
    return nodes;
}

uint64_t cw_handed_in_of(const cw_bus *bus, unsigned i)
{
    const cw_start *start = &bus->starts[i];
    const bool over = start->stopped != 0 && !bus->frame_step.active;
    return over ? start->handed_in : offered_slot(bus, i)->handed_in;
}

cw_frame_origin cw_find_origin(const cw_bus *bus, unsigned receiver)
{
    cw_frame_origin origin = {.from = cw_find_senders(bus, receiver), .handed_in = CW_NEVER};
    if (origin.from & bus->rules.raw)
        origin.handed_in = cw_now(bus); /* no host has handed it in */
    for (uint64_t rest = origin.from & ~bus->rules.raw; rest; rest &= rest - 1)
        origin.handed_in = cw_least(origin.handed_in, cw_handed_in_of(bus, cw_lowest_node(rest)));
    return origin;
}

/* ---- Errors ---------------------------------------------------------------------------------- */

/* Returns the identifier of the frame that a node sends or has just stopped to send. */
static uint32_t sent_can_id(const cw_bus *bus, unsigned i)
{
    const cw_start *start = &bus->starts[i];
    return start->stopped ? start->can_id : cw_frame_can_id(offered_slot(bus, i)->frame);
}

/* Returns the key of an identifier in arbitration. */
static uint32_t can_id_key(uint32_t can_id)
{
    const cw_frame frame = {
        .id = can_id & CW_EXTENDED_ID_MAX,
        .flags = (uint8_t)((can_id & CW_FILTER_EXTENDED ? CW_FRAME_EXTENDED : 0) |
                           (can_id & CW_FILTER_REMOTE ? CW_FRAME_REMOTE : 0))};
    return cw_arbitration_key(&frame);
}

/* Returns the identifier that wins the arbitration of some nodes. */
static uint32_t winning_can_id(const cw_bus *bus, uint64_t nodes)
{
    uint32_t winner = 0, least = UINT32_MAX;
    if (nodes && (nodes & (nodes - 1)) == 0)
        return sent_can_id(bus, cw_lowest_node(nodes));
    for (uint64_t rest = nodes; rest; rest &= rest - 1) {
        const uint32_t can_id = sent_can_id(bus, cw_lowest_node(rest));
        const uint32_t key = can_id_key(can_id);
        if (key <= least)
            winner = can_id;
        least = key < least ? key : least;
    }
    return winner;
}

/* The nodes that may have sent what a node sees in part. */
typedef struct attempts {
    uint64_t sending; /* up to this bit */
    uint64_t stopped; /* a few bits ago */
} attempts;

/* Adds a node whose controller is no receiver, if it has sent lately. One that has sent its whole
 * frame has none that others see in part. */
static inline void add_attempt(attempts *a, const cw_bus *bus, unsigned k, uint64_t bit)
{
    const cw_start *start = &bus->starts[k];
    const cw_mac *m = &bus->nodes[k].mac;
    const uint64_t ago = cw_now(bus) - start->stopped;
    if (start->stopped ? start->end == CW_END_SENT || ago >= PASSIVE_BITS * bit
                       : m->role != CW_ROLE_TRANSMITTER && !stops_now(bus, k))
        return;
    if (m->modes & CW_MODE_LOOPBACK)
        return;
    if (start->stopped == 0 || ago < bit)
        a->sending |= cw_node_bit(k);
    else
        a->stopped |= cw_node_bit(k);
}

/* Returns the node of some, at least one, whose frame has begun first, or last. */
static unsigned find_begun(const cw_bus *bus, uint64_t nodes, bool first)
{
    unsigned found = cw_lowest_node(nodes);
    for (uint64_t rest = nodes & (nodes - 1); rest; rest &= rest - 1) {
        const unsigned i = cw_lowest_node(rest);
        if (first ? bus->starts[i].tick < bus->starts[found].tick
                  : bus->starts[i].tick > bus->starts[found].tick)
            found = i;
    }
    return found;
}

/* Returns those of some nodes whose frames have begun with that of one of them, less than a bit
 * before or after it. */
static uint64_t begun_with(const cw_bus *bus, uint64_t nodes, unsigned one)
{
    const uint64_t bit = cw_rate_ticks(cw_wire_rate(&bus->time), 1);
    const uint64_t begin = bus->starts[one].tick;
    for (uint64_t rest = nodes & ~cw_node_bit(one); rest; rest &= rest - 1) {
        const uint64_t tick = bus->starts[cw_lowest_node(rest)].tick;
        if (tick + bit <= begin || begin + bit <= tick)
            nodes &= ~(rest & (~rest + 1));
    }
    return nodes;
}

/* Returns the nodes whose frame a node sees in part when it finds an error inside a frame. They
 * send it up to this bit, or have been stopped a few bits ago. Others may not know of that yet: the
 * flag is passive, or not six bits long. One that sends over another frame has begun later. A
 * dominant pulse that is taken for a SOF is no frame of any node. */
static uint64_t find_attempts(const cw_bus *bus, unsigned i, bool own)
{
    const uint64_t bit = cw_rate_ticks(cw_wire_rate(&bus->time), 1);
    attempts a = {.sending = 0};
    if (bus->nodes[i].mac.modes & CW_MODE_LOOPBACK)
        return cw_node_bit(i);
    for (uint64_t rest = bus->all & cw_nodes_on_wire_of(bus, i); rest; rest &= rest - 1)
        if (bus->nodes[cw_lowest_node(rest)].mac.role != CW_ROLE_RECEIVER)
            add_attempt(&a, bus, cw_lowest_node(rest), bit);
    if (own)
        return begun_with(bus, a.sending | a.stopped | cw_node_bit(i), i);
    const uint64_t nodes = a.sending ? a.sending : a.stopped;
    return nodes ? begun_with(bus, nodes, find_begun(bus, nodes, a.sending)) : 0;
}

/* Finds the frame of an error of a receiver inside a frame. On one wire it is that of all receivers
 * at a tick. */
static void find_received(cw_bus *bus, unsigned i, cw_error_frame *out)
{
    cw_error_frame *common = &bus->error_frames[bus->node_count];
    if (bus->group_count > 1 || bus->error_at != cw_now(bus)) {
        common->from = find_attempts(bus, i, false);
        common->can_id = winning_can_id(bus, common->from);
        bus->error_at = bus->nodes[i].mac.modes & CW_MODE_LOOPBACK ? CW_NEVER : cw_now(bus);
    }
    *out = *common;
}

void cw_note_flag(cw_bus *bus, unsigned i, bool own)
{
    if (own)
        bus->error_frames[i] = (cw_error_frame){find_attempts(bus, i, true), sent_can_id(bus, i)};
    else
        find_received(bus, i, &bus->error_frames[i]);
}

void cw_find_error_frame(cw_bus *bus, unsigned i, cw_event *e)
{
    cw_error_frame *last = &bus->error_frames[i];
    const cw_field field = (cw_field)e->error.place.field;
    if (field >= CW_FIELD_OVERLOAD_FLAG || field == CW_FIELD_NONE)
        *last = (cw_error_frame){0};
    else if (field < CW_FIELD_INTERMISSION)
        cw_note_flag(bus, i, e->error.role == CW_ROLE_TRANSMITTER);
    e->from = last->from;
    e->can_id = last->can_id;
}
