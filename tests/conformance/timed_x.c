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
                timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, second * t.bit + e);
                timed_put(&t, CW_DOMINANT, CW_RECESSIVE,
                          second ? t.bit : t.bit + t.timing.sjw - e);
                timed_flag(&t);
                timed_play(&t, 0, 1, 0);
            }
}

/* Of three looks one or two are dominant in the ACK delimiter (T7). No edge synchronises there. */
void timed_run_triple_sampling(void)
{
    for (unsigned i = 0; i < 2 * TIMED_TIMINGS; i++) {
        const unsigned looks = 1 + (i & 1);
        cw_bit_timing timing = timed_timings[i / 2];
        timing.triple_sampling = true;
        unsigned delimiter = 0;
        timed t;
        timed_begin(&t, &timing, false);
        while (!cw_bits_is_at(&t.bits, delimiter, CW_FIELD_ACK_DELIMITER, 0))
            delimiter++;
        timed_bits(&t, 0, delimiter);
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, t.sample - looks);
        timed_put(&t, CW_DOMINANT, CW_RECESSIVE, looks);
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, timing.phase_seg2);
        if (looks == 1)
            timed_rest(&t, delimiter + 1);
        else
            timed_flag(&t);
        timed_play(&t, 0, looks == 1, looks == 2);
    }
}
