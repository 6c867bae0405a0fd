/* SPDX-License-Identifier: MIT
 *
 * timed_fd.c - a bench for one controller with two rates.
 */
#include "timed_fd.h"

#include <stdlib.h>

#define SETTLE_BITS 14u
#define AFTER_BITS 4u /* intermission and a bit of idle */

#define TIMING(prop, seg1, seg2, width) \
    {.quantum = CW_TICK, .prop_seg = prop, .phase_seg1 = seg1, .phase_seg2 = seg2, .sjw = width}

const fd_timing fd_timings[FD_TIMINGS] = {
    {TIMING(6, 7, 6, 4), TIMING(2, 3, 4, 2), 1, 1}, {TIMING(6, 7, 6, 4), TIMING(2, 3, 4, 2), 3, 3},
    {TIMING(7, 8, 4, 4), TIMING(0, 6, 3, 3), 2, 1}, {TIMING(3, 4, 2, 2), TIMING(0, 5, 2, 1), 4, 2},
    {TIMING(10, 5, 4, 3), TIMING(1, 7, 5, 4), 1, 2},
    {TIMING(47, 16, 16, 16), TIMING(6, 5, 4, 4), 1, 1},
};

/* ---- Lengths --------------------------------------------------------------------------------- */

static fd_lengths lengths_of(const cw_bit_timing *timing, unsigned brp)
{
    const unsigned bit = cw_bit_timing_quanta(timing), sample = cw_bit_timing_sample_at(timing);
    return (fd_lengths){.quantum = brp, .bit = bit * brp, .sample = sample * brp,
                        .rest = (bit - sample) * brp, .sjw = timing->sjw};
}

unsigned fd_at(const fd_script *t, cw_field field, unsigned index)
{
    unsigned n = 0;
    while (!cw_bits_is_at(&t->bits, n, field, index))
        if (++n == t->bits.length)
            abort();
    return n;
}

unsigned fd_stuff_bit(const fd_script *t)
{
    unsigned n = fd_at(t, CW_FIELD_ESI, 0) + 1;
    while (!cw_bits_place(&t->bits, n).stuff || cw_bits_level(&t->bits, n))
        n++;
    return n;
}

unsigned fd_single_recessive(const fd_script *t)
{
    unsigned n = fd_at(t, CW_FIELD_DATA, 0) + 1;
    while (cw_bits_level(&t->bits, n - 1) || !cw_bits_level(&t->bits, n) ||
           cw_bits_level(&t->bits, n + 1))
        n++;
    return n;
}

unsigned fd_length(const fd_script *t, unsigned n)
{
    const bool slow = !(t->frame.flags & CW_FRAME_BRS);
    if (!slow && n == fd_at(t, CW_FIELD_BRS, 0))
        return t->n.sample + t->d.rest;
    if (!slow && n == fd_at(t, CW_FIELD_CRC_DELIMITER, 0))
        return t->d.sample + t->n.rest;
    const bool fast = !slow && n > fd_at(t, CW_FIELD_BRS, 0) &&
                      n < fd_at(t, CW_FIELD_CRC_DELIMITER, 0);
    return fast ? t->d.bit : t->n.bit;
}

/* ---- Scripts --------------------------------------------------------------------------------- */

static timed_run *add_run(fd_script *t, bool bench, bool node, unsigned clocks)
{
    if (t->runs == FD_RUNS)
        abort();
    timed_run *run = &t->run[t->runs++];
    run->bench = bench;
    run->node = node;
    run->length = clocks;
    run->alone = false;
    return run;
}

void fd_put(fd_script *t, bool bench, bool node, unsigned clocks)
{
    if (clocks)
        (void)add_run(t, bench, node, clocks);
}

void fd_force(fd_script *t, bool bench, bool node, unsigned clocks)
{
    if (clocks)
        add_run(t, bench, node, clocks)->alone = true;
}

/* Finds an identifier with which the CRC ends as wanted. */
static void choose_frame(fd_script *t, unsigned kind)
{
    t->frame = (cw_frame){.flags = CW_FRAME_FD, .dlc = 3, .data = {0xFF, 0x5A, 0x00}};
    t->frame.flags |= kind & FD_ESI ? CW_FRAME_ESI : 0;
    t->frame.flags |= kind & FD_SLOW ? 0 : CW_FRAME_BRS;
    for (t->frame.id = 0x155;; t->frame.id++) {
        if (cw_bits_encode(&t->bits, &t->frame) != CW_OK)
            abort();
        const unsigned last = fd_at(t, CW_FIELD_CRC_DELIMITER, 0) - 1;
        if (cw_bits_level(&t->bits, last) == !(kind & FD_LAST_DOMINANT))
            return;
    }
}

