/* SPDX-License-Identifier: MIT
 *
 * timed.c - a bench for one controller in time.
 */
#include "timed.h"

#include <stdlib.h>

#define SETTLE_BITS 14u
#define AFTER_BITS 4u /* intermission and a bit of idle */

#define TIMING(prop, seg1, seg2, width) \
    {.quantum = CW_TICK, .prop_seg = prop, .phase_seg1 = seg1, .phase_seg2 = seg2, .sjw = width}

const cw_bit_timing timed_timings[TIMED_TIMINGS] = {
    TIMING(4, 1, 2, 1), TIMING(2, 2, 3, 2), TIMING(1, 4, 4, 4), TIMING(6, 1, 2, 1),
    TIMING(4, 5, 6, 4), TIMING(4, 3, 4, 3), TIMING(8, 8, 8, 4), TIMING(20, 16, 13, 9),
};

static timed_run *add_run(timed *t, bool bench, bool node, unsigned quanta)
{
    if (t->runs == TIMED_RUNS)
        abort();
    timed_run *run = &t->run[t->runs++];
    run->bench = bench;
    run->node = node;
    run->length = quanta;
    run->alone = false;
    return run;
}

void timed_put(timed *t, bool bench, bool node, unsigned quanta)
{
    (void)add_run(t, bench, node, quanta);
}

void timed_force(timed *t, bool bench, bool node, unsigned quanta)
{
    add_run(t, bench, node, quanta)->alone = true;
}

void timed_offer(timed *t)
{
    t->run[t->runs].offers = true;
}

void timed_restart(timed *t)
{
    t->run[t->runs].restarts = true;
}

void timed_begin(timed *t, const cw_bit_timing *timing, bool extended)
{
    *t = (timed){.timing = *timing};
    t->frame = (cw_frame){.id = extended ? 0x1F000000 : 0x7C0,
                            .flags = extended ? CW_FRAME_EXTENDED : 0,
                            .dlc = 1, .data = {0x5A}};
    t->bit = cw_bit_timing_quanta(timing);
    t->sample = cw_bit_timing_sample_at(timing);
    if (cw_bits_encode(&t->bits, &t->frame) != CW_OK || !cw_bits_place(&t->bits, TIMED_STUFF).stuff)
        abort();
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, SETTLE_BITS * t->bit);
}

void timed_bits(timed *t, unsigned from, unsigned before)
{
    for (unsigned n = from; n < before; n++)
        timed_put(t, cw_bits_level(&t->bits, n),
                  !cw_bits_is_at(&t->bits, n, CW_FIELD_ACK_SLOT, 0), t->bit);
}

void timed_begin_sending(timed *t, const cw_bit_timing *timing, bool extended)
{
    timed_begin(t, timing, extended);
    t->run[0].length -= t->bit;
    timed_offer(t);
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, t->bit);
}

void timed_sends(timed *t, unsigned from, unsigned before)
{
    for (unsigned n = from; n < before; n++)
        timed_put(t, !cw_bits_is_at(&t->bits, n, CW_FIELD_ACK_SLOT, 0),
                  cw_bits_level(&t->bits, n), t->bit);
}

void timed_sends_rest(timed *t, unsigned from)
{
    timed_sends(t, from, t->bits.length);
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, AFTER_BITS * t->bit);
}

void timed_sends_again(timed *t, unsigned flag_quanta)
{
    timed_put(t, CW_RECESSIVE, CW_DOMINANT, flag_quanta);
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, 11 * t->bit);
    timed_sends_rest(t, 0);
}

unsigned timed_data_bit(const timed *t, unsigned index)
{
    unsigned n = 0;
    while (!cw_bits_is_at(&t->bits, n, CW_FIELD_DATA, index))
        n++;
    return n;
}

void timed_rest(timed *t, unsigned from)
{
    timed_bits(t, from, t->bits.length);
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, AFTER_BITS * t->bit);
}

void timed_flag(timed *t)
{
    timed_put(t, CW_RECESSIVE, CW_DOMINANT, 6 * t->bit);
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, 12 * t->bit);
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

static const char *play(const timed *t, unsigned brp, unsigned frames, unsigned errors)
{
    cw_timed_mac c;
    cw_mac_report report;
    if (cw_timed_mac_init(&c, &t->timing, brp ? brp : 1, t->modes, 96) != CW_OK ||
        cw_mac_set_counters(&c.mac, t->tec, 0) != CW_OK)
        return "the timing or a counter is refused";
    for (unsigned i = 0; i < t->runs; i++) {
        if (t->run[i].offers && cw_mac_offer(&c.mac, &t->frame) != CW_OK)
            return "the frame is refused";
        if (t->run[i].restarts && cw_mac_request_restart(&c.mac) != CW_OK)
            return "the restart is refused";
        for (unsigned k = 0; k < t->run[i].length; k++) {
            if (cw_timed_mac_level(&c) != t->run[i].node)
                return "the controller drives another level";
            if (!(step(&c, brp, &t->run[i], &report) & CW_QUANTUM_SAMPLED))
                continue;
            frames -= (report.what & (CW_REPORT_RX | CW_REPORT_TX)) != 0;
            errors -= (report.what & CW_REPORT_ERROR) != 0;
        }
    }
    return frames ? "frames are missing, or too many" : errors ? "wrong number of errors" : NULL;
}

void timed_play(const timed *t, unsigned brp, unsigned frames, unsigned errors)
{
    bench_count(play(t, brp, frames, errors));
}
