/* SPDX-License-Identifier: MIT
 *
 * bittiming.c - the bit timing of one controller: what its segments mean.
 */
#include "timing/bittiming.h"

#include "base/text/wide.h"

#include <assert.h>

#define NS_PER_S UINT64_C(1000000000)
#define PS_PER_S UINT64_C(1000000000000)
#define QUANTA_MAX 1000u
#define SJW_BITS 20u  /* twice the ten bits between edges of a stuffed frame */
#define FLAG_BITS 13u /* from a bit error to the bit behind the error flag */

bool timing_bitrate_is(const bit_timing *t, uint32_t bitrate_bps)
{
    return timing_bit_clocks(t) * bitrate_bps == t->clock_hz;
}

uint32_t timing_bitrate_bps(const bit_timing *t)
{
    return (uint32_t)(t->clock_hz / timing_bit_clocks(t));
}

uint32_t timing_sample_point_ppb(const bit_timing *t)
{
    uint64_t before = TIMING_SYNC_SEG + timing_tseg1(t);

    return (uint32_t)(before * TIMING_ONE_PPB / timing_quanta(t));
}

uint32_t timing_tolerance_of_sjw_ppb(const bit_timing *t)
{
    return (uint32_t)(t->sjw * TIMING_ONE_PPB / (SJW_BITS * timing_quanta(t)));
}

/* Returns the tolerance for a phase error of so many tq behind an error flag. */
static uint32_t tolerance_of_slack_ppb(const bit_timing *t, uint64_t slack)
{
    return (uint32_t)(slack * TIMING_ONE_PPB /
                      (2 * (FLAG_BITS * timing_quanta(t) - t->phase_seg2)));
}

uint32_t timing_tolerance_of_phases_ppb(const bit_timing *t)
{
    return tolerance_of_slack_ppb(t, timing_least(t->phase_seg1, t->phase_seg2));
}

uint32_t timing_tolerance_ppb(const bit_timing *t)
{
    return timing_least(timing_tolerance_of_sjw_ppb(t), timing_tolerance_of_phases_ppb(t));
}

uint32_t timing_sufficient_ppb(const bit_timing *t)
{
    const uint32_t slack = timing_least(t->phase_seg1, t->phase_seg2 - 1);

    return timing_least(timing_tolerance_of_sjw_ppb(t), tolerance_of_slack_ppb(t, slack));
}

uint64_t timing_quanta_of_ns(uint32_t clock_hz, uint32_t brp, uint64_t ns)
{
    uint64_t quantum = brp * NS_PER_S;

    assert(ns <= TIMING_NS_MAX);
    return (ns * clock_hz + quantum - 1) / quantum;
}

uint64_t timing_quanta_ps(const bit_timing *t, uint32_t quanta)
{
    uint64_t rest;

    assert(quanta <= QUANTA_MAX);
    return wide_divide(&rest, wide_product((uint64_t)quanta * t->brp, PS_PER_S), t->clock_hz).low;
}

uint32_t timing_cia_sample_permille(uint32_t bitrate_bps)
{
    if (bitrate_bps > 800000)
        return 750;
    return bitrate_bps > 500000 ? 800 : 875;
}
