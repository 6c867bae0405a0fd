/* SPDX-License-Identifier: MIT
 *
 * report.c - tells hosts of new states of their nodes.
 */
#include "state/state.h"

/* Returns the state as the host of a node is told. */
static cw_state told_state(const cw_bus *bus, unsigned i, cw_state state)
{
    const bool silent = bus->silent >> i & 1u;
    return silent && state == CW_STATE_ERROR_PASSIVE ? CW_STATE_ERROR_WARNING : state;
}

/* Reports a change of state, unless the host would see none. */
static void tell_state(cw_bus *bus, unsigned i, cw_state before, cw_state after)
{
    before = told_state(bus, i, before);
    after = told_state(bus, i, after);
    if (before == after)
        return;
    cw_event *e = cw_push_node_event(bus, CW_EVENT_STATE, i);
    e->state = (uint8_t)after;
    e->state_before = (uint8_t)before;
    cw_rules_error(&bus->rules, i, e);
}

void cw_report_new_state(cw_bus *bus, unsigned i)
{
    cw_bus_node *n = &bus->nodes[i];
    cw_state before = (cw_state)n->reported_state;
    cw_state after = cw_node_state(bus, i);
    n->reported_state = (uint8_t)after;
    cw_outlook_forget(bus);
    if (before < CW_STATE_ERROR_WARNING && after == CW_STATE_ERROR_WARNING)
        n->stats.error_warning++;
    if (before < CW_STATE_ERROR_PASSIVE && after == CW_STATE_ERROR_PASSIVE)
        n->stats.error_passive++;
    if (after == CW_STATE_BUS_OFF) {
        n->stats.bus_off++;
        bus->restarts[i].off_at = cw_now(bus);
        if (bus->restarts[i].ticks)
            cw_schedule_restart(bus, i, cw_automatic_restart(bus, i));
    }
    tell_state(bus, i, before, after);
}
