/* SPDX-License-Identifier: MIT
 *
 * timed.h - a bench for one controller in time: a script of levels that last so many quanta. In
 * every quantum the level that the controller drives is compared.
 */
#ifndef TIMED_H
#define TIMED_H

#include "bench.h"

#define TIMED_RUNS 1024u

typedef struct timed_run {
    bool bench, node;
    unsigned quanta;
} timed_run;

typedef struct timed {
    cw_bit_timing timing;
    cw_bits bits;
    unsigned bit, sample, runs;
    timed_run run[TIMED_RUNS];
} timed;

/* Begins a script: integration, then idle. The frame is for timed_bits(): its SOF and five
 * recessive bits, a dominant stuff bit (TIMED_STUFF), a dominant bit. */
#define TIMED_STUFF 6u
void timed_begin(timed *t, const cw_bit_timing *timing, bool extended);

/* Bench and controller drive these levels for so many quanta. */
void timed_put(timed *t, bool bench, bool node, unsigned quanta);

/* The bench sends bits of the frame; the controller drives the ACK slot alone. */
void timed_bits(timed *t, unsigned from, unsigned before);

/* The rest of the frame, with intermission: it is received. Or: an active error flag begins. */
void timed_rest(timed *t, unsigned from);
void timed_flag(timed *t);

/* Plays the script by quanta of brp clocks (0: by the quantum), and counts it as an elementary
 * test. So many frames and errors are to be reported. */
void timed_play(const timed *t, unsigned brp, unsigned frames, unsigned errors);

#endif
