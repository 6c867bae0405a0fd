/* SPDX-License-Identifier: MIT
 *
 * order.c - tells when an arbitration was not won by the lowest identifier that was pending.
 *
 * Pending are the frames that were handed in before SOF began, or at that tick, and that have not
 * been sent. Their nodes are on the wire of the winner and could have taken part by the rules of
 * the protocol. So nodes in bus-off, integrating nodes, suspended ones (M8) and silent ones are
 * left out. Nodes that a fault has cut off are not: their frames are late by that fault.
 */
#include "state/state.h"

#include "format/head.h"
#include "mac/confinement.h"

/* A frame that waits. */
typedef struct pending_frame {
    uint32_t key; /* the lower one goes first */
    uint32_t can_id;
    unsigned node;
} pending_frame;

#define NO_FRAME UINT32_MAX

/* Returns the identifier as arbitration sees it. RTR does not count: data frames and remote frames
 * of one identifier keep their order in a queue. */
static uint32_t key_of(const cw_frame *frame)
{
    return cw_key_with_rtr(frame, CW_DOMINANT);
}

/* Returns true when a controller may send in the next free bit, so far as it can tell. */
static bool could_send(const cw_mac *m)
{
    static const bool waits[CW_MAC_PHASE_COUNT] = {
        [CW_MAC_INTEGRATING] = true, [CW_MAC_SUSPEND] = true, [CW_MAC_BUS_OFF] = true,
        [CW_MAC_RECOVERING] = true,
    };
    const bool will_suspend = m->phase == CW_MAC_INTERMISSION && m->role == CW_ROLE_TRANSMITTER &&
                              cw_confinement_passive(&m->confinement);
    const unsigned silent = CW_MODE_LISTEN_ONLY | CW_MODE_RESTRICTED | CW_MODE_LOOPBACK;
    return !waits[m->phase] && !will_suspend && !(m->modes & silent);
}

uint64_t cw_nodes_on_wire_of(const cw_bus *bus, unsigned i)
{
    unsigned g = 0;
    if (bus->group_count == 1)
        return bus->groups[0];
    while (g + 1 < bus->group_count && !(bus->groups[g] >> i & 1u))
        g++;
    return bus->groups[g];
}

void cw_order_begin(cw_bus *bus, unsigned i, uint64_t tick)
{
    uint64_t ready = 0;
    for (uint64_t rest = bus->waiting & cw_nodes_on_wire_of(bus, i); rest; rest &= rest - 1)
        if (could_send(cw_mac_of(bus, cw_lowest_node(rest))))
            ready |= rest & (~rest + 1);
    bus->starts[i] = (cw_start){.tick = tick, .ready = ready};
}

/* Takes the lowest frame of a node that is lower than the one found so far. One below `enough`
 * ends the search. A queue by priority has the lower ones in front, but frames in mailboxes come
 * before those that wait for one. */
static void find_lower(pending_frame *found, const cw_queue *q, unsigned node, uint64_t tick,
                       uint32_t enough)
{
    const bool sorted = q->mode == CW_ORDER_PRIORITY && q->boxed == 0;
    for (unsigned k = 0; k < q->count && found->key >= enough; k++) {
        const cw_queue_slot *slot = cw_queue_at(q, cw_queue_nth(q, k));
        const uint32_t key = key_of(slot->frame);
        if (key >= found->key && sorted)
            return;
        if (key < found->key && slot->handed_in <= tick)
            *found = (pending_frame){key, cw_frame_can_id(slot->frame), node};
    }
}

/* Finds the lowest pending frame that should have won instead of the frame of a slot. any: one of
 * them is enough. */
static pending_frame find_pending(const cw_bus *bus, unsigned i, uint16_t slot, bool any)
{
    const cw_start *start = &bus->starts[i];
    const cw_frame *frame = cw_queue_at(&bus->nodes[i].queue, slot)->frame;
    pending_frame found = {.key = key_of(frame), .node = NO_FRAME};
    const uint32_t enough = any ? found.key : 0;
    for (uint64_t rest = start->ready & bus->waiting; rest; rest &= rest - 1) {
        const unsigned node = cw_lowest_node(rest);
        find_lower(&found, &bus->nodes[node].queue, node, start->tick, enough);
    }
    return found;
}

bool cw_order_is_improper(const cw_bus *bus, unsigned i, uint16_t slot)
{
    return find_pending(bus, i, slot, true).node != NO_FRAME;
}

void cw_order_check(cw_bus *bus, unsigned i)
{
    const cw_bus_node *n = &bus->nodes[i];
    const pending_frame pending = find_pending(bus, i, n->offered_slot, false);
    if (pending.node == NO_FRAME || (n->mac.modes & CW_MODE_LOOPBACK))
        return;
    bus->stats.improper_arbitrations++;
    cw_event *e = cw_push_node_event(bus, CW_EVENT_IMPROPER, i);
    cw_frame_copy(&e->frame, cw_queue_at(&n->queue, n->offered_slot)->frame);
    e->frame.flags &= (uint8_t)~CW_FRAME_ESI; /* it has not been sent yet */
    e->from = cw_node_bit(pending.node);
    e->pending = pending.can_id;
}
