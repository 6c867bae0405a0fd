/* SPDX-License-Identifier: MIT
 *
 * rate.h - the length of bits. This folder alone converts between bits and ticks, with the
 * functions of canwire.h that hosts need, too.
 *
 * A bit of the bus lasts a whole number of ticks. Clocks that differ from node to node will need a
 * fraction of a tick as well. cw_rate then becomes a 64-bit number of ticks / 2^32, and
 * cw_wire_time (wire.h) keeps the fraction of its tick. No other file reads the fields of the two
 * structs, so nothing else changes: a moment that others see stays a whole tick.
 */
#ifndef CANWIRE_TIME_RATE_H
#define CANWIRE_TIME_RATE_H

#include "canwire.h"

#define CW_BITS_FOREVER UINT64_MAX /* bits that do not end */

/* Returns the smaller number of ticks or bits. */
static inline uint64_t cw_least(uint64_t a, uint64_t b)
{
    return a < b ? a : b;
}

static inline bool cw_rate_equal(cw_rate a, cw_rate b)
{
    return a.bit_ticks == b.bit_ticks;
}

#endif