void fd_begin(fd_script *t, const fd_timing *timing, unsigned kind)
{
    t->timing = timing;
    t->n = lengths_of(&timing->nominal, timing->nominal_brp);
    t->d = lengths_of(&timing->data, timing->data_brp);
    t->tdc = (cw_tdc){.mode = CW_TDC_OFF};
    t->runs = 0;
    for (unsigned i = 0; i < FD_RUNS; i++)
        t->run[i].offers = false;
    choose_frame(t, kind);
    fd_put(t, CW_RECESSIVE, CW_RECESSIVE, SETTLE_BITS * t->n.bit);
}

/* The frame of an error-active transmitter has a dominant ESI. */
void fd_begin_sending(fd_script *t, const fd_timing *timing, unsigned kind)
{
    fd_begin(t, timing, kind);
    t->run[0].length -= t->n.bit;
    t->run[t->runs].offers = true;
    fd_put(t, CW_RECESSIVE, CW_RECESSIVE, t->n.bit);
}

void fd_bits(fd_script *t, unsigned from, unsigned before)
{
    const unsigned ack = fd_at(t, CW_FIELD_ACK_SLOT, 0);
    for (unsigned n = from; n < before; n++)
        fd_put(t, cw_bits_level(&t->bits, n), n != ack, fd_length(t, n));
}

void fd_rest(fd_script *t, unsigned from)
{
    fd_bits(t, from, t->bits.length);
    fd_put(t, CW_RECESSIVE, CW_RECESSIVE, AFTER_BITS * t->n.bit);
}

void fd_sends(fd_script *t, unsigned from, unsigned before)
{
    const unsigned ack = fd_at(t, CW_FIELD_ACK_SLOT, 0);
    for (unsigned n = from; n < before; n++)
        fd_put(t, n != ack, cw_bits_level(&t->bits, n), fd_length(t, n));
}

void fd_sends_rest(fd_script *t, unsigned from)
{
    fd_sends(t, from, t->bits.length);
    fd_put(t, CW_RECESSIVE, CW_RECESSIVE, AFTER_BITS * t->n.bit);
}

unsigned fd_begin_of(const fd_script *t, unsigned n)
{
    unsigned clocks = 0;
    for (unsigned i = 0; i < n; i++)
        clocks += fd_length(t, i);
    return clocks;
}

/* Returns the own level in a clock, with the bit that it was in last, which is moved on. */
static bool own_level(const fd_script *t, int clock, unsigned *n, int *end)
{
    while (clock >= *end)
        *end += (int)fd_length(t, ++*n);
    return clock < 0 || cw_bits_level(&t->bits, *n);
}

void fd_sends_late(fd_script *t, unsigned until, unsigned delay, unsigned disturbed)
{
    unsigned n = 0, late_n = 0, clocks = 0;
    int end = (int)fd_length(t, 0), late_end = end;
    bool level = false, seen = false;
    for (unsigned clock = 0; clock < until; clock++) {
        const bool now = own_level(t, (int)clock, &n, &end);
        const bool late = own_level(t, (int)clock - (int)delay, &late_n, &late_end) !=
                          (clock == disturbed);
        if (clocks > 0 && (now != level || late != seen)) {
            fd_force(t, seen, level, clocks);
            clocks = 0;
        }
        level = now;
        seen = late;
        clocks++;
    }
    fd_force(t, seen, level, clocks);
}

void fd_flag(fd_script *t)
{
    fd_put(t, CW_RECESSIVE, CW_DOMINANT, 6 * t->n.bit);
    fd_put(t, CW_RECESSIVE, CW_RECESSIVE, 12 * t->n.bit);
}

void fd_error_frame(fd_script *t)
{
    fd_put(t, CW_RECESSIVE, CW_DOMINANT, 6 * t->n.bit);
    fd_put(t, CW_RECESSIVE, CW_RECESSIVE, 11 * t->n.bit);
}

