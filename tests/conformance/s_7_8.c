/* SPDX-License-Identifier: MIT
 *
 * s_7_8.c - receiver of FD frames: bit timing. e is a phase error in quanta.
 */
#include "timed_fd.h"

/* Bits in which an edge to dominant is put. */
typedef enum place { AT_ESI, AT_DATA, AT_CRC_DELIMITER } place;

static timed script;

static unsigned at_most(unsigned quanta, unsigned most)
{
    return quanta < most ? quanta : most;
}

/* Returns the kind of frame for a test at a place. cut: the bit is sampled recessive. A controller
 * that is to read ESI so gets a frame in which it is. */
static unsigned kind_for(place at, bool cut)
{
    return at == AT_ESI && cut ? FD_ESI : 0;
}

static unsigned bit_of(const timed *t, place at)
{
    if (at == AT_ESI)
        return timed_at(t, CW_FIELD_ESI, 0);
    return at == AT_DATA ? fd_stuff_bit(t) : timed_at(t, CW_FIELD_CRC_DELIMITER, 0);
}

/* The bit has been sampled at its sample point, in the data phase: goes on as that demands. */
static void go_on(timed *t, place at, unsigned n, bool cut)
{
    const unsigned more = cut ? t->d.quantum : 0;
    const bool error = at == AT_DATA ? cut : at == AT_CRC_DELIMITER ? !cut : false;
    const bool nominal = error || at == AT_CRC_DELIMITER;
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, more + (nominal ? t->n.rest : t->d.rest));
    if (error)
        timed_flag(t);
    else
        timed_rest(t, n + 1);
    fd_play(t, !error, error, 0);
}

/* An edge comes so many data quanta late (negative: early). The level is dominant up to the sample
 * point that follows from it, then up to a quantum before it. The glitch is recessive, in the
 * second quantum. */
static void check_edge(const fd_timing *timing, place at, int late, bool glitch)
{
    for (unsigned cut = 0; cut < 2; cut++) {
        timed *t = &script;
        fd_begin(t, timing, kind_for(at, cut));
        const unsigned n = bit_of(t, at), q = t->d.quantum;
        const unsigned e = (unsigned)(late < 0 ? -late : late);
        const unsigned left = e - at_most(e, t->d.sjw);
        const unsigned to_sample = t->d.sample / q;
        unsigned length = late < 0 ? to_sample + left : to_sample - left;
        timed_bits(t, 0, n - 1);
        timed_put(t, CW_RECESSIVE, CW_RECESSIVE,
                  (unsigned)((int)timed_length(t, n - 1) + late * (int)q));
        if (glitch) {
            timed_put(t, CW_DOMINANT, CW_RECESSIVE, q);
            timed_put(t, CW_RECESSIVE, CW_RECESSIVE, q);
            length -= 2;
        }
        timed_put(t, CW_DOMINANT, CW_RECESSIVE, (length - cut) * q);
        go_on(t, at, n, cut);
    }
}

static void run_late(place at, bool wholly)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        for (unsigned e = 1; e + 1 < cw_bit_timing_sample_at(&fd_timings[i].data); e++)
            if ((e <= fd_timings[i].data.sjw) == wholly)
                check_edge(&fd_timings[i], at, (int)e, false);
}

static void run_early(place at, bool wholly)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        for (unsigned e = 1; e <= fd_timings[i].data.phase_seg2; e++)
            if ((e <= fd_timings[i].data.sjw) == wholly)
                check_edge(&fd_timings[i], at, -(int)e, false);
}

/* ---- Sample points --------------------------------------------------------------------------- */

/* BRS is recessive in the last quantum before its sample point, or after it alone. Then it is
 * dominant to the controller, and all of the frame is at the nominal rate. */
static void run_brs(void)
{
    for (unsigned i = 0; i < 2 * FD_TIMINGS; i++) {
        const bool slow = i & 1;
        timed *t = &script;
        fd_begin(t, &fd_timings[i / 2], slow ? FD_SLOW : 0);
        const unsigned n = timed_at(t, CW_FIELD_BRS, 0);
        timed_bits(t, 0, n);
        timed_put(t, CW_DOMINANT, CW_RECESSIVE, t->n.sample - (slow ? 0 : t->n.quantum));
        timed_put(t, CW_RECESSIVE, CW_RECESSIVE, slow ? t->n.rest : t->n.quantum + t->d.rest);
        timed_rest(t, n + 1);
        fd_play(t, 1, 0, 0);
    }
}

static void run_data(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        check_edge(&fd_timings[i], AT_DATA, 0, false);
}

/* The last bit of the CRC is dominant, and so is the delimiter, up to its sample point. */
static void run_crc_delimiter(void)
{
    for (unsigned i = 0; i < 2 * FD_TIMINGS; i++) {
        const bool cut = i & 1;
        timed *t = &script;
        fd_begin(t, &fd_timings[i / 2], FD_LAST_DOMINANT);
        const unsigned n = timed_at(t, CW_FIELD_CRC_DELIMITER, 0);
        timed_bits(t, 0, n);
        timed_put(t, CW_DOMINANT, CW_RECESSIVE, t->d.sample - (cut ? t->d.quantum : 0));
        go_on(t, AT_CRC_DELIMITER, n, cut);
    }
}

