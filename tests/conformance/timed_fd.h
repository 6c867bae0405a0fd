/* SPDX-License-Identifier: MIT
 *
 * timed_fd.h - a bench for one controller with two rates: a script of levels that last so many
 * clocks. In every clock the level that the controller drives is compared.
 */
#ifndef TIMED_FD_H
#define TIMED_FD_H

#include "timed.h"

#define FD_RUNS 2048u

/* The bit timings of both phases. */
typedef struct fd_timing {
    cw_bit_timing nominal, data;
    unsigned nominal_brp, data_brp;
} fd_timing;

#define FD_TIMINGS 6u
extern const fd_timing fd_timings[FD_TIMINGS];

/* Lengths of one phase, in clocks; sjw in quanta. The rest of a bit follows its sample point. */
typedef struct fd_lengths {
    unsigned quantum, bit, sample, rest, sjw;
} fd_lengths;

typedef struct fd_script {
    const fd_timing *timing;
    fd_lengths n, d; /* nominal, data */
    cw_tdc tdc;
    cw_frame frame;
    cw_bits bits;
    unsigned runs;
    timed_run run[FD_RUNS];
} fd_script;

/* Frames of 16 bytes at most, with BRS and rows of equal bits. */
#define FD_ESI 0x1u          /* ESI is recessive */
#define FD_SLOW 0x2u         /* BRS is dominant */
#define FD_LAST_DOMINANT 0x4u  /* ... the last bit of the CRC, else it is recessive */

/* Begins a script: integration, then idle. */
void fd_begin(fd_script *t, const fd_timing *timing, unsigned kind);

/* Does the same, with the offer in time for the first bit after it. */
void fd_begin_sending(fd_script *t, const fd_timing *timing, unsigned kind);

/* Bench and controller drive these levels for so many clocks. */
void fd_put(fd_script *t, bool bench, bool node, unsigned clocks);

/* Does the same, and the controller sees the level of the bench alone. */
void fd_force(fd_script *t, bool bench, bool node, unsigned clocks);

/* Returns the wire bit at a position; of the first dominant stuff bit in the data phase; of a
 * recessive data bit between dominant ones. */
unsigned fd_at(const fd_script *t, cw_field field, unsigned index);
unsigned fd_stuff_bit(const fd_script *t);
unsigned fd_single_recessive(const fd_script *t);

/* Returns the clocks of a wire bit (D10). */
unsigned fd_length(const fd_script *t, unsigned n);

/* The bench sends bits of the frame, and the controller acknowledges; or the rest of the frame,
 * which is received. */
void fd_bits(fd_script *t, unsigned from, unsigned before);
void fd_rest(fd_script *t, unsigned from);

/* The controller sends bits of the frame, and the bench acknowledges. Or the rest of the frame. */
void fd_sends(fd_script *t, unsigned from, unsigned before);
void fd_sends_rest(fd_script *t, unsigned from);

/* The controller sends the frame up to a moment, in clocks since SOF. It sees its own level so many
 * clocks late. In one clock it sees the other level; FD_NEVER: it does not. */
#define FD_NEVER UINT32_MAX
void fd_sends_late(fd_script *t, unsigned until, unsigned delay, unsigned disturbed);

/* Returns the clocks from SOF to the begin of a wire bit. */
unsigned fd_begin_of(const fd_script *t, unsigned n);

/* Returns those to the first sample point of the data phase at or after a moment, with that of the
 * CRC delimiter. */
unsigned fd_next_sample(const fd_script *t, unsigned moment);

/* The frame is sent and acknowledged, with its own level delayed. In one clock, see above. */
void fd_sends_delayed(fd_script *t, unsigned delay, unsigned disturbed);

/* Plays such a transmission, of a frame with a recessive last bit of the CRC, three times. In one
 * clock the own level is another one. At the secondary sample point of bit n that is an error,
 * right before or after it is none. */
void fd_check_compared(fd_script *t, const cw_tdc *tdc, unsigned delay, unsigned n);

/* An active flag begins, as a receiver. Or as a transmitter, up to the next SOF; or with the frame
 * again. */
void fd_flag(fd_script *t);
void fd_error_frame(fd_script *t);
void fd_sends_again(fd_script *t);

/* timed_x_fd.c */
void timed_run_transmitter_at_res(void);
void timed_run_stuff_bit_after_fdf(void);
void timed_run_delimiter_with_tdc(void);
void timed_run_last_compared(void);
void timed_run_first_compared(void);
void timed_run_edges_after_exception(void);

/* Plays the script and counts it as an elementary test. So many frames, received as they are or
 * sent, and errors and protocol exceptions are to be reported. */
void fd_play(const fd_script *t, unsigned frames, unsigned errors, unsigned exceptions);

#endif
