/* SPDX-License-Identifier: MIT
 *
 * timed.c - a bench for one controller in time.
 */
#include "timed.h"

#include <stdlib.h>

#define SETTLE_BITS 14u
#define AFTER_BITS 4u /* intermission and a bit of idle */

void timed_put(timed *t, bool bench, bool node, unsigned quanta)
{
    if (t->runs == TIMED_RUNS)
        abort();
    t->run[t->runs++] = (timed_run){bench, node, quanta};
}

void timed_begin(timed *t, const cw_bit_timing *timing, bool extended)
{
    const cw_frame frame = {.id = extended ? 0x1F000000 : 0x7C0,
                            .flags = extended ? CW_FRAME_EXTENDED : 0,
                            .dlc = 1, .data = {0x5A}};
    t->timing = *timing;
    t->bit = cw_bit_timing_quanta(timing);
    t->sample = cw_bit_timing_sample_at(timing);
    t->runs = 0;
    if (cw_bits_encode(&t->bits, &frame) != CW_OK || !cw_bits_place(&t->bits, TIMED_STUFF).stuff)
        abort();
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, SETTLE_BITS * t->bit);
}

void timed_bits(timed *t, unsigned from, unsigned before)
{
    for (unsigned n = from; n < before; n++)
        timed_put(t, cw_bits_level(&t->bits, n),
                  !cw_bits_is_at(&t->bits, n, CW_FIELD_ACK_SLOT, 0), t->bit);
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

static unsigned step(cw_timed_mac *c, unsigned brp, bool bench, cw_mac_report *report)
{
    unsigned what = 0;
    if (brp == 0)
        return cw_timed_mac_quantum(c, bench && cw_timed_mac_level(c), report);
    for (unsigned i = 0; i < brp; i++)
        what |= cw_timed_mac_clock(c, bench && cw_timed_mac_level(c), report);
    return what;
}

static const char *play(const timed *t, unsigned brp, unsigned frames, unsigned errors)
{
    cw_timed_mac c;
    cw_mac_report report;
    if (cw_timed_mac_init(&c, &t->timing, brp ? brp : 1, 0, 96) != CW_OK)
        return "the timing is refused";
    for (unsigned i = 0; i < t->runs; i++)
        for (unsigned k = 0; k < t->run[i].quanta; k++) {
            if (cw_timed_mac_level(&c) != t->run[i].node)
                return "the controller drives another level";
            if (!(step(&c, brp, t->run[i].bench, &report) & CW_QUANTUM_SAMPLED))
                continue;
            frames -= (report.what & CW_REPORT_RX) != 0;
            errors -= (report.what & CW_REPORT_ERROR) != 0;
        }
    return frames ? "frames are missing, or too many" : errors ? "wrong number of errors" : NULL;
}

void timed_play(const timed *t, unsigned brp, unsigned frames, unsigned errors)
{
    bench_count(play(t, brp, frames, errors));
}
