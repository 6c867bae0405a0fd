/* SPDX-License-Identifier: MIT
 *
 * quantum_rate.c - the two rates of nodes with clocks of their own (D10 to D13), and how long a bit
 * time of the bus lasts meanwhile.
 *
 * A bit time is a bit of the wire where all nodes agree in their timings, also in the data phase.
 * So a bus that goes bit by bit, and one that leaps, stop at the same ticks. While bits of nodes do
 * not begin together, a bit time is as long as a nominal bit. It ends earlier where they come
 * together again.
 */
#include "step/quantum.h"

#include "mac/late.h"

/* ---- One node -------------------------------------------------------------------------------- */

static cw_timed_rates *rates_of(cw_bus *bus, unsigned i)
{
    return &bus->timed.rates[i];
}

/* Goes on with a bit at its sample point as if it had been at the other rate since its start. */
static void change_rate(cw_timed_node *n, cw_timed_rates *r, cw_span moment)
{
    r->fast = !r->fast;
    cw_timed_set_timing(n, cw_timing_at(r, r->fast));
    cw_pcs_change_rate(&n->pcs, &n->timing);
    n->begin = moment - n->to_sample;
}

void cw_timed_follow_rate(cw_bus *bus, unsigned i, cw_span moment)
{
    cw_timed_node *n = &bus->timed.nodes[i];
    cw_timed_rates *r = rates_of(bus, i);
    if (r->fast != cw_mac_is_fast(&bus->nodes[i].mac))
        change_rate(n, r, moment);
    n->next_begin = n->begin + n->pcs.end_at * n->timing.quantum;
}

void cw_timed_begin_at_rate(cw_bus *bus, unsigned i)
{
    cw_timed_rates *r = rates_of(bus, i);
    if (!r->fast || cw_mac_is_fast(&bus->nodes[i].mac))
        return;
    r->fast = false;
    cw_timed_set_timing(&bus->timed.nodes[i], &r->nominal);
}

void cw_timed_enter_rate(cw_bus *bus, unsigned i)
{
    cw_timed_rates *r = rates_of(bus, i);
    r->fast = cw_mac_is_fast(&bus->nodes[i].mac);
    cw_late_forget(&r->late);
    if (r->fast && cw_mac_is_sending(&bus->nodes[i].mac))
        cw_late_measured(&r->late, 0); /* so far its bits were those of all nodes */
    cw_timed_set_timing(&bus->timed.nodes[i], cw_timing_at(r, r->fast));
}

/* The node goes on at its present rate. The bit timings of the new bus come with its next bit. */
void cw_timed_take_over_rates(cw_bus *bus, unsigned i, const cw_bus *old, unsigned from)
{
    cw_timed_rates *r = rates_of(bus, i);
    r->next = r->given;
    r->fast = cw_mac_is_fast(&bus->nodes[i].mac);
    if (old->timed.rates)
        r->fast = old->timed.rates[from].fast;
}

/* Measures the delay of the own edge to res, by the clocks up to a sample point. */
static void measure(cw_bus *bus, unsigned i, cw_span until)
{
    cw_late_compare *late = &rates_of(bus, i)->late;
    cw_span moment;
    while (cw_late_measures(late, &bus->nodes[i].mac, &moment) && moment <= until)
        cw_late_measure(late, cw_timed_level(bus, i, moment));
    rates_of(bus, i)->stats.tdcv = cw_late_delay(late);
}

__attribute__((noinline)) void cw_timed_compare_late(cw_bus *bus, unsigned i, cw_span until)
{
    cw_mac *m = &bus->nodes[i].mac;
    cw_late_compare *late = &rates_of(bus, i)->late;
    cw_error_type error;
    cw_span moment;
    measure(bus, i, until);
    while (cw_late_is_due(late, m, &moment) && moment <= until) {
        const bool level = cw_timed_level(bus, i, moment);
        if (bus->timed.marking)
            cw_mark_put(bus, CW_MARK_LATE_SAMPLE, i, moment, level, 0);
        if (cw_late_compare_next(late, level, &error))
            cw_mac_note_late_error(m, error);
    }
}

/* ---- Bits that all nodes have in common ------------------------------------------------------ */

/* Returns true when a node is at the data rate after its next sample point, if it samples what it
 * sends. */
static bool is_fast_after_sample(const cw_mac *m)
{
    return cw_mac_is_fast(m) ? !cw_mac_ends_data_phase(m) : cw_mac_begins_data_phase(m);
}

/* Does the same by the levels of the wire, if no fault comes. */
static bool will_be_fast(const cw_bus *bus, const cw_mac *m)
{
    return is_fast_after_sample(m) && (cw_mac_is_fast(m) || bus->timed.cable.dominant == 0);
}

