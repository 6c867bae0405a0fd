/* SPDX-License-Identifier: MIT
 *
 * quantum_look.c - what nodes with clocks of their own see: levels and edges (T2, T3, T7).
 */
#include "step/quantum.h"

/* Returns the nodes that are on the wire of a node when it looks at a moment. */
static uint64_t wire_of(const cw_bus *bus, unsigned i, cw_span moment)
{
    const cw_timed *t = &bus->timed;
    if (t->one_wire)
        return UINT64_MAX;
    const cw_wires *wires = moment > t->rewired_at ? &t->wires : &t->old_wires;
    for (unsigned w = 0; w < wires->count; w++)
        if (wires->nodes[w] >> i & 1u)
            return wires->nodes[w];
    return cw_node_bit(i);
}

/* Returns the level of a wire that does not swing. */
static bool calm_level(const cw_bus *bus, unsigned i, cw_span moment)
{
    const cw_timed *t = &bus->timed;
    const uint64_t seen = cw_cable_seen(&t->cable, i, moment);
    if (t->disturbances.count == 0)
        return !(seen & wire_of(bus, i, moment));
    return cw_disturbed_wire(&t->disturbances, &t->cable, i, moment, seen,
                             wire_of(bus, i, moment));
}

/* The wire swings after an edge to recessive: then it is dominant once more. */
bool cw_timed_wire(const cw_bus *bus, unsigned i, cw_span moment)
{
    const cw_ringing *r = &bus->timed.ringing[i];
    const cw_span ringing = moment > r->since ? r->now : r->former;
    const cw_span since = moment > r->since ? r->since : r->former_since;
    const bool level = calm_level(bus, i, moment);
    if (level == CW_DOMINANT || ringing == 0 || moment - ringing <= since)
        return level;
    return calm_level(bus, i, moment - ringing / 2) == CW_DOMINANT ||
           calm_level(bus, i, moment - ringing) == CW_RECESSIVE;
}

bool cw_timed_level(const cw_bus *bus, unsigned i, cw_span moment)
{
    const cw_timed *t = &bus->timed;
    if (t->cable.rise_from < moment && cw_timed_is_plain(bus))
        return t->nodes[i].first_arrival < moment ? CW_DOMINANT : CW_RECESSIVE;
    const bool level = cw_timed_wire(bus, i, moment);
    if (t->disturbances.count == 0)
        return level;
    return cw_disturbed_sample(&t->disturbances, &t->cable, i, moment, level);
}

static void set_bit(uint64_t *levels, unsigned i, bool level)
{
    *levels = level ? *levels | cw_node_bit(i) : *levels & ~cw_node_bit(i);
}

/* Returns the wired AND of the levels on each node's wire. */
static uint64_t wired_and(const cw_wires *wires, uint64_t driven)
{
    uint64_t level = UINT64_MAX;
    for (unsigned w = 0; w < wires->count; w++)
        if ((driven & wires->nodes[w]) != wires->nodes[w])
            level &= ~wires->nodes[w];
    return level;
}

void cw_timed_levels_at_source(const cw_bus *bus, cw_levels *levels, uint64_t dominant,
                               cw_span moment)
{
    const cw_disturbances *all = &bus->timed.disturbances;
    levels->driven = cw_disturbed_lines_at_source(all, moment, ~dominant);
    levels->clean = wired_and(&bus->timed.wires, levels->driven);
    levels->wire = cw_disturbed_wires_at_source(all, moment, levels->clean);
}

void cw_timed_levels_at_nodes(const cw_bus *bus, uint64_t *came, uint64_t *sampled, cw_span moment)
{
    const cw_span after = moment + 1; /* T12 */
    *came = *sampled = UINT64_MAX;
    for (unsigned i = 0; i < bus->node_count; i++) {
        set_bit(came, i, cw_timed_wire(bus, i, after));
        set_bit(sampled, i, cw_timed_level(bus, i, after));
    }
}

