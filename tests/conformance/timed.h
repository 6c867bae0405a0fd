/* SPDX-License-Identifier: MIT
 *
 * timed.h - a bench for one controller in time: a script of levels that last so many quanta. In
 * every quantum the level that the controller drives is compared.
 */
#ifndef TIMED_H
#define TIMED_H

#include "bench.h"

#define TIMED_RUNS 1024u

#define TIMED_TIMINGS 8u
extern const cw_bit_timing timed_timings[TIMED_TIMINGS]; /* 8 to 25 quanta, and one of 50 */

/* Levels of a script that last for a while: quanta, or clocks in timed_fd.h. */
typedef struct timed_run {
    bool bench, node;
    bool alone;  /* the controller sees the level of the bench, whatever it drives itself */
    bool offers; /* the frame is offered to the controller before */
    bool restarts; /* it is asked to leave bus-off before */
    unsigned length;
} timed_run;

typedef struct timed {
    cw_bit_timing timing;
    cw_frame frame;
    cw_bits bits;
    unsigned bit, sample, runs;
    unsigned modes, tec; /* of the controller in the beginning */
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

/* Does the same, and the controller sees the level of the bench alone. */
void timed_force(timed *t, bool bench, bool node, unsigned quanta);

/* The frame is offered before the next run; a restart out of bus-off is requested then. */
void timed_offer(timed *t);
void timed_restart(timed *t);

/* Begins a script as timed_begin() does, with the offer in time for the first bit after it. */
void timed_begin_sending(timed *t, const cw_bit_timing *timing, bool extended);

/* The controller sends bits of the frame, and the bench acknowledges. Or the rest of the frame,
 * with intermission. */
void timed_sends(timed *t, unsigned from, unsigned before);
void timed_sends_rest(timed *t, unsigned from);

/* The controller sends an active flag from its second bit on, and then the frame again. */
void timed_sends_again(timed *t, unsigned flag_quanta);

/* Returns the wire bit of a data bit. */
unsigned timed_data_bit(const timed *t, unsigned index);

/* The rest of the frame, with intermission: it is received. Or: an active error flag begins. */
void timed_rest(timed *t, unsigned from);
void timed_flag(timed *t);

/* Plays the script by quanta of brp clocks (0: by the quantum), and counts it as an elementary
 * test. So many frames, received or sent, and errors are to be reported. */
void timed_play(const timed *t, unsigned brp, unsigned frames, unsigned errors);

/* timed_x.c */
void timed_run_intermission(void);
void timed_run_triple_sampling(void);
void timed_run_suspend(void);
void timed_run_listen_only(void);
void timed_run_recovery(void);

#endif
