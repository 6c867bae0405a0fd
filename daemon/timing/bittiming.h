/* SPDX-License-Identifier: MIT
 *
 * bittiming.h - the bit timing of one controller: what its segments mean. Rules T1 and T10.
 *
 * A bit is Sync_Seg (1 tq), Prop_Seg, Phase_Seg1 and Phase_Seg2. The sample point is between the
 * phase segments. A time quantum (tq) is `brp` clocks. All results are exact or rounded down, in
 * whole numbers.
 */
#ifndef CANWIRE_TIMING_BITTIMING_H
#define CANWIRE_TIMING_BITTIMING_H

#include <stdbool.h>
#include <stdint.h>

#define TIMING_SYNC_SEG 1u                  /* tq */
#define TIMING_ONE_PPB UINT64_C(1000000000) /* the whole, in parts per billion */

/* Longest span of nanoseconds for timing_quanta_of_ns(). */
#define TIMING_NS_MAX UINT64_C(1000000000)

/* One bit timing. Each member is at least 1, but prop_seg may be 0: most controllers know only the
 * sum of prop_seg and phase_seg1. */
typedef struct bit_timing {
    uint32_t clock_hz; /* of the controller, before the prescaler */
    uint32_t brp;      /* the prescaler: clocks of a tq */
    uint32_t prop_seg; /* tq, as the next three */
    uint32_t phase_seg1;
    uint32_t phase_seg2;
    uint32_t sjw; /* the longest step of one resynchronisation (T5) */
} bit_timing;

static inline uint32_t timing_least(uint32_t a, uint32_t b)
{
    return a < b ? a : b;
}

/* Returns prop_seg + phase_seg1: what lies between Sync_Seg and the sample point, in tq. */
static inline uint32_t timing_tseg1(const bit_timing *t)
{
    return t->prop_seg + t->phase_seg1;
}

/* Returns the length of a bit in tq. */
static inline uint32_t timing_quanta(const bit_timing *t)
{
    return TIMING_SYNC_SEG + timing_tseg1(t) + t->phase_seg2;
}

/* Returns the length of a bit in clocks. */
static inline uint64_t timing_bit_clocks(const bit_timing *t)
{
    return (uint64_t)t->brp * timing_quanta(t);
}

/* Returns true when bits have exactly this rate. */
bool timing_bitrate_is(const bit_timing *t, uint32_t bitrate_bps);

/* Returns the bit rate in bit/s, rounded down. */
uint32_t timing_bitrate_bps(const bit_timing *t);

/* Returns the sample point: the part of a bit that precedes it, in ppb, rounded down. */
uint32_t timing_sample_point_ppb(const bit_timing *t);

/* Returns how far the clock of each node may be off while edges are ten bits apart (T10). It is
 * sjw / (20 bits), in ppb, rounded down. */
uint32_t timing_tolerance_of_sjw_ppb(const bit_timing *t);

/* Returns the same for the 13 bits from a bit error to the bit behind the error flag (T10). It is
 * min(phase_seg1, phase_seg2) / (2 (13 bits - phase_seg2)). */
uint32_t timing_tolerance_of_phases_ppb(const bit_timing *t);

/* Returns the smaller of both: the tolerance of T10. */
uint32_t timing_tolerance_ppb(const bit_timing *t);

/* Returns the tolerance that holds at the resolution of a quantum, too (T10). Edges are seen up to
 * 1 tq late, so phase_seg2 is 1 tq shorter in the second limit; sjw / (20 bits) stays. */
uint32_t timing_sufficient_ppb(const bit_timing *t);

/* Returns how many tq a span of at most TIMING_NS_MAX takes, rounded up. */
uint64_t timing_quanta_of_ns(uint32_t clock_hz, uint32_t brp, uint64_t ns);

/* Returns the length of this many tq in picoseconds, rounded down. The number is at most 1000. */
uint64_t timing_quanta_ps(const bit_timing *t, uint32_t quanta);

/* Returns the sample point that CiA recommends for a bit rate, in permille. */
uint32_t timing_cia_sample_permille(uint32_t bitrate_bps);

#endif
