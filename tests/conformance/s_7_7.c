/* SPDX-License-Identifier: MIT
 *
 * s_7_7.c - receiver: bit timing.
 */
#include "timed.h"

#define TIMING(prop, seg1, seg2, width) \
    {.quantum = CW_TICK, .prop_seg = prop, .phase_seg1 = seg1, .phase_seg2 = seg2, .sjw = width}

#define timings timed_timings
#define TIMINGS TIMED_TIMINGS

static unsigned at_most(unsigned quanta, unsigned most)
{
    return quanta < most ? quanta : most;
}

/* A dominant stuff bit whose edge comes so many quanta late (negative: early), up to its sample
 * point; then up to a quantum before it. The glitch is recessive, in the second quantum. */
static void check_stuff_bit(const cw_bit_timing *timing, int late, bool glitch)
{
    for (unsigned i = 0; i < 8; i++) {
        const bool cut = i & 1;
        timed t;
        timed_begin(&t, timing, i & 2);
        const unsigned e = (unsigned)(late < 0 ? -late : late);
        const unsigned rest = e - at_most(e, timing->sjw);
        unsigned length = late < 0 ? t.n.sample + rest : t.n.sample - rest;
        timed_bits(&t, 0, TIMED_STUFF - 1);
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, (unsigned)((int)t.n.bit + late));
        if (glitch) {
            timed_put(&t, CW_DOMINANT, CW_RECESSIVE, 1);
            timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, 1);
            length -= 2;
        }
        timed_put(&t, CW_DOMINANT, CW_RECESSIVE, length - cut);
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, timing->phase_seg2 + cut);
        if (cut)
            timed_flag(&t);
        else
            timed_rest(&t, TIMED_STUFF + 1);
        timed_play(&t, i & 4 ? 3 : 0, !cut, cut, 0);
    }
}

static void run_7_7_1(void)
{
    for (unsigned bit = 8; bit <= 25; bit++)
        for (unsigned seg2 = 2; seg2 <= 8; seg2++)
            for (unsigned seg1 = 1; seg1 <= 8; seg1++) {
                const unsigned prop = bit - 1 - seg1 - seg2;
                const cw_bit_timing timing =
                    TIMING((uint16_t)prop, (uint16_t)seg1, (uint16_t)seg2, 1);
                if (prop >= 1 && prop <= 8)
                    check_stuff_bit(&timing, 0, false);
            }
    check_stuff_bit(&timings[TIMINGS - 1], 0, false);
}

static void run_late(bool wholly)
{
    for (unsigned i = 0; i < TIMINGS; i++)
        for (unsigned e = 1; e + 1 < cw_bit_timing_sample_at(&timings[i]); e++)
            if ((e <= timings[i].sjw) == wholly)
                check_stuff_bit(&timings[i], (int)e, false);
}

static void run_early(bool wholly)
{
    for (unsigned i = 0; i < TIMINGS; i++)
        for (unsigned e = 1; e <= timings[i].phase_seg2; e++)
            if ((e <= timings[i].sjw) == wholly)
                check_stuff_bit(&timings[i], -(int)e, false);
}

static void run_7_7_3(void)
{
    run_late(true);
}

static void run_7_7_4(void)
{
    run_late(false);
}

static void run_7_7_5(void)
{
    run_early(true);
}

static void run_7_7_6(void)
{
    run_early(false);
}

static void run_7_7_7(void)
{
    for (unsigned i = 0; i < TIMINGS; i++)
        check_stuff_bit(&timings[i], 0, true);
}

static void run_7_7_8(void)
{
    for (unsigned i = 0; i < TIMINGS; i++)
        check_stuff_bit(&timings[i], -1, true);
}

/* The flag begins six bits after the edge of a SOF that cuts the intermission. */
static void run_7_7_2(void)
{
    for (unsigned i = 0; i < 2 * TIMINGS; i++)
        for (unsigned e = 1; e <= cw_bit_timing_quanta(&timings[i / 2]); e++) {
            timed t;
            timed_begin(&t, &timings[i / 2], i & 1);
            timed_bits(&t, 0, t.bits.length);
            timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, 3 * t.n.bit - e);
            timed_put(&t, CW_DOMINANT, CW_RECESSIVE, 6 * t.n.bit);
            timed_flag(&t);
            timed_play(&t, 0, 1, 1, 0);
        }
}

