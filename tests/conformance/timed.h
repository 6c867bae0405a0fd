/* SPDX-License-Identifier: MIT
 *
 * timed.h - a bench for one controller in time: a script of levels that last for a while. In every
 * step the level that the controller drives is compared.
 *
 * Lengths are in steps: quanta, or with two rates (timed_fd.h) clocks.
 */
#ifndef TIMED_H
#define TIMED_H

#include "bench.h"

#define TIMED_RUNS 2048u

#define TIMED_TIMINGS 8u
extern const cw_bit_timing timed_timings[TIMED_TIMINGS]; /* 8 to 25 quanta, and one of 50 */

/* Levels of a script that last for so many steps. */
typedef struct timed_run {
    bool bench, node;
    bool alone;  /* the controller sees the level of the bench, whatever it drives itself */
    bool offers; /* the frame is offered to the controller before */
    bool restarts; /* it is asked to leave bus-off before */
    unsigned length;
} timed_run;

/* Lengths of one phase, in steps; sjw in quanta. The rest of a bit follows its sample point. */
typedef struct timed_lengths {
    unsigned quantum, bit, sample, rest, sjw;
} timed_lengths;

typedef struct timed {
    cw_bit_timing timing;
    const struct fd_timing *both; /* of both phases, or NULL */
    timed_lengths n, d;           /* nominal, data */
    cw_tdc tdc;
    cw_frame frame;
    cw_bits bits;
    unsigned runs;
    unsigned modes, tec; /* of the controller in the beginning */
    timed_run run[TIMED_RUNS];
} timed;

/* Begins a script: integration, then idle. The frame is for timed_bits(): its SOF and five
 * recessive bits, a dominant stuff bit (TIMED_STUFF), a dominant bit. */
#define TIMED_STUFF 6u
void timed_begin(timed *t, const cw_bit_timing *timing, bool extended);

/* Begins a script as timed_begin() does, with the offer in time for the first bit after it. */
void timed_begin_sending(timed *t, const cw_bit_timing *timing, bool extended);

/* Begins it when timing, frame and lengths are set. */
void timed_settle(timed *t);

/* Offers the frame in time for the first bit. */
void timed_settle_sending(timed *t);

/* Bench and controller drive these levels for so many steps. */
void timed_put(timed *t, bool bench, bool node, unsigned steps);

/* Does the same, and the controller sees the level of the bench alone. */
void timed_force(timed *t, bool bench, bool node, unsigned steps);

/* The frame is offered before the next run; a restart out of bus-off is requested then. */
void timed_offer(timed *t);
void timed_restart(timed *t);

/* Returns the wire bit at a position. */
unsigned timed_at(const timed *t, cw_field field, unsigned index);

/* Returns the lengths of a phase whose quantum has so many steps. */
timed_lengths timed_lengths_of(const cw_bit_timing *timing, unsigned steps);

/* Returns the steps of a wire bit (D10). */
unsigned timed_length(const timed *t, unsigned n);

/* The bench sends bits of the frame; the controller drives the ACK slot alone. Or the rest of the
 * frame, with intermission: it is received. */
void timed_bits(timed *t, unsigned from, unsigned before);
void timed_rest(timed *t, unsigned from);

/* The controller sends bits of the frame, and the bench acknowledges. Or the rest of the frame,
 * with intermission. */
void timed_sends(timed *t, unsigned from, unsigned before);
void timed_sends_rest(timed *t, unsigned from);

/* An active error flag begins, as a receiver. */
void timed_flag(timed *t);

/* The controller sends an active flag for so many steps, up to the next SOF; or with the frame
 * again. */
void timed_error_frame(timed *t, unsigned flag);
void timed_sends_again(timed *t, unsigned flag);

/* Plays the script by steps of brp clocks (0: by the quantum), and counts it as an elementary test.
 * So many frames, received or sent, errors and protocol exceptions are to be reported. With two
 * rates the received frame is compared. */
void timed_play(const timed *t, unsigned brp, unsigned frames, unsigned errors,
                unsigned exceptions);

/* timed_x.c */
void timed_run_intermission(void);
void timed_run_triple_sampling(void);
void timed_run_suspend(void);
void timed_run_listen_only(void);
void timed_run_recovery(void);

#endif
