/* SPDX-License-Identifier: MIT
 *
 * rules.c - the rules of a bus: adds and removes them, and links them to the bus.
 */
#include "bus/bus_private.h"

/* ---- Effects of rules on the bus ------------------------------------------------------------- */

static void drop(cw_bus *bus, unsigned i, cw_side side, const cw_frame *frame, uint64_t tick)
{
    cw_push_drop(bus, i, side, frame, CW_DROP_FAULT, tick);
}

/* Counts a frame that rules have made, by its way. */
static void count_made(cw_bus *bus, unsigned i, cw_side side)
{
    cw_node_stats *stats = &bus->nodes[i].stats;
    if (side == CW_SIDE_TX)
        stats->made_by_rules++;
    else
        stats->rx_made_by_rules++;
}

/* Returns true when a frame handed in now would not be dropped. */
static bool can_take(const cw_bus *bus, unsigned i)
{
    return cw_refusal(bus, i) == CW_DROP_COUNT;
}

/* Returns the time that load rules count, in bits, or in ticks where bits may be shorter. */
static uint64_t time_so_far(const cw_bus *bus, uint64_t *busy)
{
    const uint64_t unit = bus->load.unit, saved = bus->timed.short_ticks;
    *busy = cw_busy_bits_so_far(bus) * unit - saved;
    return cw_bits_so_far(bus) * unit - saved - bus->early_ticks;
}

/* A controller off the bus cannot tell, so the wire itself is asked. */
static bool is_idle(const cw_bus *bus, unsigned i)
{
    const cw_mac *m = cw_mac_of(bus, i);
    return m->phase == CW_MAC_IDLE ||
           (!cw_mac_is_on_bus(m) && bus->recessive_bits >= CW_INTEGRATION_BITS);
}

void cw_link_rules(cw_bus *bus, uint64_t seed)
{
    static const cw_rule_effects effects = {
        .report_hit = cw_push_fault,
        .control = cw_control_nodes,
        .rewire = cw_apply_topology,
        .retime = cw_retime_quantum,
        .queue = cw_queue_frame,
        .hand_out = cw_push_rx,
        .drop = drop,
        .count_made = count_made,
        .can_take = can_take,
        .time = time_so_far,
        .is_idle = is_idle,
        .bit_length = cw_timed_bit_length,
        .end_of_bit = cw_timed_end_of_bit,
    };
    bus->rules.bus = (cw_rule_bus){.time = &bus->time,
                                   .node_count = bus->node_count,
                                   .all = bus->all,
                                   .asleep = &bus->asleep,
                                   .seed = seed, .fd = bus->fd,
                                   .unit = bus->load.unit,
                                   .divided = bus->timed.rates != NULL,
                                   .error_flag = &bus->error_flag,
                                   .overload_flag = &bus->overload_flag,
                                   .wires = bus->groups,
                                   .wire_count = &bus->group_count,
                                   .effects = &effects,
                                   .self = bus};
    for (unsigned i = 0; i < bus->node_count; i++)
        bus->rules.bus.macs[i] = &bus->nodes[i].mac;
}

/* ---- Rules come and go ----------------------------------------------------------------------- */

/* Returns true when each node that a rule on settings names can have them. */
static bool settings_fit(const cw_bus *bus, const cw_rule *r)
{
    for (unsigned i = 0; r->action == CW_ACTION_SET && i < bus->node_count; i++)
        if ((r->nodes & cw_node_bit(i)) && !cw_settings_valid(bus, i, &r->settings))
            return false;
    return true;
}

cw_status cw_bus_add_rule(cw_bus *bus, unsigned *index, const cw_rule *rule)
{
    unsigned place;
    const bool fits = settings_fit(bus, rule) && (!bus->lean || cw_rule_keeps_setup(rule));
    cw_status status = fits ? cw_rules_may_add(&bus->rules, &place, rule) : CW_INVALID;
    if (status != CW_OK)
        return status;
    cw_wake_controllers(bus); /* a frame step in progress relies on the rules from before */
    cw_rules_add(&bus->rules, place, rule);
    cw_outlook_forget(bus);
    cw_ring_find_enough(bus);
    cw_find_longest(bus);
    *index = place;
    return CW_OK;
}

cw_status cw_bus_stop_rule(cw_bus *bus, unsigned index)
{
    if (!cw_rules_has(&bus->rules, index))
        return CW_INVALID;
    cw_wake_controllers(bus);
    cw_rule_end_action(&bus->rules, index);
    return CW_OK;
}

/* Disowns waiting frames of the rule's traffic, so that they do not count for a later rule. */
static void disown_frames(cw_bus *bus, unsigned rule)
{
    for (unsigned i = 0; i < bus->node_count; i++) {
        cw_queue *q = &bus->nodes[i].queue;
        for (unsigned k = 0; k < q->count; k++)
            if (cw_queue_at(q, cw_queue_nth(q, k))->source == rule + 1)
                cw_queue_at(q, cw_queue_nth(q, k))->source = 0;
    }
}

cw_status cw_bus_clear_rule(cw_bus *bus, unsigned index)
{
    if (!cw_rules_has(&bus->rules, index))
        return CW_INVALID;
    cw_wake_controllers(bus);
    disown_frames(bus, index);
    cw_rules_remove(&bus->rules, index);
    cw_outlook_forget(bus);
    cw_ring_find_enough(bus);
    cw_find_longest(bus);
    return CW_OK;
}

cw_status cw_bus_fire_rule(cw_bus *bus, unsigned index)
{
    if (!cw_rules_has(&bus->rules, index))
        return CW_INVALID;
    return cw_rules_arm(&bus->rules, index) ? CW_OK : CW_REFUSED;
}

uint64_t cw_bus_rules_until(const cw_bus *bus)
{
    return cw_rules_until(&bus->rules);
}

cw_status cw_rule_get_stats(const cw_bus *bus, unsigned rule, cw_rule_stats *stats)
{
    if (!cw_rules_has(&bus->rules, rule))
        return CW_INVALID;
    *stats = cw_rules_get_stats(&bus->rules, rule);
    const unsigned ahead = cw_match_ahead(bus, rule);
    stats->matches -= ahead;
    stats->misses -= ahead;
    return CW_OK;
}
