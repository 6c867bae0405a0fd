/* SPDX-License-Identifier: MIT
 *
 * frame_end.c - ends a step before its frame ends: moves the controllers to their present points.
 */
#include "step/frame.h"

#include "mac/confinement.h"

/* Finds the point of a receiver after the bits that have passed. */
static void find_point(cw_mac *m, const cw_bus *bus)
{
    cw_bits room;
    cw_mac_init(m, 0, CW_REC_MAX);
    cw_mac_go_into_frame(m, &bus->frame_step.frame, cw_frame_step_bits(bus, &room),
                         bus->frame_step.at);
}

static void resume_sending(cw_bus *bus, unsigned i, const cw_mac *point)
{
    bus_node *n = &bus->nodes[i];
    cw_leave(bus, cw_node_bit(i));
    n->mac.phase = CW_MAC_IDLE; /* so that the controller takes an offer */
    if (!n->mac.offered && bus->frame_step.at < bus->frame_step.length)
        cw_offer_slot(n, n->offered_slot);
    cw_mac_go_to_point(&n->mac, point);
    cw_mac_become_transmitter(&n->mac, bus->frame_step.at);
}

/* Binds rules to the nodes that transmit, as at SOF. Nodes that were to lose may now win after all,
 * so rules on their later bits count again. */
static void bind_rules(cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    uint64_t watched = bus->rules.watched;
    for (uint64_t rest = step->undecided & watched; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        const bus_node *n = &bus->nodes[i];
        cw_bind_rules(bus, i, &n->queue.slots[n->offered_slot].frame);
    }
    if (watched & cw_node_bit(step->node))
        cw_bind_rules(bus, step->node, &step->frame);
}

/* Before the first bit no node has seen anything. */
static uint64_t nodes_in_frame(const cw_frame_step *step)
{
    return step->at > 0 ? step->listeners : 0;
}

void cw_wake_controllers(cw_bus *bus)
{
    cw_frame_step *step = &bus->frame_step;
    cw_mac point;
    if (!step->active)
        return;
    step->active = false;
    cw_losses_show(bus);
    if (step->at > 0)
        bus->recessive_bits = cw_frame_step_recessive_bits(bus);
    find_point(&point, bus);
    if (bus->followers && step->at > 0)
        cw_mac_go_to_point(&bus->common, &point);
    for (uint64_t rest = nodes_in_frame(step) & ~bus->followers; rest; rest &= rest - 1)
        cw_mac_go_to_point(&bus->nodes[cw_lowest_node(rest)].mac, &point);
    for (uint64_t rest = step->undecided | cw_node_bit(step->node); rest; rest &= rest - 1)
        resume_sending(bus, cw_lowest_node(rest), &point);
    bind_rules(bus);
    bus->outlook.valid = false;
}
