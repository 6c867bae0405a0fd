/* SPDX-License-Identifier: MIT
 *
 * pcs.c - synchronisation of one controller to the edges that it sees; lengths of bits and quanta.
 */
#include "time/pcs.h"

#define MILLION 1000000
#define MOST_PPM 500000
#define MOST_BRP 65536u
#define LONGEST_QUANTUM (INT64_MAX / CW_BIT_QUANTA_MAX) /* 26 ms; the bit fits into a span */

/* ---- Bit timing ------------------------------------------------------------------------------ */

/* Returns 2^32 * dividend / divisor, rounded to the nearest; the divisor has at most 55 bits. */
static uint64_t divide_into_parts(uint64_t dividend, uint64_t divisor)
{
    uint64_t quotient = dividend / divisor;
    uint64_t rest = dividend % divisor;
    for (unsigned byte = 0; byte < 4; byte++) {
        quotient = quotient << 8 | (rest << 8) / divisor;
        rest = (rest << 8) % divisor;
    }
    return quotient + (rest >= divisor - rest);
}

cw_span cw_quantum(uint32_t clock_hz, uint32_t brp, int32_t ppm)
{
    if (clock_hz == 0 || brp == 0 || brp > MOST_BRP || ppm < -MOST_PPM || ppm > MOST_PPM)
        return 0;
    const uint64_t dividend = (uint64_t)CW_CLOCK_HZ * MILLION * brp;
    const uint64_t divisor = (uint64_t)clock_hz * (uint64_t)(MILLION + ppm);
    if (dividend / divisor >= LONGEST_QUANTUM / CW_TICK)
        return 0;
    return (cw_span)divide_into_parts(dividend, divisor);
}

unsigned cw_bit_timing_sample_at(const cw_bit_timing *t)
{
    return 1u + t->prop_seg + t->phase_seg1;
}

unsigned cw_bit_timing_quanta(const cw_bit_timing *t)
{
    return cw_bit_timing_sample_at(t) + t->phase_seg2;
}

bool cw_bit_timing_valid(const cw_bit_timing *t)
{
    return t->quantum > 0 && t->quantum <= LONGEST_QUANTUM && t->phase_seg1 > 0 &&
           t->phase_seg2 > 0 && t->sjw > 0 && t->sjw <= t->phase_seg1 && t->sjw <= t->phase_seg2 &&
           cw_bit_timing_quanta(t) <= CW_BIT_QUANTA_MAX;
}

/* ---- Synchronisation ------------------------------------------------------------------------- */

void cw_pcs_begin_bit(cw_pcs *pcs, const cw_bit_timing *timing)
{
    pcs->sample_at = (uint16_t)cw_bit_timing_sample_at(timing);
    pcs->end_at = (uint16_t)cw_bit_timing_quanta(timing);
    pcs->sampled = false;
}

void cw_pcs_change_rate(cw_pcs *pcs, const cw_bit_timing *timing)
{
    pcs->sample_at = (uint16_t)cw_bit_timing_sample_at(timing);
    pcs->end_at = (uint16_t)cw_bit_timing_quanta(timing);
}

static unsigned at_most(unsigned quanta, unsigned most)
{
    return quanta < most ? quanta : most;
}

/* An edge before the sample point belongs to this bit: it is late, or in Sync_Seg. */
static cw_edge_effect take_late_edge(cw_pcs *pcs, const cw_bit_timing *timing, unsigned in,
                                     bool driven, bool hard)
{
    if (driven == CW_DOMINANT && in > 0) /* T6 */
        return CW_EDGE_IGNORED;
    pcs->synchronised = true;
    if (hard)
        return CW_EDGE_RESTARTS;
    const unsigned longer = at_most(in, timing->sjw);
    pcs->sample_at = (uint16_t)(pcs->sample_at + longer);
    pcs->end_at = (uint16_t)(pcs->end_at + longer);
    return CW_EDGE_RESYNCED;
}

/* An edge after the sample point belongs to the next bit: it is early. */
static cw_edge_effect take_early_edge(cw_pcs *pcs, const cw_bit_timing *timing, unsigned in,
                                      bool hard)
{
    pcs->synchronised = true;
    if (hard || pcs->end_at - in <= timing->sjw)
        return CW_EDGE_ENDS_BIT;
    pcs->end_at = (uint16_t)(pcs->end_at - timing->sjw);
    return CW_EDGE_RESYNCED;
}

cw_edge_effect cw_pcs_take_edge(cw_pcs *pcs, const cw_bit_timing *timing, unsigned in, bool driven,
                                bool hard)
{
    if (!cw_pcs_is_open(pcs))
        return CW_EDGE_IGNORED;
    return pcs->sampled ? take_early_edge(pcs, timing, in, hard)
                        : take_late_edge(pcs, timing, in, driven, hard);
}
