/* SPDX-License-Identifier: MIT
 *
 * quantum_time.c - the bit times of the bus, while its nodes go by clocks of their own.
 *
 * All that has no clock of its own happens between two bit times: frames and commands of hosts,
 * restarts, rules on times. Load is counted for bit times, too. So a bus whose clocks all agree has
 * the events and statistics of single bits (bit.c). In the middle of a frame mostly nothing of all
 * this happens. Then one bit time follows another without a look at it.
 */
#include "step/quantum.h"

#include "mac/mac.h"

#define MOST_BIT_TIMES 32u /* at once: hosts want to be asked now and then */

/* ---- One bit time ---------------------------------------------------------------------------- */

/* Returns the level of all wires together at the end of the bit time. */
static bool level_of_wires(const cw_bus *bus, cw_span moment)
{
    const cw_cable *cable = &bus->timed.cable;
    if (bus->timed.calm && cable->newest + cable->longest < moment)
        return cable->dominant == 0;
    for (unsigned i = 0; i < bus->node_count; i++)
        if (cw_timed_wire(bus, i, moment) == CW_DOMINANT)
            return CW_DOMINANT;
    return CW_RECESSIVE;
}

/* Ends a bit time of the bus: nodes that sleep look at it, rules report their hits. */
static void end_bit_time(cw_bus *bus, cw_span end)
{
    if (bus->dozing)
        cw_timed_doze(bus, end);
    if (bus->timed.marking)
        cw_marks_end(bus, end);
    bus->wire = level_of_wires(bus, end);
    if (bus->timed.rates && bus->timed.uniform)
        cw_timed_show_wire(bus);
    cw_wire_end_bit(&bus->time);
    bus->stats.bits++;
    bus->recessive_bits = bus->wire ? bus->recessive_bits + 1 : 0;
    if (bus->rules.awake_count)
        cw_rules_emit(&bus->rules);
}

/* Hands in the frames of the bit time, for nodes that have not sampled behind them, too. A drop is
 * reported with the tick of its frame, and events come in the order of time. */
static void take_frames(cw_bus *bus)
{
    if (cw_inbox_first(bus) >= cw_bit_end(bus))
        return;
    cw_take_inbox_before(bus, cw_bit_end(bus));
    bus->timed.steady_at = CW_NEVER;
}

/* Does what nodes do in a bit time, which has begun. */
static void pass_bit_time(cw_bus *bus, cw_span end)
{
    cw_timed_go_to(bus, end);
    take_frames(bus);
    end_bit_time(bus, end);
    cw_timed_end_bits(bus, end);
}

/* Rules look at the start of each bit. */
static void settle_for_rules(cw_bus *bus)
{
    if (bus->rules.awake_count == 0 && bus->timed.disturbances.count == 0)
        return;
    for (unsigned i = 0; i < bus->node_count; i++)
        cw_timed_settle(&bus->timed, i);
}

/* Forgets what rules did to levels before the last look of each node. A node in the middle of its
 * bit still looks back at all of it, by two quanta more for triple sampling. */
static void forget_disturbances(cw_bus *bus, cw_span begin)
{
    cw_timed *t = &bus->timed;
    cw_span first = begin;
    for (unsigned i = 0; t->disturbances.count && i < bus->node_count; i++) {
        const cw_timed_node *n = &t->nodes[i];
        const cw_span back =
            n->looked - 2 * n->timing.quantum - cw_timed_longest_ringing(t, i);
        first = back < first ? back : first;
    }
    cw_disturb_forget(&t->disturbances, first - t->cable.longest);
}

/* Notes the levels at the start of the bit time, for traces. */
static void note_levels(cw_bus *bus, cw_span moment)
{
    cw_levels levels;
    uint64_t came;
    cw_timed_levels_at_source(bus, &levels, bus->timed.cable.dominant, moment);
    cw_timed_levels_at_nodes(bus, &came, &levels.sampled, moment);
    cw_view_note(bus, &levels);
    bus->note.came = came;
    cw_marks_note(bus);
}

