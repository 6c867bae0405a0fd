/* SPDX-License-Identifier: MIT
 *
 * timed_x_fd.c - cases of our own, inside the bits of FD frames: rulings on D12, D13 and D16.
 */
#include "timed_fd.h"

static timed script;

/* ---- D12 ------------------------------------------------------------------------------------- */

/* Another node is ahead of the transmitter: the edge to res comes in the FDF bit, earlier than SJW.
 * The transmitter resynchronises. It would follow the edge if it synchronised hard there. */
void timed_run_transmitter_at_res(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        for (unsigned e = fd_timings[i].nominal.sjw + 1u;
             e <= fd_timings[i].nominal.phase_seg2; e++) {
            timed *t = &script;
            fd_begin_sending(t, &fd_timings[i], 0);
            const unsigned fdf = timed_at(t, CW_FIELD_FDF, 0);
            timed_sends(t, 0, fdf);
            timed_put(t, CW_RECESSIVE, CW_RECESSIVE, t->n.bit - e * t->n.quantum);
            timed_put(t, CW_DOMINANT, CW_RECESSIVE, (e - t->n.sjw) * t->n.quantum);
            timed_sends_rest(t, fdf + 1);
            fd_play(t, 1, 0, 0);
        }
}

/* An extended frame with a recessive RRS, which no controller sends. Three bits of the identifier
 * before it are recessive, so FDF is the fifth, and a stuff bit is due. Its edge comes late, by
 * more than SJW, and it is short: a receiver that resynchronises samples it, one that synchronised
 * hard would not. Res is recessive then: a protocol exception. */
void timed_run_stuff_bit_after_fdf(void)
{
    static const char bits[] = "d" "rdrdrdrdrdr" "rr" "d" "drdrdrdrdrdrdd" "rrr" "r" "r";
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        for (unsigned e = fd_timings[i].nominal.sjw + 1u;
             e < cw_bit_timing_sample_at(&fd_timings[i].nominal); e++) {
            timed *t = &script;
            fd_begin(t, &fd_timings[i], 0);
            for (const char *bit = bits; *bit; bit++)
                timed_put(t, *bit == 'r', CW_RECESSIVE, t->n.bit);
            timed_put(t, CW_RECESSIVE, CW_RECESSIVE, e * t->n.quantum);
            timed_put(t, CW_DOMINANT, CW_RECESSIVE, t->n.sample - (e - t->n.sjw) * t->n.quantum);
            timed_put(t, CW_RECESSIVE, CW_RECESSIVE, 14 * t->n.bit);
            fd_play(t, 0, 0, 1);
        }
}

/* ---- D13 ------------------------------------------------------------------------------------- */

/* Returns a delay that is too long. Shorter ones, from a sample point on, show the last bit of the
 * CRC at the sample point of the CRC delimiter. */
static unsigned longest_delay(const timed *t)
{
    const unsigned most = t->n.sample - 2;
    return most < 2 * t->d.bit ? most : 2 * t->d.bit;
}

/* The wire is dominant at the sample point of the own delimiter, which has not come back yet. */
void timed_run_delimiter_with_tdc(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++) {
        timed *t = &script;
        fd_begin(t, &fd_timings[i], 0);
        for (unsigned delay = t->d.sample; delay < longest_delay(t); delay++) {
            fd_begin_sending(t, &fd_timings[i], FD_LAST_DOMINANT);
            t->tdc = (cw_tdc){.mode = CW_TDC_AUTO, .tdco = t->d.sample};
            fd_sends_delayed(t, delay, FD_NEVER);
            fd_play(t, 1, 0, 0);
        }
    }
}

/* The secondary sample point of the last bit of the CRC is the sample point of the delimiter, or
 * one clock behind it. There the own level is another one. */
static void check_last(const fd_timing *timing, unsigned delay, bool behind)
{
    timed *t = &script;
    fd_begin_sending(t, timing, FD_LAST_DOMINANT);
    t->tdc = (cw_tdc){.mode = CW_TDC_AUTO, .tdco = t->d.bit + t->d.sample - delay + behind};
    const unsigned sample = fd_begin_of(t, timed_at(t, CW_FIELD_CRC_DELIMITER, 0)) + t->d.sample;
    if (behind) {
        fd_sends_delayed(t, delay, sample);
    } else {
        fd_sends_late(t, sample, delay, sample - 1);
        timed_force(t, CW_RECESSIVE, CW_RECESSIVE, t->n.rest);
        timed_error_frame(t, 6 * t->n.bit);
        fd_sends_delayed(t, delay, FD_NEVER);
    }
    fd_play(t, 1, !behind, 0);
}

void timed_run_last_compared(void)
{
    for (unsigned i = 0; i < 2 * FD_TIMINGS; i++) {
        fd_begin(&script, &fd_timings[i / 2], 0);
        const unsigned most = script.d.bit + script.d.sample; /* the level must have come back */
        for (unsigned delay = script.d.sample + 1; delay < most && delay < longest_delay(&script);
             delay++)
            check_last(&fd_timings[i / 2], delay, i & 1);
    }
}

/* Without delay tdcv is 0. A look at 0 is taken after one clock (T12). */
void timed_run_first_compared(void)
{
    static const cw_tdc none[] = {{.mode = CW_TDC_AUTO}, {.mode = CW_TDC_MANUAL}};
    for (unsigned i = 0; i < 2 * FD_TIMINGS; i++) {
        fd_begin(&script, &fd_timings[i / 2], 0);
        fd_check_compared(&script, &none[i & 1], 0, fd_single_recessive(&script));
    }
}

/* ---- D16 ------------------------------------------------------------------------------------- */

/* After a protocol exception: a pulse of a quantum between two sample points, behind so many
 * recessive bits, restarts the eleven. A node that is idle acknowledges the frame that comes then;
 * one that still counts does not. */
static void check_exception(const fd_timing *timing, unsigned bits, bool pulse)
{
    timed *t = &script;
    fd_begin(t, timing, 0);
    const unsigned res = timed_at(t, CW_FIELD_RES, 0), ack = timed_at(t, CW_FIELD_ACK_SLOT, 0);
    timed_bits(t, 0, res);
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, t->n.bit);
    timed_put(t, CW_DOMINANT, CW_RECESSIVE, t->n.bit); /* now the eleven begin */
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, bits * t->n.bit);
    timed_put(t, pulse ? CW_DOMINANT : CW_RECESSIVE, CW_RECESSIVE, t->n.quantum);
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, 11 * t->n.bit - bits * t->n.bit - t->n.quantum);
    if (!pulse) {
        timed_rest(t, 0);
    } else {
        for (unsigned n = 0; n < t->bits.length; n++)
            timed_put(t, cw_bits_level(&t->bits, n) && n != ack, CW_RECESSIVE, timed_length(t, n));
        timed_put(t, CW_RECESSIVE, CW_RECESSIVE, 4 * t->n.bit);
    }
    fd_play(t, !pulse, 0, 1);
}

void timed_run_edges_after_exception(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        for (unsigned bits = 1; bits < 11; bits++)
            for (unsigned pulse = 0; pulse < 2; pulse++)
                check_exception(&fd_timings[i], bits, pulse);
}
