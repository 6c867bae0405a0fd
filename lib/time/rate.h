/* SPDX-License-Identifier: MIT
 *
 * rate.h - how long bits are. This folder alone converts between bits and ticks.
 *
 * A bit of the bus lasts a whole number of ticks. Clocks that differ from node to node will need a
 * fraction of a tick as well. cw_rate then becomes a 64-bit number of ticks / 2^32, and
 * cw_wire_time (wire.h) keeps the fraction of its tick. Nobody else looks into the two structs, so
 * nothing else changes: a moment that others see stays a whole tick.
 */
#ifndef CANWIRE_TIME_RATE_H
#define CANWIRE_TIME_RATE_H

#include "canwire.h"

#define CW_BITS_FOREVER UINT64_MAX /* bits that do not end */

typedef struct cw_rate {
    uint32_t bit_ticks;
} cw_rate;

static inline cw_rate cw_rate_of(uint32_t bit_ticks)
{
    return (cw_rate){.bit_ticks = bit_ticks};
}

static inline bool cw_rate_equal(cw_rate a, cw_rate b)
{
    return a.bit_ticks == b.bit_ticks;
}

/* How long so many bits last. */
static inline uint64_t cw_rate_ticks(cw_rate rate, uint64_t bits)
{
    return bits * rate.bit_ticks;
}

/* The same for more bits than there is time for, which last CW_NEVER. */
static inline uint64_t cw_rate_ticks_or_never(cw_rate rate, uint64_t bits)
{
    uint64_t ticks;
    return __builtin_mul_overflow(bits, rate.bit_ticks, &ticks) ? CW_NEVER : ticks;
}

/* The whole bits in so many ticks. */
static inline uint64_t cw_rate_bits(cw_rate rate, uint64_t ticks)
{
    return ticks / rate.bit_ticks;
}

/* The bits that begin in so many ticks, of which the first one begins with them. */
static inline uint64_t cw_rate_bits_begun(cw_rate rate, uint64_t ticks)
{
    return ticks / rate.bit_ticks + (ticks % rate.bit_ticks != 0);
}

/* So many ticks after another; what would be beyond the end of time does not come. */
static inline uint64_t cw_after(uint64_t tick, uint64_t ticks)
{
    return ticks < CW_NEVER - tick ? tick + ticks : CW_NEVER;
}

#endif
