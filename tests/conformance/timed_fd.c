/* SPDX-License-Identifier: MIT
 *
 * timed_fd.c - a bench for one controller with two rates.
 */
#include "timed_fd.h"

#include <stdlib.h>

#define TIMING(prop, seg1, seg2, width) \
    {.quantum = CW_TICK, .prop_seg = prop, .phase_seg1 = seg1, .phase_seg2 = seg2, .sjw = width}

const fd_timing fd_timings[FD_TIMINGS] = {
    {TIMING(6, 7, 6, 4), TIMING(2, 3, 4, 2), 1, 1}, {TIMING(6, 7, 6, 4), TIMING(2, 3, 4, 2), 3, 3},
    {TIMING(7, 8, 4, 4), TIMING(0, 6, 3, 3), 2, 1}, {TIMING(3, 4, 2, 2), TIMING(0, 5, 2, 1), 4, 2},
    {TIMING(10, 5, 4, 3), TIMING(1, 7, 5, 4), 1, 2},
    {TIMING(47, 16, 16, 16), TIMING(6, 5, 4, 4), 1, 1},
};

unsigned fd_stuff_bit(const timed *t)
{
    unsigned n = timed_at(t, CW_FIELD_ESI, 0) + 1;
    while (!cw_bits_place(&t->bits, n).stuff || cw_bits_level(&t->bits, n))
        n++;
    return n;
}

unsigned fd_single_recessive(const timed *t)
{
    unsigned n = timed_at(t, CW_FIELD_DATA, 0) + 1;
    while (cw_bits_level(&t->bits, n - 1) || !cw_bits_level(&t->bits, n) ||
           cw_bits_level(&t->bits, n + 1))
        n++;
    return n;
}

/* Finds an identifier with which the CRC ends as wanted. */
static void choose_frame(timed *t, unsigned kind)
{
    t->frame = (cw_frame){.flags = CW_FRAME_FD, .dlc = 3, .data = {0xFF, 0x5A, 0x00}};
    t->frame.flags |= kind & FD_ESI ? CW_FRAME_ESI : 0;
    t->frame.flags |= kind & FD_SLOW ? 0 : CW_FRAME_BRS;
    for (t->frame.id = 0x155;; t->frame.id++) {
        if (cw_bits_encode(&t->bits, &t->frame) != CW_OK)
            abort();
        const unsigned last = timed_at(t, CW_FIELD_CRC_DELIMITER, 0) - 1;
        if (cw_bits_level(&t->bits, last) == !(kind & FD_LAST_DOMINANT))
            return;
    }
}

void fd_begin(timed *t, const fd_timing *timing, unsigned kind)
{
    *t = (timed){.both = timing,
                 .n = timed_lengths_of(&timing->nominal, timing->nominal_brp),
                 .d = timed_lengths_of(&timing->data, timing->data_brp),
                 .tdc = {.mode = CW_TDC_OFF}};
    choose_frame(t, kind);
    timed_settle(t);
}

/* The frame of an error-active transmitter has a dominant ESI. */
void fd_begin_sending(timed *t, const fd_timing *timing, unsigned kind)
{
    fd_begin(t, timing, kind);
    timed_settle_sending(t);
}

unsigned fd_begin_of(const timed *t, unsigned n)
{
    unsigned clocks = 0;
    for (unsigned i = 0; i < n; i++)
        clocks += timed_length(t, i);
    return clocks;
}

/* Returns the own level in a clock, with the bit that it was in last, which is moved on. */
static bool own_level(const timed *t, int clock, unsigned *n, int *end)
{
    while (clock >= *end)
        *end += (int)timed_length(t, ++*n);
    return clock < 0 || cw_bits_level(&t->bits, *n);
}

void fd_sends_late(timed *t, unsigned until, unsigned delay, unsigned disturbed)
{
    unsigned n = 0, late_n = 0, clocks = 0;
    int end = (int)timed_length(t, 0), late_end = end;
    bool level = false, seen = false;
    for (unsigned clock = 0; clock < until; clock++) {
        const bool now = own_level(t, (int)clock, &n, &end);
        const bool late = own_level(t, (int)clock - (int)delay, &late_n, &late_end) !=
                          (clock == disturbed);
        if (clocks > 0 && (now != level || late != seen)) {
            timed_force(t, seen, level, clocks);
            clocks = 0;
        }
        level = now;
        seen = late;
        clocks++;
    }
    timed_force(t, seen, level, clocks);
}

/* ---- Secondary sample points ----------------------------------------------------------------- */

unsigned fd_next_sample(const timed *t, unsigned moment)
{
    unsigned n = timed_at(t, CW_FIELD_ESI, 0);
    while (fd_begin_of(t, n) + t->d.sample < moment)
        n++;
    return fd_begin_of(t, n) + t->d.sample;
}

void fd_sends_delayed(timed *t, unsigned delay, unsigned disturbed)
{
    const unsigned ack = timed_at(t, CW_FIELD_ACK_SLOT, 0);
    fd_sends_late(t, fd_begin_of(t, ack), delay, disturbed);
    timed_sends_rest(t, ack);
}

void fd_check_compared(timed *t, const cw_tdc *tdc, unsigned delay, unsigned n)
{
    for (int where = -1; where <= 1; where++) {
        fd_begin_sending(t, t->both, 0);
        t->tdc = *tdc;
        const unsigned after = delay + tdc->tdco;
        const unsigned compared = fd_begin_of(t, n) + (after ? after : 1); /* D13, T12 */
        if (where == 0) {
            fd_sends_late(t, fd_next_sample(t, compared), delay, compared - 1);
            const bool level = t->run[t->runs - 1].node;
            timed_force(t, CW_RECESSIVE, level, t->n.rest);
            timed_error_frame(t, 6 * t->n.bit);
            fd_sends_delayed(t, delay, FD_NEVER);
        } else {
            fd_sends_delayed(t, delay, (unsigned)((int)compared - 1 + where));
        }
        fd_play(t, 1, where == 0, 0);
    }
}

void fd_play(const timed *t, unsigned frames, unsigned errors, unsigned exceptions)
{
    timed_play(t, 1, frames, errors, exceptions);
}
