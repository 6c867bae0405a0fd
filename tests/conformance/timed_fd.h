/* SPDX-License-Identifier: MIT
 *
 * timed_fd.h - a bench for one controller with two rates. Steps of its scripts are clocks.
 */
#ifndef TIMED_FD_H
#define TIMED_FD_H

#include "timed.h"

/* The bit timings of both phases. */
typedef struct fd_timing {
    cw_bit_timing nominal, data;
    unsigned nominal_brp, data_brp;
} fd_timing;

#define FD_TIMINGS 6u
extern const fd_timing fd_timings[FD_TIMINGS];

/* Frames of 16 bytes at most, with BRS and rows of equal bits. */
#define FD_ESI 0x1u          /* ESI is recessive */
#define FD_SLOW 0x2u         /* BRS is dominant */
#define FD_LAST_DOMINANT 0x4u  /* ... the last bit of the CRC, else it is recessive */

/* Begins a script: integration, then idle. */
void fd_begin(timed *t, const fd_timing *timing, unsigned kind);

/* Does the same, with the offer in time for the first bit after it. */
void fd_begin_sending(timed *t, const fd_timing *timing, unsigned kind);

/* Returns the first dominant stuff bit in the data phase; a recessive data bit between dominant
 * ones. */
unsigned fd_stuff_bit(const timed *t);
unsigned fd_single_recessive(const timed *t);

/* The controller sends the frame up to a moment, in clocks since SOF. It sees its own level so many
 * clocks late. In one clock it sees the other level; FD_NEVER: it does not. */
#define FD_NEVER UINT32_MAX
void fd_sends_late(timed *t, unsigned until, unsigned delay, unsigned disturbed);

/* Returns the clocks from SOF to the begin of a wire bit. */
unsigned fd_begin_of(const timed *t, unsigned n);

/* Returns those to the first sample point of the data phase at or after a moment, with that of the
 * CRC delimiter. */
unsigned fd_next_sample(const timed *t, unsigned moment);

/* The frame is sent and acknowledged, with its own level delayed. In one clock, see above. */
void fd_sends_delayed(timed *t, unsigned delay, unsigned disturbed);

/* Plays such a transmission, of a frame with a recessive last bit of the CRC, three times. In one
 * clock the own level is another one. At the secondary sample point of bit n that is an error,
 * right before or after it is none. */
void fd_check_compared(timed *t, const cw_tdc *tdc, unsigned delay, unsigned n);

/* timed_x_fd.c */
void timed_run_transmitter_at_res(void);
void timed_run_stuff_bit_after_fdf(void);
void timed_run_delimiter_with_tdc(void);
void timed_run_last_compared(void);
void timed_run_first_compared(void);
void timed_run_edges_after_exception(void);

/* Plays the script by clocks. */
void fd_play(const timed *t, unsigned frames, unsigned errors, unsigned exceptions);

#endif
