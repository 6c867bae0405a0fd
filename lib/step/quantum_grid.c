/* SPDX-License-Identifier: MIT
 *
 * quantum_grid.c - off the grid of common bits, and back to it.
 */
#include "step/quantum.h"

#include "mac/late.h"

#define REBASE_AFTER (UINT64_C(1) << 28) /* ticks; moments stay below 2^61 */

/* Returns the level that a controller has put onto the wire last. */
static bool last_driven(const cw_mac *mac)
{
    return mac->driven || (mac->modes & (CW_MODE_LISTEN_ONLY | CW_MODE_LOOPBACK)) ? CW_RECESSIVE
                                                                                  : CW_DOMINANT;
}

/* Notes that all edges on the line, which may be still under way, are not a rise that the node can
 * follow. */
static void forget_arrivals(const cw_cable *cable, cw_timed_node *n)
{
    n->first_arrival = n->last_arrival = cw_cable_last_arrival(cable);
}

/* Returns the level of the last bit. A frame that is passed as a whole does not keep it. */
static bool last_level(const cw_bus *bus)
{
    return bus->stats.bits == 0 || bus->recessive_bits > 0;
}

/* Lets a node begin a bit at a moment. */
static void enter_node(cw_bus *bus, unsigned i, cw_span moment)
{
    cw_timed_node *n = &bus->timed.nodes[i];
    const bool retimed = n->retimed;
    cw_timed_retime(bus, i);
    if (retimed && bus->tt)
        cw_tt_retime(bus, i, cw_instant_after(bus->timed.epoch, moment));
    if (bus->timed.rates)
        cw_timed_enter_rate(bus, i);
    n->begin = n->next_begin = n->looked = moment;
    n->driven = last_driven(&bus->nodes[i].mac);
    n->ahead = false;
    n->report.what = 0;
    n->sync_count = 0;
    n->pcs.sampled = true;
    cw_timed_follow_ears(n, &bus->nodes[i].mac);
    n->pcs.last_sample = last_level(bus);
    forget_arrivals(&bus->timed.cable, n);
    if (n->driven == CW_DOMINANT)
        bus->timed.cable.dominant |= cw_node_bit(i);
    cw_agenda_put(&bus->timed.agenda, i, CW_BEGINS, moment);
}

/* Forgets all edges and all that was to come. */
static void quantum_grid_clear(cw_timed *t, uint64_t epoch)
{
    cw_timed_begin_ringing(t);
    t->active = true;
    t->touched = 0;
    t->epoch = epoch;
    cw_cable_clear(&t->cable);
    t->disturbances.count = 0;
    t->moment = 0;
    cw_agenda_clear(&t->agenda);
}

void cw_timed_enter(cw_bus *bus)
{
    cw_wake_controllers(bus);
    cw_leave(bus, bus->all);
    quantum_grid_clear(&bus->timed, cw_now(bus));
    cw_timed_begin_wires(bus);
    for (unsigned i = 0; i < bus->node_count; i++)
        enter_node(bus, i, 0);
}

/* ---- Taking over ----------------------------------------------------------------------------- */

/* The node goes on in the middle of its bit, and gets its new bit timing with the next one. */
static void take_over_node(cw_bus *bus, unsigned i, const cw_bus *old, unsigned from)
{
    cw_timed_node *n = &bus->timed.nodes[i];
    const cw_agenda_entry *e = cw_agenda_of(&old->timed.agenda, from);
    const cw_bit_timing timing = n->timing;
    *n = old->timed.nodes[from];
    if (bus->timed.rates)
        cw_timed_take_over_rates(bus, i, old, from);
    forget_arrivals(&bus->timed.cable, n);
    if (n->driven == CW_DOMINANT)
        bus->timed.cable.dominant |= cw_node_bit(i);
    cw_agenda_put(&bus->timed.agenda, i, cw_agenda_what(e), e->moment);
    cw_timed_settle(&bus->timed, i);
    bus->timed.next_timings[i] = timing;
    n->retimed = true;
}

/* Takes over the edges that may still be under way. The nodes have new numbers. */
static void take_over_edges(cw_cable *cable, const cw_cable *old, const uint8_t *to)
{
    const unsigned kept = old->count < old->capacity ? (unsigned)old->count : old->capacity;
    for (unsigned n = kept; n-- > 0;) {
        cw_edge edge = old->edges[(old->count - 1 - n) & (old->capacity - 1)];
        edge.node = to[edge.node];
        edge.ways = cable->ways; /* as if they had come on the new line */
        if (edge.node != CW_NO_NODE)
            cw_cable_put(cable, &edge);
    }
    cable->rise_from = CW_SPAN_MAX; /* nodes may be dominant without a recent edge */
}