void fd_sends_again(fd_script *t)
{
    fd_error_frame(t);
    fd_sends_rest(t, 0);
}

/* ---- Secondary sample points ----------------------------------------------------------------- */

unsigned fd_next_sample(const fd_script *t, unsigned moment)
{
    unsigned n = fd_at(t, CW_FIELD_ESI, 0);
    while (fd_begin_of(t, n) + t->d.sample < moment)
        n++;
    return fd_begin_of(t, n) + t->d.sample;
}

void fd_sends_delayed(fd_script *t, unsigned delay, unsigned disturbed)
{
    const unsigned ack = fd_at(t, CW_FIELD_ACK_SLOT, 0);
    fd_sends_late(t, fd_begin_of(t, ack), delay, disturbed);
    fd_sends_rest(t, ack);
}

void fd_check_compared(fd_script *t, const cw_tdc *tdc, unsigned delay, unsigned n)
{
    for (int where = -1; where <= 1; where++) {
        fd_begin_sending(t, t->timing, 0);
        t->tdc = *tdc;
        const unsigned after = delay + tdc->tdco;
        const unsigned compared = fd_begin_of(t, n) + (after ? after : 1); /* D13, T12 */
        if (where == 0) {
            fd_sends_late(t, fd_next_sample(t, compared), delay, compared - 1);
            const bool level = t->run[t->runs - 1].node;
            fd_force(t, CW_RECESSIVE, level, t->n.rest);
            fd_error_frame(t);
            fd_sends_delayed(t, delay, FD_NEVER);
        } else {
            fd_sends_delayed(t, delay, (unsigned)((int)compared - 1 + where));
        }
        fd_play(t, 1, where == 0, 0);
    }
}

/* ---- Playing --------------------------------------------------------------------------------- */

typedef struct counts {
    unsigned frames, errors, exceptions;
    bool other_frame;
} counts;

static void count(counts *c, const fd_script *t, const cw_timed_mac *mac, const cw_mac_report *r)
{
    c->frames += (r->what & (CW_REPORT_RX | CW_REPORT_TX)) != 0;
    c->errors += (r->what & CW_REPORT_ERROR) != 0;
    c->exceptions += (r->what & CW_REPORT_EXCEPTION) != 0;
    if ((r->what & CW_REPORT_RX) && !cw_frame_equal(cw_mac_received(&mac->mac), &t->frame))
        c->other_frame = true;
}

static const char *run_all(cw_timed_mac *c, const fd_script *t, counts *seen)
{
    cw_mac_report report;
    for (unsigned i = 0; i < t->runs; i++) {
        const timed_run *run = &t->run[i];
        if (run->offers && cw_mac_offer(&c->mac, &t->frame) != CW_OK)
            return "the frame is refused";
        for (unsigned k = 0; k < run->length; k++) {
            const bool own = cw_timed_mac_level(c);
            if (own != run->node)
                return "the controller drives another level";
            const bool level = run->alone ? run->bench : run->bench && own;
            if (cw_timed_mac_clock(c, level, &report) & CW_QUANTUM_SAMPLED)
                count(seen, t, c, &report);
        }
    }
    return NULL;
}

static const char *play(const fd_script *t, const counts *expected)
{
    cw_timed_mac c;
    cw_fd_part part;
    counts seen = {0};
    if (cw_timed_mac_init(&c, &t->timing->nominal, t->timing->nominal_brp, 0, 96) != CW_OK ||
        cw_mac_set_protocol(&c.mac, CW_FD, &part) != CW_OK ||
        cw_timed_mac_set_data(&c, &t->timing->data, t->timing->data_brp, &t->tdc) != CW_OK)
        return "the timing is refused";
    const char *problem = run_all(&c, t, &seen);
    if (problem)
        return problem;
    if (seen.other_frame)
        return "another frame is received";
    if (seen.frames != expected->frames)
        return "frames are missing, or too many";
    if (seen.exceptions != expected->exceptions)
        return "wrong number of protocol exceptions";
    return seen.errors != expected->errors ? "wrong number of errors" : NULL;
}

void fd_play(const fd_script *t, unsigned frames, unsigned errors, unsigned exceptions)
{
    const counts expected = {.frames = frames, .errors = errors, .exceptions = exceptions};
    bench_count(play(t, &expected));
}