/* ---- Hard synchronisation -------------------------------------------------------------------- */

/* The edge to res comes so many nominal quanta late (negative: early). The controller samples BRS
 * accordingly: it is recessive in the last quantum before that alone. */
static void check_res(const fd_timing *timing, int late)
{
    timed *t = &script;
    fd_begin(t, timing, 0);
    const unsigned n = timed_at(t, CW_FIELD_RES, 0), q = t->n.quantum;
    timed_bits(t, 0, n - 1);
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, (unsigned)((int)t->n.bit + late * (int)q));
    timed_put(t, CW_DOMINANT, CW_RECESSIVE, t->n.bit + t->n.sample - q);
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, q + t->d.rest);
    timed_rest(t, n + 2);
    fd_play(t, 1, 0, 0);
}

static void run_res_late(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        for (unsigned e = 1; e < cw_bit_timing_sample_at(&fd_timings[i].nominal); e++)
            check_res(&fd_timings[i], (int)e);
}

static void run_res_early(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        for (unsigned e = 1; e <= fd_timings[i].nominal.phase_seg2; e++)
            check_res(&fd_timings[i], -(int)e);
}

/* ---- Edges that are late or early ------------------------------------------------------------ */

static void run_late_esi(void)
{
    run_late(AT_ESI, true);
}

static void run_late_data(void)
{
    run_late(AT_DATA, true);
}

static void run_late_crc_delimiter(void)
{
    run_late(AT_CRC_DELIMITER, true);
}

static void run_later_esi(void)
{
    run_late(AT_ESI, false);
}

static void run_later_data(void)
{
    run_late(AT_DATA, false);
}

static void run_later_crc_delimiter(void)
{
    run_late(AT_CRC_DELIMITER, false);
}

static void run_early_esi(void)
{
    run_early(AT_ESI, true);
}

static void run_early_data(void)
{
    run_early(AT_DATA, true);
}

static void run_earlier_esi(void)
{
    run_early(AT_ESI, false);
}

static void run_earlier_data(void)
{
    run_early(AT_DATA, false);
}

/* The ACK of the bench comes so many nominal quanta early: the CRC delimiter has been sampled. */
static void check_early_ack(const fd_timing *timing, unsigned e)
{
    timed *t = &script;
    fd_begin(t, timing, 0);
    const unsigned ack = timed_at(t, CW_FIELD_ACK_SLOT, 0), q = t->n.quantum;
    timed_bits(t, 0, ack - 1);
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, timed_length(t, ack - 1) - e * q);
    if (e <= t->n.sjw) {
        timed_put(t, CW_DOMINANT, CW_RECESSIVE, q);
        timed_put(t, CW_DOMINANT, CW_DOMINANT, t->n.bit - q);
    } else {
        timed_put(t, CW_DOMINANT, CW_RECESSIVE, (e - t->n.sjw) * q);
        timed_put(t, CW_DOMINANT, CW_DOMINANT, t->n.bit);
    }
    timed_rest(t, ack + 1);
    fd_play(t, 1, 0, 0);
}

static void run_early_acks(bool wholly)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        for (unsigned e = 1; e <= fd_timings[i].nominal.phase_seg2; e++)
            if ((e <= fd_timings[i].nominal.sjw) == wholly)
                check_early_ack(&fd_timings[i], e);
}

static void run_early_ack(void)
{
    run_early_acks(true);
}

static void run_earlier_ack(void)
{
    run_early_acks(false);
}

/* ---- One synchronisation a bit --------------------------------------------------------------- */

/* A glitch in the second quantum of res. Res is dominant up to its sample point, or up to a quantum
 * before it: a protocol exception (D16). */
static void run_glitch_res(void)
{
    for (unsigned i = 0; i < 2 * FD_TIMINGS; i++) {
        const bool cut = i & 1;
        timed *t = &script;
        fd_begin(t, &fd_timings[i / 2], 0);
        const unsigned n = timed_at(t, CW_FIELD_RES, 0), q = t->n.quantum;
        timed_bits(t, 0, n);
        timed_put(t, CW_DOMINANT, CW_RECESSIVE, q);
        timed_put(t, CW_RECESSIVE, CW_RECESSIVE, q);
        timed_put(t, CW_DOMINANT, CW_RECESSIVE, t->n.sample - (cut ? 3 : 2) * q);
        timed_put(t, CW_RECESSIVE, CW_RECESSIVE, t->n.rest + (cut ? q : 0));
        if (cut)
            timed_put(t, CW_RECESSIVE, CW_RECESSIVE, 12 * t->n.bit);
        timed_rest(t, cut ? 0 : n + 1);
        fd_play(t, 1, 0, cut);
    }
}

