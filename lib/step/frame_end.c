/* SPDX-License-Identifier: MIT
 *
 * frame_end.c - ends a step before its frame ends: moves the controllers to their present points.
 */
#include "step/frame.h"

#include "mac/confinement.h"

#define PROTOCOLS_MAX 20u /* cw_protocol with NO_EXCEPTION and NON_ISO or without; of classical ones
                             also 2.0A and 2.0B passive */

/* The points of receivers after the bits that have passed, for each protocol that some node has. */
typedef struct points {
    unsigned count;
    cw_mac mac[PROTOCOLS_MAX];
    cw_fd_part fd[PROTOCOLS_MAX];
} points;

/* Finds the point at which a receiver with that protocol is. */
static void find_point(cw_mac *m, cw_fd_part *fd, const cw_bus *bus, unsigned protocol)
{
    cw_bits room;
    cw_stuffing found;
    const bool knows_fd = (protocol & CW_PROTOCOL_MASK) == CW_FD;
    cw_mac_init(m, 0, CW_REC_MAX);
    (void)cw_mac_set_protocol(m, protocol, knows_fd ? fd : NULL);
    cw_mac_go_into_frame(m, &bus->frame_step.frame, cw_frame_step_bits(bus, &room),
                         cw_frame_step_stuffing(bus, &found), bus->frame_step.at);
}

/* Returns the point for a controller. */
static const cw_mac *point_of(points *p, const cw_bus *bus, const cw_mac *m)
{
    unsigned i = 0;
    while (i < p->count && p->mac[i].protocol != m->protocol)
        i++;
    if (i == p->count) {
        find_point(&p->mac[i], &p->fd[i], bus, m->protocol);
        p->count++;
    }
    return &p->mac[i];
}

/* Moves a receiver to its point. */
static void go_to_point(points *p, const cw_bus *bus, cw_mac *m)
{
    cw_mac_go_to_point(m, point_of(p, bus, m));
}

/* Moves the sender to its point, with its frame on offer again. */
static void resume_sending(cw_bus *bus, unsigned i, points *p)
{
    cw_bus_node *n = &bus->nodes[i];
    bus->followers &= ~cw_node_bit(i);
    n->mac.phase = CW_MAC_IDLE; /* so that the controller takes an offer */
    if (!n->mac.offered && bus->frame_step.at < bus->frame_step.length)
        cw_offer_slot(n, n->offered_slot);
    go_to_point(p, bus, &n->mac);
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
        const cw_bus_node *n = &bus->nodes[i];
        cw_bind_rules(bus, i, cw_queue_at(&n->queue, n->offered_slot)->frame, 0);
    }
    if (watched & cw_node_bit(step->node))
        cw_bind_rules(bus, step->node, &step->frame, 0);
}

/* Before the first bit no node has seen anything. */
static uint64_t nodes_in_frame(const cw_frame_step *step)
{
    return step->at > 0 ? step->listeners : 0;
}

/* Notes the nodes that have begun to transmit and whose arbitration is not over. They are still as
 * they were before SOF. */
static void note_starts(cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    const uint64_t passed = cw_rate_ticks(cw_wire_rate(&bus->time), step->at);
    if (step->at < step->length)
        bus->starts[step->node].stopped = 0;
    if (step->at >= cw_frame_step_arbitration_bits(bus))
        return;
    for (uint64_t rest = step->undecided | cw_node_bit(step->node); rest; rest &= rest - 1)
        cw_order_begin(bus, cw_lowest_node(rest), cw_now(bus) - passed);
}

void cw_wake_controllers(cw_bus *bus)
{
    cw_frame_step *step = &bus->frame_step;
    points p;
    cw_clean_resume(bus);
    if (!step->active)
        return;
    if (step->counted != CW_NO_RULE && cw_match_ahead(bus, step->counted))
        cw_rules_count_back(&bus->rules, step->counted);
    step->active = false;
    cw_losses_show(bus);
    if (step->at > 0)
        bus->recessive_bits = cw_frame_step_recessive_bits(bus);
    note_starts(bus);
    p.count = 0;
    if (bus->followers && step->at > 0)
        go_to_point(&p, bus, &bus->common);
    for (uint64_t rest = nodes_in_frame(step) & ~bus->followers; rest; rest &= rest - 1)
        go_to_point(&p, bus, &bus->nodes[cw_lowest_node(rest)].mac);
    for (uint64_t rest = step->undecided | cw_node_bit(step->node); rest; rest &= rest - 1)
        resume_sending(bus, cw_lowest_node(rest), &p);
    if (!step->seen) /* its controllers have bound theirs at SOF */
        bind_rules(bus);
    cw_outlook_forget(bus);
}
