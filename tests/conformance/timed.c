/* SPDX-License-Identifier: MIT
 *
 * timed.c - a bench for one controller in time.
 */
#include "timed_fd.h"

#include <stdlib.h>

#define SETTLE_BITS 14u
#define AFTER_BITS 4u /* intermission and a bit of idle */

#define TIMING(prop, seg1, seg2, width) \
    {.quantum = CW_TICK, .prop_seg = prop, .phase_seg1 = seg1, .phase_seg2 = seg2, .sjw = width}

const cw_bit_timing timed_timings[TIMED_TIMINGS] = {
    TIMING(4, 1, 2, 1), TIMING(2, 2, 3, 2), TIMING(1, 4, 4, 4), TIMING(6, 1, 2, 1),
    TIMING(4, 5, 6, 4), TIMING(4, 3, 4, 3), TIMING(8, 8, 8, 4), TIMING(20, 16, 13, 9),
};

static timed_run *add_run(timed *t, bool bench, bool node, unsigned steps)
{
    if (t->runs == TIMED_RUNS)
        abort();
    timed_run *run = &t->run[t->runs++];
    run->bench = bench;
    run->node = node;
    run->length = steps;
    run->alone = false;
    return run;
}

void timed_put(timed *t, bool bench, bool node, unsigned steps)
{
    if (steps)
        (void)add_run(t, bench, node, steps);
}

void timed_force(timed *t, bool bench, bool node, unsigned steps)
{
    if (steps)
        add_run(t, bench, node, steps)->alone = true;
}

void timed_offer(timed *t)
{
    t->run[t->runs].offers = true;
}

void timed_restart(timed *t)
{
    t->run[t->runs].restarts = true;
}

timed_lengths timed_lengths_of(const cw_bit_timing *timing, unsigned steps)
{
    const unsigned bit = cw_bit_timing_quanta(timing), sample = cw_bit_timing_sample_at(timing);
    return (timed_lengths){.quantum = steps, .bit = bit * steps, .sample = sample * steps,
                           .rest = (bit - sample) * steps, .sjw = timing->sjw};
}

void timed_settle(timed *t)
{
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, SETTLE_BITS * t->n.bit);
}

void timed_settle_sending(timed *t)
{
    t->run[0].length -= t->n.bit;
    timed_offer(t);
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, t->n.bit);
}

void timed_begin(timed *t, const cw_bit_timing *timing, bool extended)
{
    *t = (timed){.timing = *timing, .n = timed_lengths_of(timing, 1)};
    t->frame = (cw_frame){.id = extended ? 0x1F000000 : 0x7C0,
                            .flags = extended ? CW_FRAME_EXTENDED : 0,
                            .dlc = 1, .data = {0x5A}};
    if (cw_bits_encode(&t->bits, &t->frame) != CW_OK || !cw_bits_place(&t->bits, TIMED_STUFF).stuff)
        abort();
    timed_settle(t);
}

void timed_begin_sending(timed *t, const cw_bit_timing *timing, bool extended)
{
    timed_begin(t, timing, extended);
    timed_settle_sending(t);
}

/* ---- Bits of the frame ----------------------------------------------------------------------- */

unsigned timed_at(const timed *t, cw_field field, unsigned index)
{
    unsigned n = 0;
    while (!cw_bits_is_at(&t->bits, n, field, index))
        if (++n == t->bits.length)
            abort();
    return n;
}

unsigned timed_length(const timed *t, unsigned n)
{
    if (!(t->frame.flags & CW_FRAME_BRS))
        return t->n.bit;
    const unsigned brs = timed_at(t, CW_FIELD_BRS, 0), end = timed_at(t, CW_FIELD_CRC_DELIMITER, 0);
    if (n == brs)
        return t->n.sample + t->d.rest;
    if (n == end)
        return t->d.sample + t->n.rest;
    return n > brs && n < end ? t->d.bit : t->n.bit;
}

void timed_bits(timed *t, unsigned from, unsigned before)
{
    const unsigned ack = timed_at(t, CW_FIELD_ACK_SLOT, 0);
    for (unsigned n = from; n < before; n++)
        timed_put(t, cw_bits_level(&t->bits, n), n != ack, timed_length(t, n));
}

