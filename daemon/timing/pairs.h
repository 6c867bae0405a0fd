/* SPDX-License-Identifier: MIT
 *
 * pairs.h - two nodes of a bus: how far their clocks and their places may be apart. Rule T10.
 *
 * All results are whole numbers. Limits are rounded down, and what counts against them is rounded
 * up.
 */
#ifndef CANWIRE_TIMING_PAIRS_H
#define CANWIRE_TIMING_PAIRS_H

#include "timing/bittiming.h"

#include <stddef.h>

/* One node of a bus. Times are in picoseconds, at most 10 ms each. */
typedef struct timing_node {
    bit_timing bit;
    int32_t ppm;          /* error of its clock, more than -1000000 */
    uint32_t delay_tq;    /* tq of a bit that are for delays: Prop_Seg, or more of what precedes the
                             sample point */
    uint64_t place_ps;    /* the way along the line to the node, from one end */
    uint64_t stub_ps;     /* the way from the line to the node */
    uint64_t transfer_ps; /* delays of transmitter and receiver, of the slower kind of edge each */
} timing_node;

/* Two nodes: their need, and the limits of T10 for it. */
typedef struct timing_pair {
    uint32_t need_ppb;       /* half of the difference of their clocks: what df stands for in T10 */
    uint32_t tolerance_ppb;  /* the smaller tolerance of both */
    uint32_t sufficient_ppb; /* the same with the limits that hold at the resolution of a quantum */
    uint64_t round_trip_ps;
    uint64_t delays_ps;      /* the longest allowed round trip */
    uint64_t longest_ps;     /* of the line between them and their stubs, one way; 0: none */
    bool trip_is_seen;       /* the round trip takes at least 1 tq of both */
} timing_pair;

/* Compares two nodes. */
timing_pair timing_pair_of(const timing_node *a, const timing_node *b);

/* Return the tolerance, and the time for delays, that are left; less than 0: so much is missing. */
int64_t timing_tolerance_left_ppb(const timing_pair *pair);
int64_t timing_sufficient_left_ppb(const timing_pair *pair);
int64_t timing_delays_left_ps(const timing_pair *pair);

/* Returns the largest need_ppb with which frames are right (T10). It is the tolerance where the
 * round trip takes at least 1 tq, otherwise the sufficient one. */
uint32_t timing_limit_ppb(const timing_pair *pair);

/* Returns the way of an edge along the line and both stubs. */
uint64_t timing_way_ps(const timing_node *a, const timing_node *b);

/* The other nodes that leave a node least. */
typedef struct timing_worst {
    size_t clock;             /* index of the node that leaves the least tolerance ... */
    size_t line;              /* ... and of the one that leaves the least time for delays */
    timing_pair clock_pair;
    timing_pair line_pair;
    unsigned resynchronisations; /* of the longest frame, from the node whose clock differs most */
} timing_worst;

/* Compares node i of at least two with all others. */
timing_worst timing_worst_of(const timing_node *nodes, size_t count, size_t i);

/* Returns how many edges of the longest classical frame a receiver resynchronises on, when the
 * clocks of the pair need so much tolerance. Edges are ten bits apart, from SOF to the end of the
 * CRC, and the last one is that of ACK. An edge counts when the phase error is at least 1 tq. */
unsigned timing_resynchronisations(const bit_timing *t, uint32_t need_ppb);

#endif
