/* SPDX-License-Identifier: MIT
 *
 * quantum_rest.c - bit times in which all nodes rest, each by its own clock.
 *
 * A node at rest does the same in each of its bits, and nobody sees it. So it goes on by whole bits
 * of its own at once.
 */
#include "step/quantum.h"

#include "mac/mac.h"

#define LEAST_BITS 4u                      /* fewer are not worth it */
#define MOST_TICKS (UINT64_C(1) << 27)     /* moments stay small, see cw_timed_rebase() */

/* Returns true when the controller does nothing until something comes in. */
static bool rests(const cw_mac *mac)
{
    return mac->phase == CW_MAC_IDLE || mac->phase == CW_MAC_OFF || mac->phase == CW_MAC_BUS_OFF;
}

/* Returns true when the node is in a bit like all that follow: no edge has come since it began. */
static bool is_periodic(const cw_bus *bus, unsigned i)
{
    const cw_cable *cable = &bus->timed.cable;
    const timed_node *n = &bus->timed.nodes[i];
    return rests(&bus->nodes[i].mac) && !n->retimed && !n->ahead && !n->pcs.synchronised &&
           n->pcs.last_sample == CW_RECESSIVE && n->report.what == 0 &&
           n->pcs.sample_at == cw_bit_timing_sample_at(&n->timing) &&
           n->pcs.end_at == cw_bit_timing_quanta(&n->timing) &&
           cable->newest + cable->longest < n->looked;
}

static bool all_rest(const cw_bus *bus)
{
    const cw_timed *t = &bus->timed;
    if (!t->active || bus->waiting || t->cable.dominant || t->rings || t->touched ||
        t->disturbances.count || bus->rules.awake_count || bus->stepping || bus->watching)
        return false;
    for (unsigned i = 0; i < bus->node_count; i++)
        if (!is_periodic(bus, i))
            return false;
    return true;
}

static cw_span bit_of(const timed_node *n)
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
 * before a frame comes, since a sample takes the frames up to the end of the bit. */
static uint64_t reach(const cw_bus *bus, uint64_t tick)
{
    const uint64_t left = bit_times_of_longest(bus);
    uint64_t bits = cw_wire_bits_before(&bus->time, cw_inbox_first(bus));
    bits = bits > left ? bits - left : 0;
    bits = cw_least(bits, cw_wire_bits_to(&bus->time, tick));
    bits = cw_least(bits, cw_wire_bits_before(&bus->time, bus->next_restart));
    bits = cw_least(bits, cw_wire_bits_before(&bus->time, bus->rules.next_due));
    return cw_least(bits, cw_rate_bits(cw_wire_rate(&bus->time), MOST_TICKS));
}

/* Lets a node go on by whole bits, past a moment. A bit may begin at the moment itself, as it is
 * still to begin after the bit time. */
static void go_past(cw_bus *bus, unsigned i, cw_span moment)
{
    timed_node *n = &bus->timed.nodes[i];
    const agenda_entry e = *cw_agenda_of(&bus->timed.agenda, i);
    const cw_span bit = bit_of(n);
    const bool begins = cw_agenda_what(&e) == CW_BEGINS;
    if (e.moment > moment || (begins && e.moment == moment))
        return;
    cw_span bits = (moment - e.moment) / bit;
    if (!begins || e.moment + bits * bit < moment)
        bits++;
    n->begin += bits * bit;
    n->next_begin += bits * bit;
    n->looked += bits * bit;
    cw_agenda_remove(&bus->timed.agenda, i);
    cw_agenda_put(&bus->timed.agenda, i, cw_agenda_what(&e), e.moment + bits * bit);
}

bool cw_timed_rest_go(cw_bus *bus, uint64_t tick)
{
    if (!all_rest(bus))
        return false;
    const uint64_t bits = reach(bus, tick);
    if (bits < LEAST_BITS)
        return false;
    cw_timed_rebase(bus);
    const cw_span end = cw_moment_of(bus, cw_wire_tick(&bus->time, bits));
    for (unsigned i = 0; i < bus->node_count; i++)
        go_past(bus, i, end);
    cw_watch_wire(bus, bits);
    cw_wire_pass(&bus->time, bits);
    bus->timed.moment = end;
    bus->wire = CW_RECESSIVE;
    bus->stats.bits += bits;
    bus->recessive_bits += bits;
    bus->outlook.valid = false;
    cw_timed_leave(bus);
    return true;
}