void timed_rest(timed *t, unsigned from)
{
    timed_bits(t, from, t->bits.length);
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, AFTER_BITS * t->n.bit);
}

void timed_sends(timed *t, unsigned from, unsigned before)
{
    const unsigned ack = timed_at(t, CW_FIELD_ACK_SLOT, 0);
    for (unsigned n = from; n < before; n++)
        timed_put(t, n != ack, cw_bits_level(&t->bits, n), timed_length(t, n));
}

void timed_sends_rest(timed *t, unsigned from)
{
    timed_sends(t, from, t->bits.length);
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, AFTER_BITS * t->n.bit);
}

void timed_flag(timed *t)
{
    timed_put(t, CW_RECESSIVE, CW_DOMINANT, 6 * t->n.bit);
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, 12 * t->n.bit);
}

void timed_error_frame(timed *t, unsigned flag)
{
    timed_put(t, CW_RECESSIVE, CW_DOMINANT, flag);
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, 11 * t->n.bit);
}

void timed_sends_again(timed *t, unsigned flag)
{
    timed_error_frame(t, flag);
    timed_sends_rest(t, 0);
}

/* ---- Playing --------------------------------------------------------------------------------- */

typedef struct counts {
    unsigned frames, errors, exceptions;
    bool other_frame;
} counts;

static void count(counts *c, const timed *t, const cw_timed_mac *mac, const cw_mac_report *r)
{
    c->frames += (r->what & (CW_REPORT_RX | CW_REPORT_TX)) != 0;
    c->errors += (r->what & CW_REPORT_ERROR) != 0;
    c->exceptions += (r->what & CW_REPORT_EXCEPTION) != 0;
    if (t->both && (r->what & CW_REPORT_RX) &&
        !cw_frame_equal(cw_mac_received(&mac->mac), &t->frame))
        c->other_frame = true;
}

static unsigned step(cw_timed_mac *c, unsigned brp, const timed_run *run, cw_mac_report *report)
{
    const bool level = run->alone ? run->bench : run->bench && cw_timed_mac_level(c);
    unsigned what = 0;
    if (brp == 0)
        return cw_timed_mac_quantum(c, level, report);
    for (unsigned i = 0; i < brp; i++)
        what |= cw_timed_mac_clock(c, level, report);
    return what;
}

static const char *run_all(cw_timed_mac *c, const timed *t, unsigned brp, counts *seen)
{
    cw_mac_report report;
    for (unsigned i = 0; i < t->runs; i++) {
        const timed_run *run = &t->run[i];
        if (run->offers && cw_mac_offer(&c->mac, &t->frame) != CW_OK)
            return "the frame is refused";
        if (run->restarts && cw_mac_request_restart(&c->mac) != CW_OK)
            return "the restart is refused";
        for (unsigned k = 0; k < run->length; k++) {
            if (cw_timed_mac_level(c) != run->node)
                return "the controller drives another level";
            if (step(c, brp, run, &report) & CW_QUANTUM_SAMPLED)
                count(seen, t, c, &report);
        }
    }
    return NULL;
}

static bool begins(cw_timed_mac *c, const timed *t, unsigned brp, cw_fd_part *part)
{
    const fd_timing *both = t->both;
    if (!both)
        return cw_timed_mac_init(c, &t->timing, brp ? brp : 1, t->modes, 96) == CW_OK &&
               cw_mac_set_counters(&c->mac, t->tec, 0) == CW_OK;
    return cw_timed_mac_init(c, &both->nominal, both->nominal_brp, 0, 96) == CW_OK &&
           cw_mac_set_protocol(&c->mac, CW_FD, part) == CW_OK &&
           cw_timed_mac_set_data(c, &both->data, both->data_brp, &t->tdc) == CW_OK;
}

static const char *play(const timed *t, unsigned brp, const counts *expected)
{
    cw_timed_mac c;
    cw_fd_part part;
    counts seen = {0};
    if (!begins(&c, t, brp, &part))
        return "the timing or a counter is refused";
    const char *problem = run_all(&c, t, brp, &seen);
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

void timed_play(const timed *t, unsigned brp, unsigned frames, unsigned errors,
                unsigned exceptions)
{
    const counts expected = {.frames = frames, .errors = errors, .exceptions = exceptions};
    bench_count(play(t, brp, &expected));
}
