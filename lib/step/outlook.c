/* SPDX-License-Identifier: MIT
 *
 * outlook.c - the part of each node in the next frame, while all nodes are idle.
 */
#include "step/step.h"

#include "mac/confinement.h"

#include <assert.h>

static bool outlook_is_away(const cw_mac *m)
{
    return m->phase == CW_MAC_OFF || m->phase == CW_MAC_BUS_OFF || m->phase == CW_MAC_ASLEEP;
}

/* Returns true when a node is idle, or away for longer than a frame. Otherwise no frame step is
 * possible. */
static bool is_calm(const cw_mac *m)
{
    return (outlook_is_away(m) || m->phase == CW_MAC_IDLE) &&
           m->reported_state == m->confinement.state && m->overloads_wanted == 0;
}

/* Notes in which of the sets a node is, as long as it stays as it is. */
static void count_node(cw_outlook *outlook, const cw_bus_node *n, bool has_boxes, uint64_t self)
{
    const cw_mac *m = &n->mac;
    if (outlook_is_away(m))
        outlook->away |= self;
    if (m->phase != CW_MAC_IDLE || (m->modes & CW_MODE_LOOPBACK))
        return;
    outlook->listeners |= self;
    if (m->fd)
        outlook->fd |= self;
    if (m->modes & CW_MODE_LISTEN_ONLY)
        return;
    if (!(m->modes & CW_MODE_RESTRICTED)) /* D19 */
        outlook->senders |= self;
    if (n->queue.mode == CW_ORDER_PRIORITY && !has_boxes)
        outlook->orderly |= self & outlook->senders;
    if (m->modes & CW_MODES_SINGLE)
        outlook->one_shot |= self;
    if (m->no_ack)
        return;
    outlook->acknowledgers |= self;
    if (m->confinement.rec > 0 && !m->confinement.frozen)
        outlook->counting |= self;
}

/* Returns true for an idle node without anything rare. It is in all sets of such nodes, so that it
 * is not asked for each of them. */
static inline bool is_usual(const cw_bus_node *n)
{
    const cw_mac *m = &n->mac;
    return m->phase == CW_MAC_IDLE && m->modes == 0 && !m->no_ack && !m->fd &&
           n->queue.mode == CW_ORDER_PRIORITY && m->overloads_wanted == 0 &&
           m->reported_state == m->confinement.state;
}

/* Returns true when frames need nothing that is rare. Rules that come awake and frames that rules
 * hold back are left out, since they change without a call: see cw_frame_step_begin(). */
static bool lacks_rarities(const cw_bus *bus, const cw_outlook *outlook)
{
    const cw_rule_set *rules = &bus->rules;
    return outlook->calm && (outlook->listeners | outlook->away) == bus->all &&
           !cw_is_off_grid(bus) && !bus->stepping && !bus->watching && bus->group_count == 1 &&
           !bus->buffers && !bus->tt && !bus->dozing && !bus->listening &&
           !cw_wants_event(bus, CW_EVENT_ARBITRATION_LOST) && rules->error_rules == 0 &&
           rules->host_rules == 0 && rules->reply_rules == 0;
}

/* Returns the senders whose frames are plain. Another node must acknowledge them. */
static uint64_t find_plain(const cw_bus *bus, const cw_outlook *outlook)
{
    uint64_t plain = outlook->orderly & ~outlook->one_shot;
    if (!lacks_rarities(bus, outlook) || outlook->acknowledgers == 0)
        return 0;
    if ((outlook->acknowledgers & (outlook->acknowledgers - 1)) == 0)
        plain &= ~outlook->acknowledgers;
    if (bus->start_at_tick) /* see goes_another_way() of bus.c */
        plain = 0;
    for (uint64_t rest = plain; rest; rest &= rest - 1)
        if (cw_confinement_passive(&bus->nodes[cw_lowest_node(rest)].mac.confinement))
            plain &= ~(rest & (~rest + 1)); /* it suspends transmission (M8) */
    return plain;
}

/* The own phase of followers is idle, as the shared one is then. */
static cw_outlook look_around(const cw_bus *bus)
{
    cw_outlook outlook = {.valid = true, .calm = true};
    uint64_t usual = 0, counting = 0;
    for (unsigned i = 0; i < bus->node_count; i++) {
        const cw_bus_node *n = &bus->nodes[i];
        if (!bus->buffers && is_usual(n)) {
            usual |= cw_node_bit(i);
            counting |= n->mac.confinement.rec > 0 ? cw_node_bit(i) : 0;
            continue;
        }
        outlook.calm = outlook.calm && is_calm(&n->mac);
        count_node(&outlook, n, bus->buffers && bus->buffers[i].boxes, cw_node_bit(i));
    }
    outlook.listeners |= usual;
    outlook.senders |= usual;
    outlook.orderly |= usual;
    outlook.acknowledgers |= usual;
    outlook.counting |= counting;
    outlook.plain = find_plain(bus, &outlook);
    return outlook;
}

void cw_outlook_find(cw_bus *bus)
{
    bus->outlook = look_around(bus);
}

void cw_assert_outlook(const cw_bus *bus)
{
    const cw_outlook *known = &bus->outlook;
    assert(known->plain == 0 || (known->valid && known->calm && !bus->pending &&
                                 !(bus->followers && bus->common.phase != CW_MAC_IDLE)));
    if (!known->valid || (bus->followers && bus->common.phase != CW_MAC_IDLE))
        return;
    const cw_outlook outlook = look_around(bus);
    assert(known->calm == outlook.calm && known->away == outlook.away);
    assert(known->listeners == outlook.listeners && known->senders == outlook.senders);
    assert(known->acknowledgers == outlook.acknowledgers && known->one_shot == outlook.one_shot);
    assert(known->counting == outlook.counting && known->fd == outlook.fd);
    assert(known->orderly == outlook.orderly);
    assert((known->plain & ~outlook.plain) == 0);
}
