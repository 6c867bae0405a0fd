/* SPDX-License-Identifier: MIT
 *
 * control.c - the actions of fault rules on controllers, done at once.
 */
#include "bus/bus_private.h"

#include "mac/confinement.h"

/* The state at the end of the last bit is reported first. */
static void send_error_flag(cw_bus *bus, unsigned i, const cw_rule *rule)
{
    (void)rule;
    cw_bus_node *n = &bus->nodes[i];
    cw_commit_early(bus, i);
    cw_note_left(bus, i);
    const cw_role role = (cw_role)cw_mac_of(bus, i)->role;
    if (bus->asleep >> i & 1u)
        return;
    const bool sent = cw_mac_force_error(cw_own_mac(bus, i));
    cw_note_flag(bus, i, role == CW_ROLE_TRANSMITTER);
    if (!sent)
        return;
    cw_frame frame;
    cw_frame_copy(&frame, cw_queue_at(&n->queue, n->offered_slot)->frame);
    cw_remove_slot(bus, i, n->offered_slot);
    cw_push_drop(bus, i, CW_SIDE_TX, &frame, CW_DROP_ONE_SHOT, cw_now(bus));
}

/* In bus-off the offered frame is only in the queue, until the restart. */
static void set_counters(cw_mac *mac, unsigned tec, unsigned rec)
{
    (void)cw_mac_set_counters(mac, tec, rec);
    if (cw_mac_state(mac) == CW_STATE_BUS_OFF)
        (void)cw_mac_withdraw(mac);
}

/* The state at the end of the last bit is reported first. Bus-off ends a sleep. */
static void set_counters_of(cw_bus *bus, unsigned i, unsigned tec, unsigned rec)
{
    cw_commit_early(bus, i);
    cw_mac *mac = cw_own_mac(bus, i);
    if (tec >= CW_BUS_OFF_LIMIT)
        cw_note_left(bus, i);
    set_counters(mac, tec, rec);
    if ((bus->asleep >> i & 1u) && cw_mac_state(&bus->nodes[i].mac) == CW_STATE_BUS_OFF)
        cw_sleep_forget(bus, i);
}

/* Sets TEC and REC; CW_KEEP leaves one as it is. */
static void put_counters(cw_bus *bus, unsigned i, const cw_rule *rule)
{
    const cw_mac *mac = cw_own_mac(bus, i);
    unsigned tec = rule->tec == CW_KEEP ? cw_mac_tec(mac) : rule->tec;
    unsigned rec = rule->rec == CW_KEEP ? cw_mac_rec(mac) : rule->rec;
    set_counters_of(bus, i, tec, rec);
}

/* Raises the TEC to where the controller is bus-off at once (R10). */
static void go_bus_off(cw_bus *bus, unsigned i, const cw_rule *rule)
{
    (void)rule;
    set_counters_of(bus, i, CW_BUS_OFF_LIMIT, cw_mac_rec(cw_own_mac(bus, i)));
}

/* Asks for the restart of a node that is bus-off (R12). For all others nothing happens. */
static void restart(cw_bus *bus, unsigned i, const cw_rule *rule)
{
    (void)rule;
    if (cw_own_mac(bus, i)->phase != CW_MAC_BUS_OFF)
        return;
    cw_restart_now(bus, i); /* frames that the next rule sends come behind it */
    cw_find_node_due(bus);
}

/* Asks for overload frames, as the host may (O1 a). A controller that sleeps cannot send any. */
static void overload(cw_bus *bus, unsigned i, const cw_rule *rule)
{
    if (!(bus->asleep >> i & 1u))
        (void)cw_mac_request_overload(cw_own_mac(bus, i), rule->number);
}

/* The settings were found valid when the rule was added. */
static void change_settings(cw_bus *bus, unsigned i, const cw_rule *rule)
{
    (void)cw_node_set(bus, i, &rule->settings);
}

/* The host initialises its controller anew, and it no longer sleeps. Frames that wait for the
 * bus are lost, and so are those that wait for the host. A node that its host has taken off the bus
 * has no controller to reset. */
static void reset(cw_bus *bus, unsigned i, bool hardware)
{
    if (bus->detached & cw_node_bit(i))
        return;
    cw_commit_early(bus, i);
    cw_mac *mac = cw_own_mac(bus, i);
    cw_note_left(bus, i);
    const bool off = cw_mac_state(mac) == CW_STATE_BUS_OFF;
    const cw_drop why = off ? CW_DROP_BUS_OFF : CW_DROP_FAULT; /* R12 */
    cw_sleep_forget(bus, i);
    cw_mac_reset(mac, hardware);
    bus->restarts[i].at = CW_NEVER;
    cw_flush_queue(bus, i, why);
    cw_buffers_flush(bus, i, why);
    cw_find_node_due(bus);
    if (!off)
        return;
    bus->nodes[i].stats.restarts++;
    cw_rules_error(&bus->rules, i, cw_push_node_event(bus, CW_EVENT_RESTART, i));
}

static void software_reset(cw_bus *bus, unsigned i, const cw_rule *rule)
{
    (void)rule;
    reset(bus, i, false);
}

static void hardware_reset(cw_bus *bus, unsigned i, const cw_rule *rule)
{
    (void)rule;
    reset(bus, i, true);
}

typedef void control_action(cw_bus *bus, unsigned node, const cw_rule *rule);

static control_action *const actions[CW_ACTION_COUNT] = {
    [CW_ACTION_BUS_OFF] = go_bus_off,
    [CW_ACTION_ERROR_FLAG] = send_error_flag,
    [CW_ACTION_RESTART] = restart,
    [CW_ACTION_COUNTERS] = put_counters,
    [CW_ACTION_OVERLOAD] = overload,
    [CW_ACTION_SET] = change_settings,
    [CW_ACTION_SOFTWARE_RESET] = software_reset,
    [CW_ACTION_HARDWARE_RESET] = hardware_reset,
};

void cw_control_nodes(cw_bus *bus, const cw_rule *rule)
{
    control_action *act = actions[rule->action];
    for (uint64_t rest = act ? rule->nodes & bus->all : 0; rest; rest &= rest - 1)
        act(bus, cw_lowest_node(rest), rule);
    bus->pending = true;
}