static void run_glitch_data(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        check_edge(&fd_timings[i], AT_DATA, 0, true);
}

/* The controller sees its own ACK with a glitch, up to the sample point, or a quantum less. So many
 * quanta it comes early. */
static void check_glitch_ack(const fd_timing *timing, bool early)
{
    for (unsigned cut = 0; cut < 2; cut++) {
        timed *t = &script;
        fd_begin(t, timing, 0);
        const unsigned ack = timed_at(t, CW_FIELD_ACK_SLOT, 0), q = t->n.quantum;
        timed_bits(t, 0, ack - 1);
        timed_put(t, CW_RECESSIVE, CW_RECESSIVE, timed_length(t, ack - 1) - (early ? q : 0));
        timed_force(t, CW_DOMINANT, early ? CW_RECESSIVE : CW_DOMINANT, q);
        timed_force(t, CW_RECESSIVE, CW_DOMINANT, q);
        timed_force(t, CW_DOMINANT, CW_DOMINANT, t->n.sample - (2 + cut) * q);
        timed_force(t, CW_RECESSIVE, CW_DOMINANT, t->n.rest + cut * q);
        if (cut)
            timed_flag(t);
        else
            timed_rest(t, ack + 1);
        fd_play(t, !cut, cut, 0);
    }
}

static void run_glitch_ack(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        check_glitch_ack(&fd_timings[i], false);
}

static void run_before_esi(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        check_edge(&fd_timings[i], AT_ESI, -1, true);
}

static void run_before_data(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        check_edge(&fd_timings[i], AT_DATA, -1, true);
}

static void run_before_ack(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++)
        check_glitch_ack(&fd_timings[i], true);
}

/* ---- No synchronisation after a dominant sample ---------------------------------------------- */

/* A recessive glitch follows right after the sample point of the dominant bit n - 1. The next bit
 * is recessive in the last quantum before its sample point alone. */
static void check_after_dominant(timed *t, unsigned n, const timed_lengths *before,
                                 const timed_lengths *rate, unsigned rest)
{
    timed_bits(t, 0, n - 1);
    timed_put(t, CW_DOMINANT, CW_RECESSIVE, before->sample);
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, before->quantum);
    timed_put(t, CW_DOMINANT, CW_RECESSIVE, before->rest - before->quantum);
    timed_put(t, CW_DOMINANT, CW_RECESSIVE, rate->sample - rate->quantum);
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, rate->quantum + rest);
    timed_rest(t, n + 1);
    fd_play(t, 1, 0, 0);
}

static void run_dominant_res(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++) {
        timed *t = &script;
        fd_begin(t, &fd_timings[i], 0);
        check_after_dominant(t, timed_at(t, CW_FIELD_BRS, 0), &t->n, &t->n, t->d.rest);
    }
}

static void run_dominant_data(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++) {
        timed *t = &script;
        fd_begin(t, &fd_timings[i], 0);
        check_after_dominant(t, fd_single_recessive(t), &t->d, &t->d, t->d.rest);
    }
}

static void run_dominant_crc(void)
{
    for (unsigned i = 0; i < FD_TIMINGS; i++) {
        timed *t = &script;
        fd_begin(t, &fd_timings[i], FD_LAST_DOMINANT);
        check_after_dominant(t, timed_at(t, CW_FIELD_CRC_DELIMITER, 0), &t->d, &t->d, t->n.rest);
    }
}

static const test_case cases[] = {
    {"7.8.1.1", NULL, run_brs},
    {"7.8.1.2", NULL, run_data},
    {"7.8.1.3", NULL, run_crc_delimiter},
    {"7.8.2.1", NULL, run_res_late},
    {"7.8.2.2", NULL, run_res_early},
    {"7.8.3.1", NULL, run_late_esi},
    {"7.8.3.2", NULL, run_late_data},
    {"7.8.3.3", NULL, run_late_crc_delimiter},
    {"7.8.4.1", NULL, run_later_esi},
    {"7.8.4.2", NULL, run_later_data},
    {"7.8.4.3", NULL, run_later_crc_delimiter},
    {"7.8.5.1", NULL, run_early_esi},
    {"7.8.5.2", NULL, run_early_data},
    {"7.8.5.3", NULL, run_early_ack},
    {"7.8.6.1", NULL, run_earlier_esi},
    {"7.8.6.2", NULL, run_earlier_data},
    {"7.8.6.3", NULL, run_earlier_ack},
    {"7.8.7.1", NULL, run_glitch_res},
    {"7.8.7.2", NULL, run_glitch_data},
    {"7.8.7.3", NULL, run_glitch_ack},
    {"7.8.8.1", NULL, run_before_esi},
    {"7.8.8.2", NULL, run_before_data},
    {"7.8.8.3", NULL, run_before_ack},
    {"7.8.9.1", NULL, run_dominant_res},
    {"7.8.9.2", NULL, run_dominant_data},
    {"7.8.9.3", NULL, run_dominant_crc},
};

const section section_7_8 = {"7.8", cases, sizeof cases / sizeof cases[0]};
