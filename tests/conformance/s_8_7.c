/* SPDX-License-Identifier: MIT
 *
 * s_8_7.c - transmitter: bit timing. The data byte 5A has the levels d r d r r d r d.
 */
#include "timed.h"

#define AFTER_DOMINANT 1u  /* data bit: recessive, between dominant ones */
#define FIRST_OF_TWO 3u    /* data bit: recessive, with one more and then a dominant one */

static unsigned at_most(unsigned quanta, unsigned most)
{
    return quanta < most ? quanta : most;
}

/* A recessive bit is dominant up to its sample point, or to a quantum before it. */
static void run_8_7_1(void)
{
    for (unsigned i = 0; i < 4 * TIMED_TIMINGS; i++) {
        const bool short_one = i & 1;
        timed t;
        timed_begin_sending(&t, &timed_timings[i / 4], i & 2);
        const unsigned n = timed_at(&t, CW_FIELD_DATA, AFTER_DOMINANT);
        timed_sends(&t, 0, n);
        timed_put(&t, CW_DOMINANT, CW_RECESSIVE, t.n.sample - short_one);
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, t.timing.phase_seg2 + short_one);
        if (short_one)
            timed_sends_rest(&t, n + 1);
        else
            timed_sends_again(&t, 6 * t.n.bit);
        timed_play(&t, i & 1 ? 3 : 0, 1, !short_one, 0);
    }
}

/* Begins with a frame of the bench, during which the same frame is offered to the controller. */
static void receive_with_offer(timed *t, unsigned i)
{
    timed_begin(t, &timed_timings[i / 2], i & 1);
    timed_bits(t, 0, TIMED_STUFF);
    timed_offer(t);
    timed_bits(t, TIMED_STUFF, t->bits.length);
    timed_put(t, CW_RECESSIVE, CW_RECESSIVE, 2 * t->n.bit);
}

/* The edge comes in the last quantum before the sample point of the third bit of the intermission.
 * It is the SOF, and the controller goes on with the first identifier bit. */
static void run_8_7_2(void)
{
    for (unsigned i = 0; i < 2 * TIMED_TIMINGS; i++) {
        timed t;
        receive_with_offer(&t, i);
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, t.n.sample - 1);
        timed_put(&t, CW_DOMINANT, CW_RECESSIVE, t.n.bit);
        timed_sends_rest(&t, 1);
        timed_play(&t, 0, 2, 0, 0);
    }
}

/* The edge comes in the first quantum after that sample point. The controller sends its own SOF in
 * the next quantum. */
static void run_8_7_3(void)
{
    for (unsigned i = 0; i < 2 * TIMED_TIMINGS; i++) {
        timed t;
        receive_with_offer(&t, i);
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, t.n.sample);
        timed_put(&t, CW_DOMINANT, CW_RECESSIVE, 1);
        timed_put(&t, CW_DOMINANT, CW_DOMINANT, t.n.bit - 1);
        timed_sends_rest(&t, 1);
        timed_play(&t, 0, 2, 0, 0);
    }
}

/* An edge comes so many quanta before the end of a recessive bit, whose next one is dominant. */
static void check_early_edge(unsigned i, unsigned e)
{
    timed t;
    timed_begin_sending(&t, &timed_timings[i / 2], i & 1);
    const unsigned n = timed_at(&t, CW_FIELD_DATA, AFTER_DOMINANT);
    const bool wholly = e <= t.timing.sjw;
    timed_sends(&t, 0, n);
    timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, t.n.bit - e);
    if (wholly) {
        timed_put(&t, CW_DOMINANT, CW_RECESSIVE, 1);
        timed_put(&t, CW_DOMINANT, CW_DOMINANT, t.n.bit - 1);
    } else {
        timed_put(&t, CW_DOMINANT, CW_RECESSIVE, e - t.timing.sjw);
        timed_put(&t, CW_DOMINANT, CW_DOMINANT, t.n.bit);
    }
    timed_sends_rest(&t, n + 2);
    timed_play(&t, 0, 1, 0, 0);
}

static void run_early(bool wholly)
{
    for (unsigned i = 0; i < 2 * TIMED_TIMINGS; i++)
        for (unsigned e = 1; e <= timed_timings[i / 2].phase_seg2; e++)
            if ((e <= timed_timings[i / 2].sjw) == wholly)
                check_early_edge(i, e);
}

