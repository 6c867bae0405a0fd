/* SPDX-License-Identifier: MIT
 *
 * stats.c - delay histograms, synchronisations, the load of the last second, the balance of frames.
 */
#include "state/stats.h"

#include <assert.h>

/* ---- Delays: four buckets an octave, from 1024 ticks (12.8 us) on ---------------------------- */

#define DELAY_SHIFT 10u /* the first octave begins at 1 << DELAY_SHIFT ticks; below is bucket 0 */
#define DELAY_END (DELAY_SHIFT + CW_DELAY_BUCKETS / 4) /* the last one ends at 1 << DELAY_END */

uint64_t cw_delay_bucket_ticks(unsigned bucket)
{
    if (bucket == 0)
        return 0;
    unsigned octave = bucket / 4;
    return (UINT64_C(4) + bucket % 4) << (octave + DELAY_SHIFT - 2);
}

/* Returns the bucket of a time. There are four for each power of two, and the last one has no
 * end. */
static unsigned bucket_of(uint64_t ticks)
{
    if (ticks >> DELAY_SHIFT == 0)
        return 0;
    if (ticks >> DELAY_END != 0)
        return CW_DELAY_BUCKETS - 1;
    const unsigned octave = 63u - (unsigned)__builtin_clzll(ticks) - DELAY_SHIFT;
    return octave * 4 + ((unsigned)(ticks >> (octave + DELAY_SHIFT - 2)) & 3u);
}

void cw_delay_add(cw_delay *delay, uint64_t ticks)
{
    if (delay->count == 0 || ticks < delay->min_ticks)
        delay->min_ticks = ticks;
    if (ticks > delay->max_ticks)
        delay->max_ticks = ticks;
    delay->count++;
    delay->sum_ticks += ticks;
    delay->bucket[bucket_of(ticks)]++;
}

uint64_t cw_delay_quantile_ticks(const cw_delay *delay, unsigned permille)
{
    uint64_t wanted =
        delay->count / 1000 * permille + (delay->count % 1000 * permille + 999) / 1000;
    uint64_t seen = 0;
    for (unsigned b = 0; b < CW_DELAY_BUCKETS; b++) {
        seen += delay->bucket[b];
        if (seen < wanted || seen == 0)
            continue;
        uint64_t edge = b + 1 < CW_DELAY_BUCKETS ? cw_delay_bucket_ticks(b + 1) : CW_NEVER;
        return edge < delay->max_ticks ? edge : delay->max_ticks;
    }
    return 0;
}

/* ---- Synchronisations ------------------------------------------------------------------------ */

/* Returns the span without its sign. */
static cw_span magnitude(cw_span span)
{
    return span < 0 ? -span : span;
}

void cw_sync_stats_add(cw_sync_stats *sum, const cw_sync_stats *more)
{
    sum->hard_syncs += more->hard_syncs;
    sum->resyncs += more->resyncs;
    if (magnitude(more->phase_error) > magnitude(sum->phase_error)) {
        sum->phase_error = more->phase_error;
        sum->phase_error_tq = more->phase_error_tq;
    }
    if (more->margin < sum->margin)
        sum->margin = more->margin;
}

/* ---- Load ------------------------------------------------------------------------------------ */

void cw_load_init(cw_load *load, cw_rate rate, bool divided)
{
    const uint64_t ticks = CW_CLOCK_HZ / CW_LOAD_SLICES;
    *load = (cw_load){.unit = divided ? (uint32_t)cw_rate_ticks(rate, 1) : 1,
                      .slice_bits = divided ? ticks : cw_rate_bits(rate, ticks)};
    if (load->slice_bits == 0)
        load->slice_bits = 1;
    load->slice_left = load->slice_bits;
}

/* Begins the next slice when one is full; skips whole slices without busy bits at once. */
static void next_slices(cw_load *load, uint64_t number)
{
    uint64_t passed = number < CW_LOAD_SLICES ? number : CW_LOAD_SLICES;
    load->slice_number += number;
    load->slice = (unsigned)(load->slice_number % CW_LOAD_SLICES);
    for (uint64_t i = 0; i < passed; i++)
        load->busy[(load->slice_number - i) % CW_LOAD_SLICES] = 0;
}

void cw_load_add_slices(cw_load *load, uint64_t bits, bool busy)
{
    while (bits > load->slice_left) {
        if (busy)
            load->busy[load->slice] += (uint32_t)load->slice_left;
        bits -= load->slice_left;
        uint64_t whole = busy ? 0 : (bits - 1) / load->slice_bits;
        next_slices(load, 1 + whole);
        bits -= whole * load->slice_bits;
        load->slice_left = load->slice_bits;
    }
    load->slice_left -= bits;
    if (busy)
        load->busy[load->slice] += (uint32_t)bits;
}

unsigned cw_load_second_permille(const cw_load *load)
{
    if (load->bits == 0)
        return 0;
    uint64_t now = (load->bits - 1) / load->slice_bits;
    uint64_t busy = 0;
    for (uint64_t i = 0; i < CW_LOAD_SLICES && i <= now; i++) {
        uint64_t number = now - i;
        bool still_there = number <= load->slice_number &&
                           load->slice_number - number < CW_LOAD_SLICES;
        if (still_there)
            busy += load->busy[number % CW_LOAD_SLICES];
    }
    uint64_t oldest = now >= CW_LOAD_SLICES - 1 ? now - (CW_LOAD_SLICES - 1) : 0;
    return (unsigned)(busy * 1000 / (load->bits - oldest * load->slice_bits));
}

unsigned cw_load_permille(const cw_bus_stats *before, const cw_bus_stats *after)
{
    const uint64_t ticks = after->ticks - before->ticks;
    return ticks ? (unsigned)((after->busy_ticks - before->busy_ticks) * 1000 / ticks) : 0;
}

/* ---- Balance --------------------------------------------------------------------------------- */

/* Adds drops for all reasons. */
static uint64_t sum_of_drops(const uint64_t dropped[CW_DROP_COUNT])
{
    uint64_t sum = 0;
    for (unsigned why = 0; why < CW_DROP_COUNT; why++)
        sum += dropped[why];
    return sum;
}

bool cw_node_stats_balance(const cw_node_stats *s)
{
    uint64_t in = s->tx_frames + s->stored + s->queue + s->held + sum_of_drops(s->dropped);
    uint64_t out = s->rx_frames + s->rx_held + sum_of_drops(s->rx_dropped);
    return s->handed_in + s->made_by_rules == in && s->rx_accepted + s->rx_made_by_rules == out;
}
