/* SPDX-License-Identifier: MIT
 *
 * bit_moments.h - the moments of nodes with clocks of their own in a bit time, by time. They are
 * quanta, sample points, synchronisations, and levels that nodes put onto the wire.
 */
#ifndef CANWIRE_RECORD_BIT_MOMENTS_H
#define CANWIRE_RECORD_BIT_MOMENTS_H

#include "canwire.h"

#define BIT_MARKS_MAX 65535u /* of one bit time; 64 nodes at 64 times the bit rate have fewer */

/* The quanta of each node, from bit time to bit time. */
typedef struct bit_clocks {
    cw_span next[CW_NODES_MAX];    /* the start of the next quantum, since that of the bit time */
    cw_span quantum[CW_NODES_MAX]; /* 0: not known yet */
} bit_clocks;

/* A walk through one bit time. */
typedef struct bit_walk {
    const cw_bit_view *bit;
    bit_clocks *clocks;
    cw_span length; /* of the bit time */
    unsigned next;  /* mark */
    unsigned count;
    uint16_t order[BIT_MARKS_MAX];
} bit_walk;

typedef struct bit_moment {
    cw_span at; /* since the start of the bit time */
    unsigned node;
    const cw_mark *mark; /* NULL: a quantum begins */
} bit_moment;

/* Returns true for a bit time like those that may be left out: all nodes rest, and none sees an
 * edge. */
bool bit_rests(const cw_bit_view *bit);

/* Begins the walk through a bit time; each bit time must be walked through, to its end. */
void bit_walk_begin(bit_walk *walk, bit_clocks *clocks, const cw_bit_view *bit);

/* Returns the next moment. Quanta begin before what else happens at a moment. Returns false at the
 * end of the bit time. */
bool bit_walk_next(bit_walk *walk, bit_moment *moment);

/* Returns a span in units of time, so many to a tick, rounded down. */
uint64_t bit_moment_units(cw_span at, unsigned units_per_tick);

#endif
