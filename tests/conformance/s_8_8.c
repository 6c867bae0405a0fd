/* SPDX-License-Identifier: MIT
 *
 * s_8_8.c - transmitter of FD frames: bit timing and transmitter delay compensation.
 */
#include "timed_fd.h"

static timed script;

/* A compensation that looks at each bit of the data phase in its second clock. */
static const cw_tdc early_tdc = {.mode = CW_TDC_MANUAL, .tdco = 2};

/* ---- Sample points --------------------------------------------------------------------------- */

/* Wire bit n is seen at the other level up to its sample point, or up to a quantum before it, or
 * from there on. rate: up to the sample point; rest: after it, where the bit is right. */
static void check_bit(timed *t, unsigned n, const timed_lengths *rate, unsigned rest, bool wrong)
{
    const bool level = cw_bits_level(&t->bits, n);
    timed_sends(t, 0, n);
    timed_force(t, !level, level, rate->sample - (wrong ? 0 : rate->quantum));
    timed_force(t, level, level, wrong ? 0 : rate->quantum + rest);
    if (wrong) {
        timed_force(t, !level, level, t->n.rest);
        timed_sends_again(t, 6 * t->n.bit);
    } else {
        timed_sends_rest(t, n + 1);
    }
    fd_play(t, 1, wrong, 0);
}

/* Res is seen dominant from its begin to its sample point, or to a quantum before it. */
static void check_res(const fd_timing *timing, bool tdc)
{
    for (unsigned cut = 0; cut < 2; cut++) {
        timed *t = &script;
        fd_begin_sending(t, timing, 0);
        if (tdc)
            t->tdc = early_tdc;
        const unsigned n = timed_at(t, CW_FIELD_RES, 0);
        timed_sends(t, 0, n);
        timed_force(t, CW_DOMINANT, CW_DOMINANT, t->n.sample - cut * t->n.quantum);
        timed_force(t, CW_RECESSIVE, CW_DOMINANT, t->n.rest + cut * t->n.quantum);
        if (cut)
            timed_sends_again(t, 6 * t->n.bit);
        else
            timed_sends_rest(t, n + 1);
        fd_play(t, 1, cut, 0);
    }
}

static void check_brs(const fd_timing *timing, bool tdc)
{
    for (unsigned wrong = 0; wrong < 2; wrong++) {
        timed *t = &script;
        fd_begin_sending(t, timing, 0);
        if (tdc)
            t->tdc = early_tdc;
        check_bit(t, timed_at(t, CW_FIELD_BRS, 0), &t->n, t->d.rest, wrong);
    }
}

static void run_res(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        check_res(&fd_timings[i], false);
}

static void run_brs(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        check_brs(&fd_timings[i], false);
}

static void run_data(void)
{
    for (unsigned i = 0; i < 2 * FD_TIMINGS; i++) {
        timed *t = &script;
        fd_begin_sending(t, &fd_timings[i / 2], 0);
        check_bit(t, fd_single_recessive(t), &t->d, t->d.rest, i & 1);
    }
}

static void run_crc_delimiter(void)
{
    for (unsigned i = 0; i < 2 * FD_TIMINGS; i++) {
        timed *t = &script;
        fd_begin_sending(t, &fd_timings[i / 2], FD_LAST_DOMINANT);
        check_bit(t, timed_at(t, CW_FIELD_CRC_DELIMITER, 0), &t->d, t->n.rest, i & 1);
    }
}

/* ---- Secondary sample points ----------------------------------------------------------------- */

static void run_res_with_tdc(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        check_res(&fd_timings[i], true);
}

static void run_brs_with_tdc(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        check_brs(&fd_timings[i], true);
}

/* The own level comes back after a delay, and is disturbed about a secondary sample point. */
static void check_delayed(const fd_timing *timing, const cw_tdc *tdc, unsigned delay, bool last)
{
    fd_begin(&script, timing, 0);
    fd_check_compared(&script, tdc, delay, last ? timed_at(&script, CW_FIELD_CRC_DELIMITER, 0) - 1
                                                : fd_single_recessive(&script));
}

/* Delays of up to more than a data bit, with the secondary sample point where the sample point is
 * without delay, and elsewhere. */
static void run_delayed(bool last)
{
    for (unsigned i = 0; i < 2 * FD_TIMINGS; i++) {
        const fd_timing *timing = &fd_timings[i / 2];
        timed *t = &script;
        fd_begin(t, timing, 0);
        const unsigned most = last ? t->d.sample - 2 : t->n.sample - 2;
        for (unsigned delay = 0; delay < most && delay < 2 * t->d.bit; delay++) {
            const unsigned tdco = last && delay + 2 > t->d.bit ? 2 : t->d.sample;
            const cw_tdc measured = {.mode = CW_TDC_AUTO, .tdco = tdco};
            const cw_tdc given = {.mode = CW_TDC_MANUAL, .tdco = tdco, .tdcv = delay};
            check_delayed(timing, i & 1 ? &given : &measured, delay, last);
            fd_begin(t, timing, 0);
        }
    }
}