/* Counts what is at the data rate, and the time by which busy bits are shorter than others. */
static void count_rates(cw_bus *bus, unsigned view)
{
    const uint64_t ticks = cw_bit_end(bus) - cw_now(bus);
    if (view & CW_WIRE_BUSY)
        bus->timed.short_ticks += bus->time.short_by;
    if (!cw_fast_nodes(bus))
        return;
    bus->stats.data_bits++;
    bus->stats.data_ticks += ticks;
}

/* Counts a bit time for load and statistics, by what the bus showed at its start. */
static void count_bit_time(cw_bus *bus, unsigned view)
{
    cw_watch_view(bus, view, 1);
    if (bus->timed.rates)
        count_rates(bus, view);
}

/* Counts load and flags of the bit time. Looks at controllers only when they may do something else
 * to the wire than before. */
static void quantum_time_watch(cw_bus *bus)
{
    cw_timed *t = &bus->timed;
    if (t->steady_at != cw_now(bus))
        t->view = cw_view_wire(bus);
    count_bit_time(bus, t->view);
    t->steady_at = cw_bit_end(bus);
}

/* Returns the end of the bit time. */
static cw_span begin_bit_time(cw_bus *bus, cw_span begin)
{
    cw_sync_begin_bit_time(bus);
    bus->timed.moment = begin;
    settle_for_rules(bus);
    const cw_span common = bus->timed.rates ? cw_timed_common_bit(bus) : 0;
    const uint64_t nodes = cw_timed_begin_bits(bus, begin);
    if (bus->timed.rates)
        cw_timed_set_bit(bus, common);
    const cw_span end = cw_moment_of(bus, cw_bit_end(bus));
    quantum_time_watch(bus);
    forget_disturbances(bus, begin);
    if (bus->timed.rings_before)
        cw_timed_forget_ringing(bus);
    cw_timed_let_rules_act(bus, nodes, begin, end);
    if (bus->stepping || bus->watching)
        note_levels(bus, begin);
    return end;
}

/* ---- Bit times that begin alike -------------------------------------------------------------- */

/* Returns true when all controllers are in the middle of a frame, or bring it to its end. */
static bool is_in_frame(const cw_bus *bus)
{
    return bus->timed.view == CW_WIRE_BUSY && !cw_timed_may_leap(bus);
}

/* Returns true when the next bit time begins as the last one did, and no rule acts. */
static bool is_steady(const cw_bus *bus)
{
    return bus->timed.steady_at == cw_now(bus) && bus->timed.calm;
}

/* Returns the most bit times that can follow now. */
static unsigned bit_times_to_follow(const cw_bus *bus, uint64_t tick)
{
    if (!is_steady(bus) || !is_in_frame(bus) || bus->stepping || bus->watching ||
        cw_first_due(bus) <= cw_now(bus))
        return 0;
    uint64_t bits = cw_least(cw_wire_bits_to(&bus->time, tick),
                             cw_wire_bits_until(&bus->time, cw_first_due(bus)));
    bits = cw_least(bits, cw_rate_bits(cw_wire_rate(&bus->time), CW_LEAP_TICKS));
    return (unsigned)cw_least(bits, MOST_BIT_TIMES);
}

/* Passes bit times up to a tick as long as they are steady: all are busy, and no flag is on the
 * wire. Each one is counted before rules act at its end. */
static void pass_steady(cw_bus *bus, uint64_t tick)
{
    const unsigned most = bit_times_to_follow(bus, tick);
    unsigned count = 0;
    for (; count < most && is_steady(bus); count++) {
        bus->timed.steady_at = cw_bit_end(bus);
        count_bit_time(bus, CW_WIRE_BUSY);
        pass_bit_time(bus, cw_moment_of(bus, cw_bit_end(bus)));
    }
    bus->work += count;
}

void cw_step_bit_times(cw_bus *bus, uint64_t tick)
{
    cw_outlook_forget(bus);
    cw_clean_resume(bus);
    if (!bus->timed.active)
        cw_timed_enter(bus);
    cw_timed_rebase(bus);
    pass_bit_time(bus, begin_bit_time(bus, cw_moment_of(bus, cw_now(bus))));
    const bool divided = bus->timed.rates && bus->timed.uniform; /* by rates: each has its end */
    if ((bus->timed.requested || !bus->timed.uniform) && !divided)
        pass_steady(bus, tick);
    cw_timed_leave(bus);
}