/* The nodes are on the wires of the old bus, until the next bit time begins. */
static void take_over_wires(cw_bus *bus, const cw_timed *old, const uint8_t *from)
{
    cw_timed *t = &bus->timed;
    t->wires = (cw_wires){.count = old->wires.count};
    for (unsigned i = 0; i < bus->node_count; i++)
        for (unsigned w = 0; w < old->wires.count; w++)
            if (from[i] == CW_NO_NODE ? w == 0 : old->wires.nodes[w] >> from[i] & 1u)
                t->wires.nodes[w] |= cw_node_bit(i);
    t->old_wires = t->wires;
    t->rewired_at = old->rewired_at;
    t->one_wire = old->wires.count == 1;
}

void cw_timed_take_over(cw_bus *bus, const cw_bus *old, const uint8_t *from)
{
    uint8_t to[CW_NODES_MAX];
    if (!old->timed.active)
        return;
    for (unsigned i = 0; i < CW_NODES_MAX; i++)
        to[i] = CW_NO_NODE;
    for (unsigned i = 0; i < bus->node_count; i++)
        if (from[i] != CW_NO_NODE)
            to[from[i]] = (uint8_t)i;
    quantum_grid_clear(&bus->timed, old->timed.epoch);
    for (unsigned i = 0; i < bus->node_count; i++) /* in the middle of their bits */
        if (from[i] != CW_NO_NODE && (old->timed.touched >> from[i] & 1u))
            bus->timed.touched |= cw_node_bit(i);
    bus->timed.moment = old->timed.moment;
    take_over_wires(bus, &old->timed, from);
    take_over_edges(&bus->timed.cable, &old->timed.cable, to);
    for (unsigned i = 0; i < bus->node_count; i++)
        if (from[i] != CW_NO_NODE)
            take_over_node(bus, i, old, from[i]);
        else
            enter_node(bus, i, cw_moment_of(bus, cw_now(bus)));
    cw_timed_alert(bus); /* edges under way come at other times on another line */
}

/* ---- Back to the grid ------------------------------------------------------------------------ */

/* Returns true when a node begins a bit at a moment, on time: not with an earlier edge. Nothing
 * is left to be done before the moment. */
static bool begins_at(const cw_timed *t, unsigned i, cw_span moment)
{
    return t->nodes[i].pcs.sampled && t->nodes[i].next_begin == moment;
}

/* Returns true when all nodes begin a bit at a moment. */
static bool all_begin_at(const cw_timed *t, cw_span moment)
{
    for (unsigned i = 0; i < t->cable.node_count; i++)
        if (!begins_at(t, i, moment))
            return false;
    return true;
}

void cw_timed_leave(cw_bus *bus)
{
    cw_timed *t = &bus->timed;
    const cw_span now = cw_moment_of(bus, cw_now(bus));
    if (t->requested || !t->uniform || bus->rules.timed_rules || t->disturbances.count ||
        t->rings)
        return;
    if (t->cable.newest + t->cable.longest >= now || !all_begin_at(t, now))
        return;
    t->active = t->rates && cw_is_data_phase(bus);
    if (bus->rules.awake_count && !t->active)
        cw_rules_emit_rest(&bus->rules);
}

/* The bus may go back to the grid when all clocks agree. Bits of two rates begin together. */
void cw_clean_settle(cw_bus *bus)
{
    const cw_timed *t = &bus->timed;
    if (!t->clean.parked || (!t->rates && (!t->uniform || t->requested)))
        return;
    cw_clean_resume(bus);
    cw_timed_leave(bus);
}

void cw_timed_rebase(cw_bus *bus)
{
    cw_timed *t = &bus->timed;
    const uint64_t ticks = cw_now(bus) - t->epoch;
    if (ticks < REBASE_AFTER)
        return;
    const cw_span by = (cw_span)ticks * CW_TICK;
    t->epoch = cw_now(bus);
    cw_cable_rebase(&t->cable, by);
    cw_disturb_rebase(&t->disturbances, by);
    cw_agenda_rebase(&t->agenda, by);
    cw_moment_rebase(&t->moment, by); /* it is old while nodes are parked */
    cw_timed_rebase_wires(t, by);
    cw_timed_rebase_ringing(t, by);
    for (unsigned i = 0; i < bus->node_count; i++) {
        cw_moment_rebase(&t->nodes[i].begin, by);
        cw_moment_rebase(&t->nodes[i].next_begin, by);
        cw_moment_rebase(&t->nodes[i].looked, by);
        cw_moment_rebase(&t->nodes[i].first_arrival, by);
        cw_moment_rebase(&t->nodes[i].last_arrival, by);
        if (t->counts)
            cw_moment_rebase(&t->records[i].sampled_at, by);
        if (t->rates)
            cw_late_rebase(&t->rates[i].late, by);
    }
    cw_clean_rebase(bus, by);
}
