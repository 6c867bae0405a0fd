/* SPDX-License-Identifier: MIT
 *
 * quantum_level.c - the level of the wire at single moments of a clean frame.
 *
 * Between two bit times the bus asks whether any node sees a dominant level.
 */
#include "step/quantum_clean.h"

#include "format/bits.h"

/* Returns true when a node still sees a driver in the ACK slot. Mostly the limits say it. */
static bool sees_slot(const cw_bus *bus, const cw_clean_frame *f, unsigned i, cw_span moment)
{
    const cw_clean *clean = &bus->timed.clean;
    if (moment <= f->last_end || moment > f->released)
        return moment <= f->last_end;
    for (uint64_t rest = f->drivers; rest; rest &= rest - 1) {
        const unsigned k = cw_lowest_node(rest);
        const cw_span delay = cw_cable_delay(&bus->timed.cable, k, i, CW_RECESSIVE);
        if (moment <= cw_clean_end_of_slot(clean, f, cw_clean_at(clean, k)) + delay)
            return true;
    }
    return false;
}

/* Returns the level of the last edge of the sender that has come to a node before a moment. */
static bool sent_level(const cw_bus *bus, const cw_clean_frame *f, const cw_bits *bits, unsigned i,
                       cw_span moment)
{
    const cw_span passed = (moment - f->begin) / f->bit;
    for (unsigned n = passed < f->slot ? (unsigned)passed + 1 : f->slot; n-- > 0;) {
        const bool level = cw_bits_level(bits, n), before = n == 0 || cw_bits_level(bits, n - 1);
        const cw_span driven = f->begin + (cw_span)n * f->bit;
        if (level != before &&
            driven + cw_cable_delay(&bus->timed.cable, f->sender, i, level) < moment)
            return level;
    }
    return CW_RECESSIVE;
}

/* Returns true when any node sees a dominant level at a moment. */
static bool is_dominant(const cw_bus *bus, const cw_clean_frame *f, const cw_bits *bits,
                        cw_span moment)
{
    const cw_clean *clean = &bus->timed.clean;
    for (unsigned i = 0; i < bus->node_count && moment > f->begin; i++) {
        const bool behind = cw_clean_arrival(clean, f, cw_clean_at(clean, i)) < moment;
        if (behind ? sees_slot(bus, f, i, moment)
                   : sent_level(bus, f, bits, i, moment) == CW_DOMINANT)
            return true;
    }
    return false;
}

uint64_t cw_clean_recessive_bits(const cw_bus *bus, const cw_clean_frame *f, uint64_t bit_times)
{
    cw_bits bits;
    (void)cw_bits_encode(&bits, f->frame);
    for (uint64_t n = bit_times; n > 0; n--)
        if (is_dominant(bus, f, &bits, f->now + (cw_span)n * bus->timed.bit_time))
            return bit_times - n;
    return bus->recessive_bits + bit_times;
}