static void run_7_7_9_1(void)
{
    for (unsigned i = 0; i < 2 * TIMINGS; i++)
        for (unsigned length = 1; length < cw_bit_timing_sample_at(&timings[i / 2]); length++) {
            timed t;
            timed_begin(&t, &timings[i / 2], i & 1);
            timed_put(&t, CW_DOMINANT, CW_RECESSIVE, length);
            timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, 20 * t.n.bit);
            timed_rest(&t, 0);
            timed_play(&t, 0, 1, 0, 0);
        }
}

/* The third glitch lasts up to the sample point that the first one gives, or one quantum less. */
static void run_7_7_9_2(void)
{
    for (unsigned i = 0; i < 2 * TIMINGS; i++) {
        const bool cut = i & 1;
        timed t;
        timed_begin(&t, &timings[i / 2], false);
        if (t.n.sample < 6)
            continue;
        for (unsigned k = 0; k < 4; k++)
            timed_put(&t, k & 1, CW_RECESSIVE, 1);
        timed_put(&t, CW_DOMINANT, CW_RECESSIVE, t.n.sample - 4 - cut);
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, t.timing.phase_seg2 + cut);
        if (cut) {
            timed_rest(&t, 0);
        } else {
            timed_put(&t, CW_DOMINANT, CW_RECESSIVE, 5 * t.n.bit);
            timed_flag(&t);
        }
        timed_play(&t, 0, cut, !cut, 0);
    }
}

/* The bit after the glitch is dominant in the quantum of its sample point alone. */
static void run_7_7_10(void)
{
    for (unsigned i = 0; i < 2 * TIMINGS; i++) {
        timed t;
        timed_begin(&t, &timings[i / 2], i & 1);
        timed_bits(&t, 0, TIMED_STUFF);
        timed_put(&t, CW_DOMINANT, CW_RECESSIVE, t.n.sample);
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, 1);
        timed_put(&t, CW_DOMINANT, CW_RECESSIVE, t.timing.phase_seg2 - 1u);
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, t.n.sample - 1);
        timed_put(&t, CW_DOMINANT, CW_RECESSIVE, 1);
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, t.timing.phase_seg2);
        timed_rest(&t, TIMED_STUFF + 2);
        timed_play(&t, 0, 1, 0, 0);
    }
}

/* The ACK of the bench comes early. The controller drives its own from the next quantum on. */
static void run_7_7_11(void)
{
    for (unsigned i = 0; i < 2 * TIMINGS; i++)
        for (unsigned e = 1; e <= timings[i / 2].sjw; e++) {
            timed t;
            timed_begin(&t, &timings[i / 2], i & 1);
            const unsigned ack = timed_at(&t, CW_FIELD_ACK_SLOT, 0);
            timed_bits(&t, 0, ack - 1);
            timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, t.n.bit - e);
            timed_put(&t, CW_DOMINANT, CW_RECESSIVE, 1);
            timed_put(&t, CW_DOMINANT, CW_DOMINANT, t.n.bit - 1);
            timed_rest(&t, ack + 1);
            timed_play(&t, 0, 1, 0, 0);
        }
}

static const test_case cases[] = {
    {"7.7.1", NULL, run_7_7_1},     {"7.7.2", NULL, run_7_7_2},     {"7.7.3", NULL, run_7_7_3},
    {"7.7.4", NULL, run_7_7_4},     {"7.7.5", NULL, run_7_7_5},     {"7.7.6", NULL, run_7_7_6},
    {"7.7.7", NULL, run_7_7_7},     {"7.7.8", NULL, run_7_7_8},     {"7.7.9.1", NULL, run_7_7_9_1},
    {"7.7.9.2", NULL, run_7_7_9_2}, {"7.7.10", NULL, run_7_7_10},   {"7.7.11", NULL, run_7_7_11},
};

const section section_7_7 = {"7.7", cases, sizeof cases / sizeof cases[0]};
