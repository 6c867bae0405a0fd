/* SPDX-License-Identifier: MIT
 *
 * pcs.h - synchronisation of one controller to the edges that it sees (T3 to T6). It counts quanta
 * of the present bit and knows no time.
 */
#ifndef CANWIRE_TIME_PCS_H
#define CANWIRE_TIME_PCS_H

#include "canwire.h"

/* The effect of an edge on the bit in progress. */
typedef enum cw_edge_effect {
    CW_EDGE_IGNORED = 0, /* nothing (T3, T6) */
    CW_EDGE_RESYNCED,    /* the bit is longer or shorter now, or as it was (T5) */
    CW_EDGE_RESTARTS,    /* the bit begins anew, with the quantum of the edge (T4) */
    CW_EDGE_ENDS_BIT,    /* the next bit began with the quantum of the edge (T4, T5) */
} cw_edge_effect;

/* Begins a bit. */
void cw_pcs_begin_bit(cw_pcs *pcs, const cw_bit_timing *timing);

/* Goes on with a bit at another rate, at its sample point: as if it had been at that rate since its
 * start (D10). */
void cw_pcs_change_rate(cw_pcs *pcs, const cw_bit_timing *timing);

/* Notes that the bit has been sampled. */
static inline void cw_pcs_sampled(cw_pcs *pcs, bool level)
{
    pcs->sampled = true;
    pcs->synchronised = false;
    pcs->last_sample = level;
}

/* Returns true when an edge before the next sample point can synchronise (T3). */
static inline bool cw_pcs_is_open(const cw_pcs *pcs)
{
    return !pcs->synchronised && pcs->last_sample == CW_RECESSIVE;
}

/* Takes an edge from recessive to dominant that came in quantum `in` of the bit, 0 being Sync_Seg.
 * driven: the own level. hard: the controller synchronises hard now (T4). */
cw_edge_effect cw_pcs_take_edge(cw_pcs *pcs, const cw_bit_timing *timing, unsigned in, bool driven,
                                bool hard);

#endif
