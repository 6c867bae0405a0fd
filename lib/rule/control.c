/* SPDX-License-Identifier: MIT
 *
 * control.c - what fault rules do to controllers, at once.
 */
#include "rule/private.h"

#include "mac/confinement.h"

void cw_send_error_flag(cw_bus *bus, unsigned i, const cw_rule *rule)
{
    (void)rule;
    bus_node *n = &bus->nodes[i];
    if (!cw_mac_force_error(cw_own_mac(bus, i)))
        return;
    cw_frame frame = n->queue.slots[n->offered_slot].frame;
    cw_remove_slot(bus, i, n->offered_slot);
    cw_push_drop(bus, i, CW_SIDE_TX, &frame, CW_DROP_ONE_SHOT, cw_now(bus));
}

/* In bus-off the queue alone has the frame that was on offer, until the restart. */
static void set_counters(cw_mac *mac, unsigned tec, unsigned rec)
{
    (void)cw_mac_set_counters(mac, tec, rec);
    if (cw_mac_state(mac) == CW_STATE_BUS_OFF)
        (void)cw_mac_withdraw(mac);
}

void cw_put_counters(cw_bus *bus, unsigned i, const cw_rule *rule)
{
    cw_mac *mac = cw_own_mac(bus, i);
    unsigned tec = rule->tec == CW_KEEP ? cw_mac_tec(mac) : rule->tec;
    unsigned rec = rule->rec == CW_KEEP ? cw_mac_rec(mac) : rule->rec;
    set_counters(mac, tec, rec);
}

void cw_go_bus_off(cw_bus *bus, unsigned i, const cw_rule *rule)
{
    (void)rule;
    cw_mac *mac = cw_own_mac(bus, i);
    set_counters(mac, CW_BUS_OFF_LIMIT, cw_mac_rec(mac));
}

void cw_restart(cw_bus *bus, unsigned i, const cw_rule *rule)
{
    (void)rule;
    if (cw_own_mac(bus, i)->phase == CW_MAC_BUS_OFF)
        cw_schedule_restart(bus, i, cw_now(bus));
}

void cw_overload(cw_bus *bus, unsigned i, const cw_rule *rule)
{
    (void)cw_mac_request_overload(cw_own_mac(bus, i), rule->number);
}

void cw_change_settings(cw_bus *bus, unsigned i, const cw_rule *rule)
{
    (void)cw_node_set(bus, i, &rule->settings);
}

void cw_rule_command(cw_bus *bus, unsigned rule)
{
    const cw_rule_state *s = cw_rule_at(bus, rule);
    for (uint64_t rest = s->rule.nodes & bus->all; rest; rest &= rest - 1)
        if (s->does->control)
            s->does->control(bus, cw_lowest_node(rest), &s->rule);
    if (s->rule.nodes & bus->rules.off)
        bus->rules.rewired = true; /* out of bus-off is not back on the bus */
    bus->news = true;
}