static void run_data_with_tdc(void)
{
    run_delayed(false);
}

static void run_crc_with_tdc(void)
{
    run_delayed(true);
}

/* ---- No synchronisation in the data phase ---------------------------------------------------- */

/* The bench is dominant for so many data quanta before the end of a recessive bit. The next one is
 * dominant, and begins when it would anyway. */
static void check_early(unsigned i, bool after_brs, unsigned quanta)
{
    timed *t = &script;
    fd_begin_sending(t, &fd_timings[i], 0);
    const unsigned n = after_brs ? timed_at(t, CW_FIELD_BRS, 0) : fd_single_recessive(t);
    timed_sends(t, 0, n);
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, timed_length(t, n) - quanta * t->d.quantum);
    timed_put(t, CW_DOMINANT, CW_RECESSIVE, quanta * t->d.quantum);
    timed_sends_rest(t, n + 1);
    fd_play(t, 1, 0, 0);
}

static void run_all_early(bool after_brs)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        for (unsigned e = 1; e <= fd_timings[i].data.phase_seg2; e++)
            check_early(i, after_brs, e);
}

static void run_early_esi(void)
{
    run_all_early(true);
}

static void run_early_data(void)
{
    run_all_early(false);
}

/* There are two edges: a quantum before the end of a recessive bit, and one before the sample point
 * of the dominant bit after it. The first quantum of that bit is seen recessive. */
static void check_two_edges(unsigned i, bool after_brs)
{
    timed *t = &script;
    fd_begin_sending(t, &fd_timings[i], 0);
    const unsigned n = after_brs ? timed_at(t, CW_FIELD_BRS, 0) : fd_single_recessive(t);
    const unsigned q = t->d.quantum;
    timed_sends(t, 0, n);
    timed_force(t, CW_RECESSIVE, CW_RECESSIVE, timed_length(t, n) - q);
    timed_force(t, CW_DOMINANT, CW_RECESSIVE, q);
    timed_force(t, CW_RECESSIVE, CW_DOMINANT, q);
    timed_force(t, CW_DOMINANT, CW_DOMINANT, t->d.bit - q);
    timed_sends_rest(t, n + 2);
    fd_play(t, 1, 0, 0);
}

static void run_two_edges_esi(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        check_two_edges(i, true);
}

static void run_two_edges_data(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        check_two_edges(i, false);
}

/* The own dominant bit is seen so many data quanta late, up to its sample point. */
static void check_late(unsigned i, bool esi, unsigned quanta)
{
    timed *t = &script;
    fd_begin_sending(t, &fd_timings[i], 0);
    const unsigned n = (esi ? timed_at(t, CW_FIELD_BRS, 0) : fd_single_recessive(t)) + 1;
    timed_sends(t, 0, n);
    timed_force(t, CW_RECESSIVE, CW_DOMINANT, quanta * t->d.quantum);
    timed_force(t, CW_DOMINANT, CW_DOMINANT, t->d.bit - quanta * t->d.quantum);
    timed_sends_rest(t, n + 1);
    fd_play(t, 1, 0, 0);
}

static void run_all_late(bool esi)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        for (unsigned e = 1; e < cw_bit_timing_sample_at(&fd_timings[i].data); e++)
            check_late(i, esi, e);
}

static void run_late_esi(void)
{
    run_all_late(true);
}

static void run_late_data(void)
{
    run_all_late(false);
}

static const test_case cases[] = {
    {"8.8.1.1", NULL, run_res},
    {"8.8.1.2", NULL, run_brs},
    {"8.8.1.3", NULL, run_data},
    {"8.8.1.4", NULL, run_crc_delimiter},
    {"8.8.2.1", NULL, run_res_with_tdc},
    {"8.8.2.2", NULL, run_brs_with_tdc},
    {"8.8.2.3", NULL, run_data_with_tdc},
    {"8.8.2.4", NULL, run_crc_with_tdc},
    {"8.8.3.1", NULL, run_early_esi},
    {"8.8.3.2", NULL, run_early_data},
    {"8.8.4.1", NULL, run_two_edges_esi},
    {"8.8.4.2", NULL, run_two_edges_data},
    {"8.8.5.1", NULL, run_late_esi},
    {"8.8.5.2", NULL, run_late_data},
};

const section section_8_8 = {"8.8", cases, sizeof cases / sizeof cases[0]};
