/* SPDX-License-Identifier: MIT
 *
 * control.c - what fault rules do to controllers, at once.
 */
#include "rule/private.h"

#include "mac/confinement.h"

static void force_error(cw_bus *bus, unsigned i)
{
    bus_node *n = &bus->nodes[i];
    if (!cw_mac_force_error(cw_own_mac(bus, i)))
        return;
    cw_frame frame = n->queue.slots[n->offered_slot].frame;
    cw_remove_slot(bus, i, n->offered_slot);
    cw_push_drop(bus, i, CW_SIDE_TX, &frame, CW_DROP_ONE_SHOT, cw_now(bus));
}

/* In bus-off the queue alone has the frame that was on offer, until the restart. */
static void put_counters(cw_mac *mac, unsigned tec, unsigned rec)
{
    (void)cw_mac_set_counters(mac, tec, rec);
    if (cw_mac_state(mac) == CW_STATE_BUS_OFF)
        (void)cw_mac_withdraw(mac);
}

static void set_counters(cw_mac *mac, const cw_rule *rule)
{
    unsigned tec = rule->tec == CW_KEEP ? cw_mac_tec(mac) : rule->tec;
    unsigned rec = rule->rec == CW_KEEP ? cw_mac_rec(mac) : rule->rec;
    put_counters(mac, tec, rec);
}

static void command(cw_bus *bus, unsigned i, const cw_rule *rule)
{
    cw_mac *mac = cw_own_mac(bus, i);
    switch (rule->action) {
    case CW_ACTION_BUS_OFF:
        put_counters(mac, CW_BUS_OFF_LIMIT, cw_mac_rec(mac));
        break;
    case CW_ACTION_ERROR_FLAG:
        force_error(bus, i);
        break;
    case CW_ACTION_RESTART:
        if (mac->phase == CW_MAC_BUS_OFF)
            cw_schedule_restart(bus, i, cw_now(bus));
        break;
    case CW_ACTION_COUNTERS:
        set_counters(mac, rule);
        break;
    case CW_ACTION_OVERLOAD:
        (void)cw_mac_request_overload(mac, rule->number);
        break;
    case CW_ACTION_SET:
        (void)cw_node_set(bus, i, &rule->settings);
        break;
    case CW_ACTION_FLIP:
    case CW_ACTION_FORCE:
    case CW_ACTION_GLITCH:
    case CW_ACTION_STUCK:
    case CW_ACTION_NOISE:
    case CW_ACTION_NO_ACK:
    case CW_ACTION_DISCONNECT:
    case CW_ACTION_PARTITION:
    case CW_ACTION_WRONG_CRC:
    case CW_ACTION_DROP:
    case CW_ACTION_DELAY:
    case CW_ACTION_DUPLICATE:
    case CW_ACTION_REORDER:
    case CW_ACTION_CHANGE:
    case CW_ACTION_SEND:
    case CW_ACTION_BABBLE:
    case CW_ACTION_LOAD:
    case CW_ACTION_REPLY:
    case CW_ACTION_COUNT:
        break; /* other files */
    }
}

void cw_fault_command(cw_bus *bus, unsigned rule)
{
    const cw_rule *r = &bus->faults.faults[rule].rule;
    for (unsigned i = 0; i < bus->node_count; i++)
        if (r->nodes & cw_node_bit(i))
            command(bus, i, r);
    if (r->nodes & bus->faults.off)
        bus->faults.rewired = true; /* out of bus-off is not back on the bus */
    bus->news = true;
}
