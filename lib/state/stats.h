/* SPDX-License-Identifier: MIT
 *
 * stats.h - delay histograms and the load of the last second.
 */
#ifndef CANWIRE_STATS_H
#define CANWIRE_STATS_H

#include "time/rate.h"

/* Adds one delay: count, sum, extremes and its bucket. */
void cw_delay_add(cw_delay *delay, uint64_t ticks);

/* Busy bits of the last second, in ten slices of 100 ms that go round. */
#define CW_LOAD_SLICES 10

typedef struct cw_load {
    uint32_t unit;        /* of a bit: 1, or its ticks where some bits are shorter */
    uint64_t slice_bits;  /* units of one slice, at least 1 */
    uint64_t bits;        /* units seen */
    uint64_t slice_left;   /* units that the present slice still takes */
    uint64_t slice_number; /* number of the present slice since bit 0 */
    unsigned slice;        /* its place: slice_number % CW_LOAD_SLICES */
    uint32_t busy[CW_LOAD_SLICES];
} cw_load;

/* divided: bits may be shorter than the rate says. */
void cw_load_init(cw_load *load, cw_rate rate, bool divided);

/* Adds units, all busy or all not, that the present slice cannot take alone. The caller adds them
 * to load->bits. */
void cw_load_add_slices(cw_load *load, uint64_t bits, bool busy);

/* Adds units that are all busy or all not. */
static inline void cw_load_add(cw_load *load, uint64_t bits, bool busy)
{
    load->bits += bits;
    if (bits > load->slice_left) {
        cw_load_add_slices(load, bits, busy);
        return;
    }
    load->slice_left -= bits;
    if (busy)
        load->busy[load->slice] += (uint32_t)bits;
}

/* Returns the busy part of the last second, or of all time so far if that is shorter. */
unsigned cw_load_second_permille(const cw_load *load);

#endif