/* Returns the end of the bit of a node that begins at a moment, or has begun then. */
static cw_span end_of_bit(const cw_bus *bus, unsigned i, cw_span begin)
{
    const cw_timed_node *n = &bus->timed.nodes[i];
    const cw_timed_rates *r = &bus->timed.rates[i];
    const bool fast = will_be_fast(bus, &bus->nodes[i].mac);
    const unsigned sample_at = n->ahead ? n->begun.sample_at : n->pcs.sample_at;
    const unsigned end_at = n->ahead ? n->begun.end_at : n->pcs.end_at;
    if (fast == r->fast)
        return begin + end_at * n->timing.quantum;
    const cw_bit_timing *after = cw_timing_at(r, fast);
    const unsigned rest = cw_bit_timing_quanta(after) - cw_bit_timing_sample_at(after);
    return begin + sample_at * n->timing.quantum + rest * after->quantum;
}

cw_span cw_timed_expected_end(const cw_bus *bus, unsigned i)
{
    return end_of_bit(bus, i, bus->timed.nodes[i].begin);
}

cw_span cw_timed_bit_length(const cw_bus *bus, unsigned i)
{
    const cw_timed_rates *r = &bus->timed.rates[i];
    const bool after = is_fast_after_sample(&bus->nodes[i].mac);
    const cw_span quantum = bus->timed.bit_time / cw_bit_timing_quanta(&r->nominal);
    const cw_span data = r->given.data_brp ? cw_data_quantum(quantum, &r->given) : quantum;
    const cw_bit_timing *begins = cw_timing_at(r, r->fast), *ends = cw_timing_at(r, after);
    const unsigned rest = cw_bit_timing_quanta(ends) - cw_bit_timing_sample_at(ends);
    return cw_bit_timing_sample_at(begins) * (r->fast ? data : quantum) +
           rest * (after ? data : quantum);
}

/* Returns true when a node begins a bit now. All do, when the bus is about to leave the grid. */
static bool begins_now(const cw_bus *bus, unsigned i, cw_span now)
{
    const cw_timed_node *n = &bus->timed.nodes[i];
    return !bus->timed.active || ((n->ahead || n->pcs.sampled) && n->next_begin == now);
}

/* Returns the end of the bit in which a node is, which it has begun. */
static cw_span end_of_present(const cw_bus *bus, unsigned i, cw_span now)
{
    const cw_timed_node *n = &bus->timed.nodes[i];
    if (n->ahead && n->next_begin <= now)
        return end_of_bit(bus, i, n->next_begin);
    return n->ahead || n->pcs.sampled ? n->next_begin : end_of_bit(bus, i, n->begin);
}

/* Returns true when nobody can see when the bits of a node begin: it neither drives nor samples the
 * wire. */
static bool quantum_rate_is_away(const cw_mac *m)
{
    const bool rests = m->phase == CW_MAC_IDLE && (m->modes & CW_MODE_LOOPBACK); /* M15 */
    return m->phase == CW_MAC_OFF || m->phase == CW_MAC_BUS_OFF || m->phase == CW_MAC_ASLEEP ||
           rests;
}

cw_span cw_timed_common_begin(const cw_bus *bus)
{
    const cw_span now = cw_moment_of(bus, cw_now(bus));
    cw_span common = CW_SPAN_MAX;
    for (unsigned i = 0; i < bus->node_count; i++) {
        if (quantum_rate_is_away(&bus->nodes[i].mac))
            continue;
        const cw_span next = begins_now(bus, i, now) ? now : end_of_present(bus, i, now);
        if (common != CW_SPAN_MAX && next != common)
            return CW_SPAN_MAX;
        common = next;
    }
    return common;
}

bool cw_timed_all_begin(const cw_bus *bus)
{
    const cw_span now = cw_moment_of(bus, cw_now(bus));
    for (unsigned i = 0; i < bus->node_count; i++)
        if (!begins_now(bus, i, now))
            return false;
    return true;
}

bool cw_timed_begins_together(const cw_bus *bus)
{
    const cw_span now = cw_moment_of(bus, cw_now(bus));
    for (unsigned i = 0; i < bus->node_count; i++) {
        const bool begun = bus->timed.nodes[i].begin == now;
        if (!quantum_rate_is_away(&bus->nodes[i].mac) && !begins_now(bus, i, now) && !begun)
            return false;
    }
    return true;
}

/* Lets a node that is away begin a bit with the others. Nobody can see when its bits begin. */
static void align(cw_bus *bus, unsigned i, cw_span moment)
{
    cw_timed_node *n = &bus->timed.nodes[i];
    if (end_of_present(bus, i, cw_moment_of(bus, cw_now(bus))) == moment)
        return;
    cw_agenda_remove(&bus->timed.agenda, i);
    cw_timed_begin_at_rate(bus, i);
    n->ahead = false;
    n->pcs.sampled = true;
    n->pcs.synchronised = false;
    n->next_begin = moment;
    cw_agenda_put(&bus->timed.agenda, i, CW_BEGINS, moment);
}

/* Lets bits of nodes that are away begin with those of the others. */
static void align_away(cw_bus *bus, cw_span moment)
{
    for (unsigned i = 0; i < bus->node_count; i++)
        if (quantum_rate_is_away(&bus->nodes[i].mac))
            align(bus, i, moment);
}

/* A node that is away samples nothing. When it comes back, it has last seen what all have. */
__attribute__((noinline)) void cw_timed_show_wire(cw_bus *bus)
{
    for (unsigned i = 0; i < bus->node_count; i++)
        if (quantum_rate_is_away(&bus->nodes[i].mac))
            bus->timed.nodes[i].pcs.last_sample = bus->wire;
}

