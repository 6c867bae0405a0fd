/* SPDX-License-Identifier: MIT
 *
 * quantum_rest.c - bit times in which all nodes rest, each by its own clock.
 *
 * A node at rest does the same in each of its bits, and nobody sees it. So it goes on by whole bits
 * of its own at once.
 */
#include "step/quantum.h"

#include "mac/mac.h"

#define LEAST_BITS 4u /* fewer are not worth it */

/* Returns true when the controller does nothing until something comes in. waits: it has a frame. An
 * offer that is over is dropped, with a report. */
static bool rests(const cw_mac *mac, bool waits)
{
    if (mac->offered || (waits && cw_mac_can_start(mac)))
        return false;
    return mac->phase == CW_MAC_IDLE || mac->phase == CW_MAC_OFF ||
           mac->phase == CW_MAC_BUS_OFF || mac->phase == CW_MAC_ASLEEP;
}

/* Returns true when the slot of a node is open. It ends at the start of a bit of the node. */
static bool has_open_slot(const cw_bus *bus)
{
    for (unsigned i = 0; bus->tt && i < bus->node_count; i++)
        if (bus->tt[i].deadline != CW_NEVER)
            return true;
    return false;
}

/* Returns true when the node is in a bit like all that follow: no edge has come since it began. One
 * that is ahead of the bus has ended such a bit. */
static bool is_periodic(const cw_bus *bus, unsigned i)
{
    const cw_cable *cable = &bus->timed.cable;
    const cw_timed_node *n = &bus->timed.nodes[i];
    return rests(&bus->nodes[i].mac, bus->waiting >> i & 1u) && !n->retimed &&
           !n->pcs.synchronised && (!n->ahead || !has_open_slot(bus)) &&
           n->pcs.last_sample == CW_RECESSIVE && n->report.what == 0 &&
           n->sync_count == 0 && n->pcs.sample_at == cw_bit_timing_sample_at(&n->timing) &&
           n->pcs.end_at == cw_bit_timing_quanta(&n->timing) &&
           cable->newest + cable->longest + cw_timed_longest_ringing(&bus->timed, i) < n->looked;
}

/* Returns true when no node that is parked can begin a frame. */
static bool all_stay_parked(const cw_bus *bus)
{
    for (uint64_t rest = bus->waiting; rest; rest &= rest - 1)
        if (cw_mac_can_start(&bus->nodes[cw_lowest_node(rest)].mac))
            return false;
    return true;
}

/* Returns true when no node, rule or edge changes anything in the bits to come. */
static bool all_rest(const cw_bus *bus)
{
    const cw_timed *t = &bus->timed;
    if (!t->active || t->cable.dominant || t->rings_before || t->touched ||
        t->disturbances.count || bus->rules.awake_count || bus->stepping || bus->watching)
        return false;
    if (t->clean.parked)
        return all_stay_parked(bus);
    for (unsigned i = 0; i < bus->node_count; i++)
        if (!is_periodic(bus, i))
            return false;
    return !cw_fast_nodes(bus) &&
           (cw_timed_is_straight(bus) || cw_timed_common_begin(bus) == CW_SPAN_MAX);
}

static cw_span bit_of(const cw_timed_node *n)
{
    return n->timing.quantum * cw_bit_timing_quanta(&n->timing);
}

/* Returns the bit times that the longest bit of a node takes part in. */
static uint64_t bit_times_of_longest(const cw_bus *bus)
{
    cw_span longest = bus->timed.bit_time;
    for (unsigned i = 0; i < bus->node_count; i++)
        if (bit_of(&bus->timed.nodes[i]) > longest)
            longest = bit_of(&bus->timed.nodes[i]);
    return (uint64_t)(longest / bus->timed.bit_time) + 2;
}

/* Returns the bit times up to a tick before which nothing comes in. All nodes sample once more
 * before a frame comes, since a sample takes the frames up to the end of the bit. Those that are
 * parked get their places when they sample. */
static uint64_t reach(const cw_bus *bus, uint64_t tick)
{
    const uint64_t left = bus->timed.clean.parked ? 0 : bit_times_of_longest(bus);
    uint64_t bits = cw_wire_bits_before(&bus->time, cw_inbox_first(bus));
    bits = bits > left ? bits - left : 0;
    bits = cw_least(bits, cw_wire_bits_to(&bus->time, tick));
    bits = cw_least(bits, cw_wire_bits_before(&bus->time, bus->node_due));
    bits = cw_least(bits, cw_wire_bits_before(&bus->time, bus->rules.next_due));
    return cw_least(bits, cw_rate_bits(cw_wire_rate(&bus->time), CW_LEAP_TICKS));
}

uint64_t cw_timed_rest_reach(const cw_bus *bus, uint64_t tick)
{
    return all_rest(bus) ? reach(bus, tick) : 0;
}

/* Puts all nodes into the bits in which they are at a moment. */
static void place_nodes(cw_bus *bus, cw_span moment)
{
    cw_agenda_clear(&bus->timed.agenda);
    for (unsigned i = 0; i < bus->node_count; i++) {
        cw_timed_node *n = &bus->timed.nodes[i];
        n->ahead = false;
        (void)cw_timed_place(bus, i, n->pcs.sampled ? n->next_begin : n->begin, moment);
    }
    bus->timed.moment = moment;
}

bool cw_timed_rest_go(cw_bus *bus, uint64_t tick)
{
    const uint64_t bits = cw_timed_rest_reach(bus, tick);
    if (bits < (bus->timed.clean.parked ? 1 : LEAST_BITS))
        return false;
    cw_timed_rebase(bus);
    if (bus->timed.clean.parked) {
        cw_clean_count_rest(bus, bits);
    } else {
        place_nodes(bus, cw_moment_of(bus, cw_wire_tick(&bus->time, bits)));
        cw_watch_wire(bus, bits);
        bus->stats.bits += bits;
    }
    cw_wire_pass(&bus->time, bits);
    bus->wire = CW_RECESSIVE;
    cw_doze_forget(bus);
    bus->recessive_bits += bits;
    cw_outlook_forget(bus);
    if (bus->timed.clean.parked)
        cw_clean_settle(bus);
    else
        cw_timed_leave(bus);
    return true;
}