__attribute__((noinline)) bool cw_timed_find_sample(const cw_bus *bus, unsigned i, cw_span moment)
{
    const cw_bit_timing *timing = &bus->timed.nodes[i].timing;
    const bool level = cw_timed_level(bus, i, moment);
    if (!timing->triple_sampling)
        return level;
    const bool before = cw_timed_level(bus, i, moment - timing->quantum);
    const bool first = cw_timed_level(bus, i, moment - 2 * timing->quantum);
    return level + before + first >= 2;
}

cw_span cw_timed_change(const cw_bus *bus, unsigned i, bool level, cw_span after, cw_span before)
{
    const cw_timed *t = &bus->timed;
    const cw_span first = t->nodes[i].first_arrival;
    if (level == CW_DOMINANT && t->one_wire && t->cable.rise_from < after && first >= after &&
        first < before)
        return first; /* of the rise */
    return cw_cable_change(&t->cable, i, level, after, before, wire_of(bus, i, before));
}

/* Returns the next edge by looking at the end of each quantum. */
static cw_span scan(const cw_bus *bus, unsigned i, cw_span until)
{
    const cw_timed_node *n = &bus->timed.nodes[i];
    bool before = cw_timed_level(bus, i, n->looked);
    for (cw_span moment = n->looked + n->timing.quantum; moment <= until;
         moment += n->timing.quantum) {
        const bool level = cw_timed_level(bus, i, moment);
        if (before == CW_RECESSIVE && level == CW_DOMINANT)
            return moment;
        before = level;
    }
    return CW_SPAN_MAX;
}

/* Returns the look after an arrival: the end of the quantum that it comes in. */
static cw_span look_after(const cw_timed_node *n, cw_span arrival)
{
    return n->begin + (cw_quanta_in(n, arrival - n->begin) + 1) * n->timing.quantum;
}

/* Returns the look that finds the edge of a rise, see cw_cable. Only its first arrival is one. */
static cw_span follow_rise(const cw_timed_node *n, cw_span until)
{
    if (n->first_arrival < n->looked || n->first_arrival >= until)
        return CW_SPAN_MAX;
    const cw_span moment = look_after(n, n->first_arrival);
    return moment <= until ? moment : CW_SPAN_MAX;
}

/* Returns the next edge by looking where dominant levels arrive. */
static cw_span follow_arrivals(const cw_bus *bus, unsigned i, cw_span until)
{
    const cw_timed_node *n = &bus->timed.nodes[i];
    const uint64_t wire = wire_of(bus, i, until);
    cw_span arrival = cw_cable_next_arrival(&bus->timed.cable, i, n->looked, wire);
    while (arrival < until) {
        const cw_span moment = look_after(n, arrival);
        if (moment > until)
            break;
        if (cw_timed_level(bus, i, moment) == CW_DOMINANT &&
            cw_timed_level(bus, i, moment - n->timing.quantum) == CW_RECESSIVE)
            return moment;
        arrival = cw_cable_next_arrival(&bus->timed.cable, i, moment, wire);
    }
    return CW_SPAN_MAX;
}

/* Returns the next edge where the wire swings after recessive ones. */
static cw_span scan_ringing(const cw_bus *bus, unsigned i, cw_span until)
{
    const cw_cable *cable = &bus->timed.cable;
    const cw_span ringing = cw_timed_longest_ringing(&bus->timed, i);
    const bool calm = cable->newest + cable->longest + ringing < bus->timed.nodes[i].looked;
    return calm ? CW_SPAN_MAX : scan(bus, i, until);
}

cw_span cw_timed_next_edge(const cw_bus *bus, unsigned i, cw_span until)
{
    const cw_timed_node *n = &bus->timed.nodes[i];
    const bool rewired = !bus->timed.one_wire && n->looked <= bus->timed.rewired_at;
    if (bus->timed.disturbances.count || rewired)
        return scan(bus, i, until);
    if (bus->timed.rings && cw_timed_longest_ringing(&bus->timed, i) > 0)
        return scan_ringing(bus, i, until);
    if (n->last_arrival < n->looked)
        return CW_SPAN_MAX;
    if (bus->timed.one_wire && bus->timed.cable.rise_from < n->looked)
        return follow_rise(n, until);
    return follow_arrivals(bus, i, until);
}