/* ---- The end of the bit that begins now ------------------------------------------------------ */

/* Returns a node's controller, the common one if it shares it. */
static const cw_mac *controller_of(const cw_bus *bus, unsigned i)
{
    return bus->followers >> i & 1u ? &bus->common : &bus->nodes[i].mac;
}

/* Returns the level of all nodes together in the bit that begins now. A frame that begins with it
 * comes too late to keep BRS from its level. */
static bool level_from(const cw_bus *bus, cw_span now)
{
    for (unsigned i = 0; i < bus->node_count; i++) {
        const bool level = begins_now(bus, i, now) ? cw_mac_level(controller_of(bus, i))
                                                   : bus->timed.nodes[i].driven;
        if (level == CW_DOMINANT)
            return CW_DOMINANT;
    }
    return CW_RECESSIVE;
}

/* Returns the bit timing of a node at one of its rates, in a bit that begins now. */
static cw_bit_timing coming_timing(const cw_bus *bus, unsigned i, bool fast)
{
    const cw_timed_rates *r = &bus->timed.rates[i];
    const cw_bit_timing *nominal = &bus->timed.next_timings[i];
    if (!bus->timed.nodes[i].retimed)
        return *cw_timing_at(r, fast);
    return fast ? cw_data_bit_timing(&r->next, nominal) : *nominal;
}

/* Returns the length of a bit of a node that begins now. level: of the wire, if no fault comes. */
static cw_span length_from_now(const cw_bus *bus, unsigned i, bool level)
{
    const cw_mac *m = controller_of(bus, i);
    const bool begins_fast = cw_mac_is_fast(m) &&
                             (!bus->timed.active || bus->timed.rates[i].fast);
    const bool ends_fast = is_fast_after_sample(m) && (cw_mac_is_fast(m) || level);
    const cw_bit_timing begins = coming_timing(bus, i, begins_fast);
    if (begins_fast == ends_fast)
        return cw_bit_timing_quanta(&begins) * begins.quantum;
    const cw_bit_timing ends = coming_timing(bus, i, ends_fast);
    const unsigned rest = cw_bit_timing_quanta(&ends) - cw_bit_timing_sample_at(&ends);
    return cw_bit_timing_sample_at(&begins) * begins.quantum + rest * ends.quantum;
}

/* Returns the moment at which the bits of all nodes that begin now, or have begun before, end
 * together; CW_SPAN_MAX: there is none. */
static cw_span common_end(const cw_bus *bus, cw_span now)
{
    const bool level = level_from(bus, now);
    cw_span common = CW_SPAN_MAX;
    for (unsigned i = 0; i < bus->node_count; i++) {
        if (quantum_rate_is_away(controller_of(bus, i)))
            continue;
        const cw_span end = begins_now(bus, i, now) ? now + length_from_now(bus, i, level)
                                                    : end_of_present(bus, i, now);
        if (common != CW_SPAN_MAX && end != common)
            return CW_SPAN_MAX;
        common = end;
    }
    return common;
}

/* Returns the present moment; the origin is now, when the bus is about to leave the grid. */
static cw_span present(const cw_bus *bus)
{
    return bus->timed.active ? cw_moment_of(bus, cw_now(bus)) : 0;
}

__attribute__((noinline)) cw_span cw_timed_common_bit(const cw_bus *bus)
{
    const cw_span now = present(bus);
    const cw_span end = bus->timed.uniform ? common_end(bus, now) : CW_SPAN_MAX;
    const bool usual = end != CW_SPAN_MAX && end % CW_TICK == 0 && end - now <= bus->timed.bit_time;
    return usual ? end - now : 0;
}

void cw_timed_set_bit(cw_bus *bus, cw_span common)
{
    bus->time.short_by = common ? (uint32_t)((bus->timed.bit_time - common) / CW_TICK) : 0;
    if (common)
        align_away(bus, cw_moment_of(bus, cw_bit_end(bus)));
}

/* Returns true when a bit of the data rate is there or near. */
static bool may_be_fast(const cw_mac *m)
{
    return cw_mac_is_fast(m) || cw_mac_comes_to_data_phase(m);
}

bool cw_is_data_phase(const cw_bus *bus)
{
    if (bus->frame_step.active)
        return false;
    bool found = bus->followers && may_be_fast(&bus->common);
    for (uint64_t rest = cw_single_nodes(bus); !found && rest; rest &= rest - 1)
        found = may_be_fast(&bus->nodes[cw_lowest_node(rest)].mac);
    return found || cw_fast_nodes(bus);
}

uint64_t cw_short_bit_end(const cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    if (step->active && step->fast.to)
        return cw_frame_step_tick(bus, step->at + 1u);
    const bool divided = !step->active && cw_is_off_grid(bus);
    const cw_span common = divided ? cw_timed_common_bit(bus) : 0;
    return common ? cw_now(bus) + (uint64_t)(common / CW_TICK) : cw_wire_tick(&bus->time, 1);
}
