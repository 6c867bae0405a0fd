/* SPDX-License-Identifier: MIT
 *
 * timed_x.c - cases of our own, inside the bit.
 */
#include "timed.h"

/* A dominant bit in the intermission asks for an overload frame. Its edge comes late, by more than
 * SJW: the first bit synchronises as in a frame, the second one hard (T4). The flag shows it. */
void timed_run_intermission(void)
{
    for (unsigned i = 0; i < TIMED_TIMINGS; i++)
        for (unsigned e = timed_timings[i].sjw + 1u;
             e < cw_bit_timing_sample_at(&timed_timings[i]); e++)
            for (unsigned second = 0; second < 2; second++) {
                timed t;
                timed_begin(&t, &timed_timings[i], false);
                timed_bits(&t, 0, t.bits.length);
                timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, second * t.n.bit + e);
                timed_put(&t, CW_DOMINANT, CW_RECESSIVE,
                          second ? t.n.bit : t.n.bit + t.timing.sjw - e);
                timed_flag(&t);
                timed_play(&t, 0, 1, 0, 0);
            }
}

/* Of three looks one or two are dominant in the ACK delimiter (T7). No edge synchronises there. */
void timed_run_triple_sampling(void)
{
    for (unsigned i = 0; i < 2 * TIMED_TIMINGS; i++) {
        const unsigned looks = 1 + (i & 1);
        cw_bit_timing timing = timed_timings[i / 2];
        timing.triple_sampling = true;
        timed t;
        timed_begin(&t, &timing, false);
        const unsigned delimiter = timed_at(&t, CW_FIELD_ACK_DELIMITER, 0);
        timed_bits(&t, 0, delimiter);
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, t.n.sample - looks);
        timed_put(&t, CW_DOMINANT, CW_RECESSIVE, looks);
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, timing.phase_seg2);
        if (looks == 1)
            timed_rest(&t, delimiter + 1);
        else
            timed_flag(&t);
        timed_play(&t, 0, looks == 1, looks == 2, 0);
    }
}

/* An error-passive transmitter owes suspend time, and has a frame to send. A short dominant pulse,
 * which is recessive again at the sample point, restarts the bit: hard synchronisation (T4). After
 * eight bits it sends. If it resynchronised, it would sample the pulse as a SOF. */
static void check_suspend(const cw_bit_timing *timing, unsigned bit, unsigned e)
{
    timed t;
    timed_begin_sending(&t, timing, false);
    t.tec = 150;
    timed_sends(&t, 0, t.bits.length);
    timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, 3 * t.n.bit);
    timed_offer(&t);
    timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, bit * t.n.bit + e);
    timed_put(&t, CW_DOMINANT, CW_RECESSIVE, t.n.sample + timing->sjw - e);
    timed_put(&t, CW_RECESSIVE, CW_RECESSIVE,
              (8 - bit) * t.n.bit - (t.n.sample + timing->sjw - e));
    timed_sends_rest(&t, 0);
    timed_play(&t, 0, 2, 0, 0);
}

void timed_run_suspend(void)
{
    for (unsigned i = 0; i < TIMED_TIMINGS; i++)
        for (unsigned e = timed_timings[i].sjw + 1u;
             e < cw_bit_timing_sample_at(&timed_timings[i]); e++)
            for (unsigned bit = 0; bit < 8; bit++)
                check_suspend(&timed_timings[i], bit, e);
}

/* M11: nobody but a listen-only controller has acknowledged. Its bit timing sees a recessive slot,
 * in which it drives nothing. So it follows an edge in the slot (T6), and samples a recessive level
 * behind it. By that it follows an edge in the delimiter as well (T3). In both bits the dominant
 * level ends at the sample point without the edge. If it followed one edge only, the delimiter
 * would be dominant. */
static void check_own_ack(const cw_bit_timing *timing, unsigned e)
{
    timed t;
    timed_begin(&t, timing, false);
    t.modes = CW_MODE_LISTEN_ONLY;
    const unsigned ack = timed_at(&t, CW_FIELD_ACK_SLOT, 0);
    for (unsigned n = 0; n < ack; n++)
        timed_put(&t, cw_bits_level(&t.bits, n), CW_RECESSIVE, t.n.bit);
    for (unsigned bit = 0; bit < 2; bit++) {
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, e);
        timed_put(&t, CW_DOMINANT, CW_RECESSIVE, t.n.sample - e);
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, t.n.bit - t.n.sample + timing->sjw);
    }
    for (unsigned n = ack + 2; n < t.bits.length; n++)
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, t.n.bit);
    timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, 4 * t.n.bit);
    timed_play(&t, 0, 1, 0, 0);
}

void timed_run_listen_only(void)
{
    for (unsigned i = 0; i < TIMED_TIMINGS; i++)
        for (unsigned e = timed_timings[i].sjw;
             e < cw_bit_timing_sample_at(&timed_timings[i]); e++)
            check_own_ack(&timed_timings[i], e);
}

/* R12: the request comes before or after the sample point of a bit, which counts or does not. After
 * the 1408th one the controller is back. It acknowledges a frame that begins with the next bit, but
 * none that begins a bit earlier, which spoils the last group. */
static void check_recovery(const cw_bit_timing *timing, unsigned at, bool early)
{
    timed t;
    timed_begin(&t, timing, false);
    t.tec = 256;
    timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, at);
    timed_restart(&t);
    const unsigned bits = 128u * 11u - (at < t.n.sample ? 1u : 0u) - early;
    timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, t.n.bit - at + bits * t.n.bit);
    const unsigned ack = timed_at(&t, CW_FIELD_ACK_SLOT, 0);
    timed_bits(&t, 0, ack);
    timed_put(&t, CW_RECESSIVE, early, t.n.bit);
    for (unsigned n = ack + 1; n < t.bits.length; n++)
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, t.n.bit);
    timed_play(&t, 0, !early, 0, 0);
}

void timed_run_recovery(void)
{
    for (unsigned i = 0; i < TIMED_TIMINGS; i++)
        for (unsigned at = 1; at < cw_bit_timing_quanta(&timed_timings[i]); at++)
            for (unsigned early = 0; early < 2; early++)
                check_recovery(&timed_timings[i], at, early);
}
