/* SPDX-License-Identifier: MIT
 *
 * frame_resume.c - continues a frame that began bit by bit as a step, when one sender is left and
 * all others read its frame without errors.
 */
#include "step/frame.h"

/* ---- Conditions ------------------------------------------------------------------------------ */

static bool is_away(const cw_mac *m)
{
    return m->phase == CW_MAC_OFF || m->phase == CW_MAC_BUS_OFF;
}

/* Returns the nodes that send; senders are never followers. This runs for every bit and so must be
 * cheap. */
static uint64_t find_senders(const cw_bus *bus)
{
    uint64_t senders = 0;
    if (bus->followers && bus->common.phase != CW_MAC_FRAME)
        return 0;
    for (uint64_t rest = bus->all & ~bus->followers; rest; rest &= rest - 1)
        if (cw_mac_is_sending(&bus->nodes[cw_lowest_node(rest)].mac))
            senders |= rest & (~rest + 1);
    return senders;
}

/* Returns true up to the ACK slot, where all nodes do the same. In the first two bits other nodes
 * may still join (M6). */
static bool is_in_its_middle(const bus_node *n)
{
    const cw_mac *m = &n->mac;
    return !(m->modes & CW_MODE_LOOPBACK) && !n->wrong_crc && m->tx_next >= 2 &&
           m->tx_next + CW_AFTER_ACK_BITS + 1u < m->tx.length;
}

/* A node in loopback neither sees the frame nor waits for its end. */
static bool stays_out(const cw_bus *bus, unsigned i)
{
    const cw_mac *m = &bus->nodes[i].mac;
    bool alone = m->phase == CW_MAC_IDLE && (m->modes & CW_MODE_LOOPBACK);
    return is_away(m) || (alone && !(bus->waiting >> i & 1u));
}

static bool all_read_it(const cw_bus *bus, unsigned sender)
{
    const cw_mac *sent = &bus->nodes[sender].mac;
    if (bus->followers && !cw_mac_reads_along(&bus->common, sent))
        return false;
    for (uint64_t rest = bus->all & ~bus->followers; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        const cw_mac *m = &bus->nodes[i].mac;
        if (i != sender && !stays_out(bus, i) && !cw_mac_reads_along(m, sent))
            return false;
    }
    return true;
}

/* Checks the wire too, since faults on the lines of a node can hide its real level from that
 * node. */
static bool wire_carried_it(const cw_bus *bus, const cw_mac *sent)
{
    unsigned recessive = 0;
    while (recessive < sent->tx_next && cw_bits_level(&sent->tx, sent->tx_next - 1u - recessive))
        recessive++;
    return recessive == bus->recessive_bits;
}

/* The flag of a node that has just left the bus still counts: a bit without it ends it. */
static bool flags_have_ended(const cw_bus *bus)
{
    return !bus->error_flag.now && !bus->overload_flag.now;
}

static bool nobody_has_plans(const cw_bus *bus)
{
    for (unsigned i = 0; i < bus->node_count; i++) {
        const cw_mac *m = &bus->nodes[i].mac;
        if (m->overloads_wanted > 0 || m->told_state != m->confinement.state)
            return false;
    }
    return true;
}

/* Bound rules see only the bits at which the step stops. */
static bool rules_allow_it(cw_bus *bus, unsigned sender)
{
    if (bus->rules.error_rules > 0)
        return false;
    if (bus->rules.awake_count == 0)
        return true;
    const unsigned touch = cw_rules_touch_now(&bus->rules);
    bool at_work = (touch & CW_TOUCH_FRAME) && (touch & CW_TOUCH_LEVELS);
    return !at_work && !(touch & CW_TOUCH_CONTROLLERS) &&
           !cw_rules_look_at_next(&bus->rules, sender) && cw_frame_step_is_noise_free(bus, 1);
}

/* ---- Going on -------------------------------------------------------------------------------- */

/* Makes the controllers idle, as they are in a frame step. */
static void put_to_rest(cw_bus *bus)
{
    if (bus->followers)
        cw_mac_rest(&bus->common);
    for (uint64_t rest = bus->all & ~bus->followers; rest; rest &= rest - 1) {
        cw_mac *m = &bus->nodes[cw_lowest_node(rest)].mac;
        if (!is_away(m))
            cw_mac_rest(m);
    }
}

static void take_over(cw_bus *bus, unsigned sender)
{
    cw_frame_step *step = &bus->frame_step;
    const bus_node *n = &bus->nodes[sender];
    step->at = n->mac.tx_next;
    step->length = n->mac.tx.length;
    step->bits = &n->mac.tx;
    step->frame = n->queue.slots[n->offered_slot].frame;
    step->watched = 0;
    step->bound = true;
}

bool cw_frame_step_resume(cw_bus *bus)
{
    const uint64_t senders = find_senders(bus);
    if (senders == 0 || (senders & (senders - 1)))
        return false;
    const unsigned sender = cw_lowest_node(senders);
    if (bus->group_count > 1 || bus->news || !is_in_its_middle(&bus->nodes[sender]) ||
        !rules_allow_it(bus, sender) || !all_read_it(bus, sender) || !nobody_has_plans(bus) ||
        !flags_have_ended(bus) || !wire_carried_it(bus, &bus->nodes[sender].mac))
        return false;
    put_to_rest(bus);
    cw_outlook_find(bus);
    cw_frame_step_prepare(bus, sender, senders);
    take_over(bus, sender);
    bus->frame_step.look = cw_frame_step_next_look(bus, bus->frame_step.at);
    return true;
}
