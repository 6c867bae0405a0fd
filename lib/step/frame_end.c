/* SPDX-License-Identifier: MIT
 *
 * frame_end.c - a leap ends before its frame does: controllers are put where they would be by now.
 */
#include "step/frame.h"

#include "mac/confinement.h"

/* Where a receiver is after that many bits. */
static void find_point(cw_mac *m, const cw_bus *bus)
{
    cw_bits room;
    cw_mac_init(m, 0, CW_REC_MAX);
    cw_mac_go_into_frame(m, &bus->leap.frame, cw_leap_bits(bus, &room), bus->leap.at);
}

static void resume_sending(cw_bus *bus, unsigned i, const cw_mac *point)
{
    bus_node *n = &bus->nodes[i];
    cw_leave(bus, cw_node_bit(i));
    n->mac.phase = CW_MAC_IDLE; /* so that it takes an offer */
    if (!n->mac.offered && bus->leap.at < bus->leap.length)
        cw_offer_slot(n, n->offered_slot);
    cw_mac_go_to_point(&n->mac, point);
    cw_mac_become_transmitter(&n->mac, bus->leap.at);
}

/* Rules are bound to those who transmit, as they would have been at SOF. Those who were to lose may
 * do well after all, so that rules on their later bits count again. */
static void bind_rules(cw_bus *bus)
{
    const cw_leap *leap = &bus->leap;
    uint64_t watched = leap->bound ? 0 : bus->rules.watched;
    for (uint64_t rest = leap->undecided & watched; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        const bus_node *n = &bus->nodes[i];
        cw_bind_rules(bus, i, &n->queue.slots[n->offered_slot].frame);
    }
    if (watched & cw_node_bit(leap->node))
        cw_bind_rules(bus, leap->node, &leap->frame);
}

/* Before the first bit nobody has seen anything. */
static uint64_t nodes_in_frame(const cw_leap *leap)
{
    return leap->at > 0 ? leap->listeners : 0;
}

void cw_wake_controllers(cw_bus *bus)
{
    cw_leap *leap = &bus->leap;
    cw_mac point;
    if (!leap->active)
        return;
    leap->active = false;
    cw_losses_show(bus, leap->hidden);
    if (leap->at > 0)
        bus->recessive_bits = cw_leap_recessive_bits(bus);
    find_point(&point, bus);
    if (bus->followers && leap->at > 0)
        cw_mac_go_to_point(&bus->common, &point);
    for (uint64_t rest = nodes_in_frame(leap) & ~bus->followers; rest; rest &= rest - 1)
        cw_mac_go_to_point(&bus->nodes[cw_lowest_node(rest)].mac, &point);
    for (uint64_t rest = leap->undecided | cw_node_bit(leap->node); rest; rest &= rest - 1)
        resume_sending(bus, cw_lowest_node(rest), &point);
    bind_rules(bus);
    bus->outlook.valid = false;
}
