/* SPDX-License-Identifier: MIT
 *
 * fast.h - the time that frames save at the data rate (D10), where bits are common to all nodes.
 *
 * Bits of a frame are counted from SOF, which is bit 0. The bits from `from` to before `to` begin
 * at the data rate: `from` is the bit after BRS, and `to` - 1 is the CRC delimiter. BRS is shorter
 * than a nominal bit, too. It and the CRC delimiter together save as much as a bit between them.
 */
#ifndef CANWIRE_TIME_FAST_H
#define CANWIRE_TIME_FAST_H

#include "time/wire.h"

/* Ticks by which bits are shorter than nominal ones. */
typedef struct cw_fast_bits {
    uint32_t saved;        /* by a bit of the data phase */
    uint32_t saved_by_brs;
} cw_fast_bits;

/* The place of the data phase in a frame; both 0: it has none. */
typedef struct cw_fast_part {
    uint16_t from;
    uint16_t to;
} cw_fast_part;

/* Returns the ticks that the first n bits of the frame save. */
static inline uint64_t cw_fast_saved(const cw_fast_bits *fast, const cw_fast_part *part, unsigned n)
{
    if (n < part->from || part->to == 0)
        return 0;
    if (n < part->to)
        return fast->saved_by_brs + (uint64_t)(n - part->from) * fast->saved;
    return (uint64_t)(part->to - part->from) * fast->saved;
}

/* Returns the tick at which bit n begins when bit `at` begins now; n is not before it. */
static inline uint64_t cw_fast_tick(const cw_wire_time *time, const cw_fast_bits *fast,
                                    const cw_fast_part *part, unsigned at, unsigned n)
{
    return cw_wire_tick(time, (uint64_t)n - at) -
           (cw_fast_saved(fast, part, n) - cw_fast_saved(fast, part, at));
}

#endif