static void run_8_7_4(void)
{
    run_early(true);
}

static void run_8_7_5(void)
{
    run_early(false);
}

/* The first edge comes a quantum early, the second one two quanta late in the bit that begins by
 * it. */
static void run_8_7_6(void)
{
    for (unsigned i = 0; i < 2 * TIMED_TIMINGS; i++) {
        timed t;
        timed_begin_sending(&t, &timed_timings[i / 2], i & 1);
        const unsigned n = timed_at(&t, CW_FIELD_DATA, FIRST_OF_TWO);
        timed_sends(&t, 0, n);
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, t.n.bit - 1);
        timed_put(&t, CW_DOMINANT, CW_RECESSIVE, 1);
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, 1);
        timed_put(&t, CW_DOMINANT, CW_RECESSIVE, 1);
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, t.n.bit - 3);
        timed_sends_rest(&t, n + 2);
        timed_play(&t, 0, 1, 0, 0);
    }
}

/* The controller sees its own dominant bit late, up to the sample point. */
static void run_8_7_7(void)
{
    for (unsigned i = 0; i < 2 * TIMED_TIMINGS; i++)
        for (unsigned e = 1; e < cw_bit_timing_sample_at(&timed_timings[i / 2]); e++) {
            timed t;
            timed_begin_sending(&t, &timed_timings[i / 2], i & 1);
            const unsigned n = timed_at(&t, CW_FIELD_DATA, AFTER_DOMINANT) + 1;
            timed_sends(&t, 0, n);
            timed_force(&t, CW_RECESSIVE, CW_DOMINANT, e);
            timed_force(&t, CW_DOMINANT, CW_DOMINANT, t.n.bit - e);
            timed_sends_rest(&t, n + 1);
            timed_play(&t, 0, 1, 0, 0);
        }
}

/* The edge comes right after the sample point of a recessive bit, and the next one is recessive,
 * too. The next own edge comes so many quanta earlier as SJW says. */
static void run_8_7_8(void)
{
    for (unsigned i = 0; i < 2 * TIMED_TIMINGS; i++) {
        timed t;
        timed_begin_sending(&t, &timed_timings[i / 2], i & 1);
        const unsigned n = timed_at(&t, CW_FIELD_DATA, FIRST_OF_TWO);
        const unsigned earlier = at_most(t.timing.phase_seg2, t.timing.sjw);
        timed_sends(&t, 0, n);
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, t.n.sample);
        timed_put(&t, CW_DOMINANT, CW_RECESSIVE, 1);
        timed_put(&t, CW_RECESSIVE, CW_RECESSIVE, 2 * t.n.bit - earlier - t.n.sample - 1);
        timed_sends_rest(&t, n + 2);
        timed_play(&t, 0, 1, 0, 0);
    }
}

/* A dominant bit is recessive up to its sample point: a bit error. The level that comes back is an
 * edge, so the flag begins SJW earlier. */
static void run_8_7_9(void)
{
    for (unsigned i = 0; i < 2 * TIMED_TIMINGS; i++) {
        timed t;
        timed_begin_sending(&t, &timed_timings[i / 2], i & 1);
        const unsigned n = timed_at(&t, CW_FIELD_DATA, AFTER_DOMINANT) + 1;
        const unsigned earlier = at_most(t.timing.phase_seg2, t.timing.sjw);
        timed_sends(&t, 0, n);
        timed_force(&t, CW_RECESSIVE, CW_DOMINANT, t.n.sample);
        timed_sends_again(&t, 7 * t.n.bit - earlier - t.n.sample);
        timed_play(&t, 0, 1, 1, 0);
    }
}

static const test_case cases[] = {
    {"8.7.1", NULL, run_8_7_1}, {"8.7.2", NULL, run_8_7_2}, {"8.7.3", NULL, run_8_7_3},
    {"8.7.4", NULL, run_8_7_4}, {"8.7.5", NULL, run_8_7_5}, {"8.7.6", NULL, run_8_7_6},
    {"8.7.7", NULL, run_8_7_7}, {"8.7.8", NULL, run_8_7_8}, {"8.7.9", NULL, run_8_7_9},
};

const section section_8_7 = {"8.7", cases, sizeof cases / sizeof cases[0]};
