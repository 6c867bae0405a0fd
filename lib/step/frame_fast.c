/* SPDX-License-Identifier: MIT
 *
 * frame_fast.c - clean frames with a part at the data rate (D10).
 *
 * Bits are counted as in other frames, but some of them are shorter. No rule acts on such a step:
 * their bits are then simulated one by one (quantum_rate.c).
 */
#include "step/frame.h"

#include "mac/late.h"

/* Returns the ticks that the first n bits are shorter than nominal ones (D10). */
static uint64_t saved_by(const cw_bus *bus, unsigned n)
{
    return cw_fast_saved(&bus->timed.fast, &bus->frame_step.fast, n);
}

/* Returns the number, kept between the two limits. */
static unsigned limit(unsigned n, unsigned least, unsigned most)
{
    n = n < least ? least : n;
    return n < most ? n : most;
}

/* Counts what is at the data rate in the bits between two others. */
static void count_fast(cw_bus *bus, unsigned from, unsigned to)
{
    const cw_frame_step *step = &bus->frame_step;
    const unsigned first = limit(from, step->fast.from, step->fast.to);
    const unsigned end = limit(to, step->fast.from, step->fast.to);
    bus->stats.data_bits += end - first;
    bus->stats.data_ticks += cw_frame_step_tick(bus, end) - cw_frame_step_tick(bus, first);
}

/* The transmitter measures no delay where bits are common to all nodes (D13). */
static void note_delay(cw_timed_rates *r)
{
    cw_late_measured(&r->late, 0);
    r->stats.tdcv = cw_late_delay(&r->late);
}

void cw_frame_step_count_fast(cw_bus *bus, unsigned bits)
{
    const unsigned from = bus->frame_step.at, to = from + bits;
    const uint64_t saved = saved_by(bus, to) - saved_by(bus, from);
    cw_count_clean_bits(bus);
    count_fast(bus, from, to);
    bus->stats.bits += bits;
    bus->stats.busy_bits += bits;
    bus->timed.short_ticks += saved;
    if (to + 1 >= bus->frame_step.fast.from) /* res has passed */
        note_delay(&bus->timed.rates[bus->frame_step.node]);
    cw_load_add(&bus->load, (uint64_t)bits * bus->load.unit - saved, true);
}

void cw_frame_step_count_whole_fast(cw_bus *bus, unsigned bits)
{
    const cw_fast_part *part = &bus->frame_step.fast;
    const uint64_t saved = saved_by(bus, part->to);
    cw_count_clean_bits(bus);
    bus->stats.data_bits += part->to - part->from;
    bus->stats.data_ticks += cw_rate_ticks(cw_wire_rate(&bus->time), part->to - part->from) +
                             bus->timed.fast.saved_by_brs - saved;
    bus->stats.bits += bits;
    bus->stats.busy_bits += bits;
    bus->timed.short_ticks += saved;
    note_delay(&bus->timed.rates[bus->frame_step.node]);
    cw_load_add(&bus->load, (uint64_t)bits * bus->load.unit - saved, true);
}

void cw_frame_step_pass_fast(cw_bus *bus, unsigned bits)
{
    cw_frame_step *step = &bus->frame_step;
    cw_frame_step_count_fast(bus, bits);
    cw_wire_go_to(&bus->time, cw_frame_step_tick(bus, step->at + bits));
    step->at = (uint16_t)(step->at + bits);
}

void cw_frame_step_save_time(cw_bus *bus)
{
    cw_frame_step *step = &bus->frame_step;
    const uint64_t saved = saved_by(bus, step->length) - saved_by(bus, step->at);
    cw_wire_go_to(&bus->time, cw_now(bus) - saved);
    step->fast.to = 0;
}

/* Returns true when the step goes on after bit n - 1: bit n ends before the tick or at it, and
 * nothing comes in before. */
static bool goes_on_at(const cw_bus *bus, unsigned n, uint64_t tick, uint64_t due)
{
    return cw_frame_step_tick(bus, n) < due && cw_frame_step_tick(bus, n + 1) <= tick;
}

unsigned cw_frame_step_fast_bits(const cw_bus *bus, uint64_t tick, unsigned most)
{
    const uint64_t due = cw_first_due(bus);
    unsigned least = 1;
    while (least < most) {
        const unsigned middle = least + (most - least) / 2;
        if (goes_on_at(bus, bus->frame_step.at + middle, tick, due))
            least = middle + 1;
        else
            most = middle;
    }
    return least;
}
