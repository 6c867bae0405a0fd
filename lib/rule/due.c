/* SPDX-License-Identifier: MIT
 *
 * due.c - what rules have to do at a tick.
 */
#include "rule/private.h"

static void arm(cw_bus *bus, unsigned rule)
{
    cw_fault *f = cw_fault_at(bus, rule);
    cw_fault_take_arming(f, cw_now(bus));
    if (f->rule.trigger == CW_TRIGGER_ARMED)
        cw_fault_fire(bus, rule);
}

/* One rule at the present tick; returns whether anything was due. */
static bool run_rule(cw_bus *bus, unsigned rule)
{
    cw_fault *f = cw_fault_at(bus, rule);
    bool ends = f->active && f->active_until <= cw_now(bus);
    bool acts = f->to_act;
    bool fires = f->fire_at <= cw_now(bus);
    bool arms = cw_fault_next_arming(f) <= cw_now(bus);
    if (ends)
        cw_fault_end_action(bus, rule);
    f->to_act = false;
    if (acts)
        cw_fault_act(bus, rule);
    if (fires) {
        f->fire_at = CW_NEVER;
        cw_fault_fire(bus, rule);
    }
    if (arms)
        arm(bus, rule);
    return ends || acts || fires || arms;
}

static void find_next_due(cw_bus *bus)
{
    uint64_t next = CW_NEVER;
    for (unsigned rule = 0; rule < bus->faults.count; rule++) {
        const cw_fault *f = cw_fault_at(bus, rule);
        if (!f->used)
            continue;
        next = cw_least(next, cw_least(f->fire_at, cw_fault_next_arming(f)));
        if (f->active)
            next = cw_least(next, cw_least(f->active_until, f->next_at));
    }
    bus->faults.next_due = cw_least(next, cw_fault_next_held(bus));
}

/* Until nothing is due any more: rules may arm each other at the same tick, each one once. */
static void run_rules(cw_bus *bus)
{
    bool again = true;
    while (again) {
        again = false;
        bus->work += 1 + bus->faults.count / CW_RULES_OF_A_PIECE;
        for (unsigned rule = 0; rule < bus->faults.count; rule++)
            if (cw_fault_at(bus, rule)->used)
                again = run_rule(bus, rule) || again;
    }
    if (bus->faults.rewired)
        cw_fault_apply_topology(bus);
}

static bool is_traffic(const cw_fault *f)
{
    return f->used && f->active && f->does->kind == CW_KIND_TRAFFIC;
}

/* One node after the other: a drop of an earlier one would have to go before all events of later
 * ones, of which there may be thousands. To the queues it is all the same. */
static void run_traffic(cw_bus *bus)
{
    uint64_t nodes = 0;
    for (unsigned rule = 0; rule < bus->faults.count; rule++)
        if (is_traffic(cw_fault_at(bus, rule)))
            nodes |= cw_node_bit(cw_fault_at(bus, rule)->rule.node);
    for (; nodes; nodes &= nodes - 1)
        for (unsigned rule = 0; rule < bus->faults.count; rule++)
            if (cw_fault_at(bus, rule)->rule.node == cw_lowest_node(nodes) &&
                is_traffic(cw_fault_at(bus, rule)))
                cw_fault_at(bus, rule)->does->traffic(bus, rule);
}

void cw_fault_run_due(cw_bus *bus)
{
    if (bus->faults.next_due > cw_now(bus) && bus->faults.awake_count == 0)
        return;
    bool due = bus->faults.next_due <= cw_now(bus);
    if (due) {
        run_rules(bus);
        cw_fault_release_held(bus);
    }
    if (due)
        run_traffic(bus);
    bool steady = !due && bus->faults.traffic_rules > 0;
    for (unsigned i = 0; steady && i < bus->faults.awake_count; i++)
        if (is_traffic(cw_fault_at(bus, bus->faults.awake[i])))
            cw_fault_at(bus, bus->faults.awake[i])->does->traffic(bus, bus->faults.awake[i]);
    if (due)
        find_next_due(bus);
}
