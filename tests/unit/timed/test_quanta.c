/* SPDX-License-Identifier: MIT
 *
 * test_quanta.c - the difference of two clocks that a pair of controllers stands, by the rules of
 * bit timing alone (T10, T11).
 */
#include "cases.h"
#include "quanta.h"

#define FRAMES 48u
#define PHASES 6u
#define MILLION 1000000
#define PERCENT (MILLION / 100)

static uint64_t mix(uint64_t x)
{
    x += 0x9E3779B97F4A7C15u;
    x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9u;
    x = (x ^ x >> 27) * 0x94D049BB133111EBu;
    return x ^ x >> 31;
}

static bool open_for_frames; /* all have integrated */

/* Node 0 sends frames of 8 bytes. Every other one has falling edges ten bits apart: four bits of
 * one level, and a stuff bit of the other level with four more. */
static bool next_frame(cw_frame *frame, unsigned node, unsigned number)
{
    const uint8_t rows = (uint8_t)(0x0F0F >> number / 2 % 8);
    if (node != 0 || !open_for_frames)
        return false;
    *frame = (cw_frame){.id = mix(~(uint64_t)number) & CW_BASE_ID_MAX, .dlc = 8};
    for (unsigned i = 0; i < 8; i++)
        frame->data[i] = (uint8_t)(number % 2 ? mix(number) >> 8 * i : rows);
    return true;
}

static void integrate(quanta *q)
{
    open_for_frames = false;
    while (cw_mac_get_phase(&q->nodes[0].mac) != CW_MAC_IDLE ||
           cw_mac_get_phase(&q->nodes[1].mac) != CW_MAC_IDLE)
        quanta_step(q);
    open_for_frames = true;
}

/* Returns true when all frames reach a receiver whose quantum is longer by so many millionths
 * (negative: shorter), without an error of anybody. */
static bool stands_from(const quanta_timing *timing, int64_t millionths, int64_t phase)
{
    quanta q = {.next_frame = next_frame};
    quanta_timing other = *timing;
    other.quantum += timing->quantum * millionths / MILLION;
    quanta_add(&q, timing, 0);
    quanta_add(&q, &other, phase);
    integrate(&q);
    while (q.nodes[0].sent < FRAMES && q.nodes[0].errors + q.nodes[1].errors == 0)
        quanta_step(&q);
    return q.nodes[0].sent == FRAMES && q.nodes[1].errors == 0 && q.nodes[1].received >= FRAMES - 1;
}

static bool stands(const quanta_timing *timing, int64_t millionths)
{
    for (unsigned i = 0; i < PHASES; i++)
        if (!stands_from(timing, millionths, timing->quantum * i / PHASES))
            return false;
    return true;
}

/* Timings with the first difference that fails, in percent: receiver slow, receiver fast. */
static const struct {
    const char *name;
    quanta_timing timing;
    double slow, fast;
} pairs[] = {
    {"1M 6-1-2/1", {100 * FS_PER_NS, 6, 1, 2, 1, false}, 1.15, 1.15},
    {"1M 10-2-3/2", {125 * FS_PER_NS / 2, 10, 2, 3, 2, false}, 1.37, 1.41},
    {"500k 4-5-6/4", {125 * FS_PER_NS, 4, 5, 6, 4, false}, 2.75, 2.83},
    {"125k 11-2-2/2", {500 * FS_PER_NS, 11, 2, 2, 2, false}, 1.27, 0.73},
    {"50k 11-4-4/4", {1000 * FS_PER_NS, 11, 4, 4, 4, false}, 2.05, 1.71},
    {"100k 1-4-4/4", {1000 * FS_PER_NS, 1, 4, 4, 4, false}, 4.17, 3.39},
};
#define PAIRS (sizeof pairs / sizeof pairs[0])

/* Checks that the first difference that fails is about the one that is expected. */
static void check_pair(unsigned i, double percent, int sign)
{
    const double least = percent * 0.95, most = percent * 1.07;
    if (!stands(&pairs[i].timing, sign * (int64_t)(least * PERCENT)))
        fail_msg("%s: %+.2f %% fails, expected from %.2f %% on", pairs[i].name, sign * least,
                 percent);
    if (stands(&pairs[i].timing, sign * (int64_t)(most * PERCENT)))
        fail_msg("%s: %+.2f %% does not fail", pairs[i].name, sign * most);
}

TEST(two_clocks_fail_where_the_phase_error_says)
{
    for (unsigned i = 0; i < PAIRS; i++) {
        check_pair(i, pairs[i].slow, 1);
        check_pair(i, pairs[i].fast, -1);
    }
}

static unsigned least_of(unsigned a, unsigned b)
{
    return a < b ? a : b;
}

static quanta_timing draw_timing(uint64_t seed)
{
    quanta_timing t = {.quantum = 100 * FS_PER_NS};
    t.prop = 1 + (unsigned)(mix(seed) % 8);
    t.seg1 = 1 + (unsigned)(mix(seed + 1) % 8);
    t.seg2 = 2 + (unsigned)(mix(seed + 2) % 7);
    t.sjw = 1 + (unsigned)(mix(seed + 3) % least_of(4, least_of(t.seg1, t.seg2)));
    return t;
}

/* Returns the sufficient limit for each of two clocks, in millionths (T10). */
static int64_t limit_of(const quanta_timing *t)
{
    const int64_t bit = quanta_bit(t);
    const int64_t by_width = MILLION * (int64_t)t->sjw / (20 * bit);
    const int64_t by_phase = MILLION * (int64_t)least_of(t->seg1, t->seg2 - 1) /
                             (2 * (13 * bit - t->seg2));
    return by_width < by_phase ? by_width : by_phase;
}

TEST(inside_the_sufficient_limit_nothing_fails)
{
    for (uint64_t seed = 0; seed < 12; seed++) {
        quanta_timing t = draw_timing(10 * seed);
        if (quanta_bit(&t) < 8)
            continue;
        const int64_t limit = 2 * limit_of(&t);
        if (!stands(&t, limit) || !stands(&t, -limit))
            fail_msg("%u-%u-%u/%u fails at %lld millionths", t.prop, t.seg1, t.seg2, t.sjw,
                     (long long)limit);
    }
}

/* Returns the first error of the sender when its receiver is so far away; NULL when there is
 * none. */
static const cw_error *first_error_at(quanta *q, const quanta_timing *timing, int64_t delay)
{
    *q = (quanta){.next_frame = next_frame};
    quanta_add(q, timing, 0);
    quanta_add(q, timing, 0);
    for (unsigned level = 0; level < 2; level++)
        q->delay[0][1][level] = q->delay[1][0][level] = delay;
    integrate(q);
    while (q->nodes[0].sent < FRAMES && q->nodes[0].errors == 0)
        quanta_step(q);
    return q->nodes[0].errors ? &q->nodes[0].first_error : NULL;
}

/* The acknowledgement comes after the sample point when the way there and back is longer than the
 * bit up to there. The receiver leads the edge by up to a quantum. */
TEST(a_line_too_long_breaks_the_acknowledgement)
{
    for (unsigned i = 0; i < PAIRS; i++) {
        const quanta_timing *t = &pairs[i].timing;
        const int64_t to_sample = (1 + t->prop + t->seg1) * t->quantum;
        quanta q;
        assert_null(first_error_at(&q, t, t->prop * t->quantum / 2));
        assert_null(first_error_at(&q, t, (to_sample - t->quantum / 10) / 2));
        const cw_error *error = first_error_at(&q, t, to_sample / 2 + t->quantum);
        assert_non_null(error);
        assert_int_equal(error->type, CW_ERROR_ACK);
    }
}

/* ---- A receiver, and a bench that cuts and stretches bits (ISO 16845-1, 7.7) ----------------- */

#define SETTLE_BITS 14 /* for integration, then idle */
#define AFTER_BITS 12

/* A frame on the bench: how many quanta each of its bits lasts, and a stuff bit in it. */
typedef struct script {
    quanta_timing timing;
    cw_bits bits;
    unsigned quanta[CW_BITS_MAX];
    unsigned stuff;     /* a dominant stuff bit */
    unsigned glitch_at; /* quantum of that bit in which the bench is recessive; 0: none */
    int64_t offset;     /* of the edges of the bench to the quanta of the controller */
} script;

/* The stuff bit comes within the first bits of the data. */
static void begin_script(script *s, const quanta_timing *timing, uint8_t data)
{
    const cw_frame frame = {.id = 0x555, .dlc = 1, .data = {data}};
    *s = (script){.timing = *timing, .offset = timing->quantum / 2};
    assert_int_equal(cw_bits_encode(&s->bits, &frame), CW_OK);
    while (!cw_bits_place(&s->bits, s->stuff).stuff || cw_bits_level(&s->bits, s->stuff))
        s->stuff++;
    for (unsigned n = 0; n < s->bits.length; n++)
        s->quanta[n] = quanta_bit(timing);
}

/* Moves the edge at which the stuff bit begins (negative: early), and cuts the bit to so many
 * quanta. The frame goes on in its time. */
static void disturb(script *s, int late, unsigned length)
{
    const unsigned bit = quanta_bit(&s->timing);
    s->quanta[s->stuff - 1] = (unsigned)((int)bit + late);
    s->quanta[s->stuff] = length;
    s->quanta[s->stuff + 1] = (unsigned)((int)(2 * bit) - late) - length;
}

static void write_script(const script *s, quanta_node *bench)
{
    const int64_t quantum = s->timing.quantum;
    int64_t at = SETTLE_BITS * quanta_bit(&s->timing) * quantum + s->offset;
    for (unsigned n = 0; n < s->bits.length; n++) {
        quanta_script(bench, at, cw_bits_level(&s->bits, n));
        if (n == s->stuff && s->glitch_at) {
            quanta_script(bench, at + s->glitch_at * quantum, CW_RECESSIVE);
            quanta_script(bench, at + (s->glitch_at + 1) * quantum, CW_DOMINANT);
        }
        at += s->quanta[n] * quantum;
    }
    quanta_script(bench, at, CW_RECESSIVE);
}

static bool sends_nothing(cw_frame *frame, unsigned node, unsigned number)
{
    (void)frame;
    (void)node;
    (void)number;
    return false;
}

/* Returns true when the controller receives the frame of the bench without an error. */
static bool reads(const script *s)
{
    quanta q = {.next_frame = sends_nothing};
    quanta_add(&q, &s->timing, 0);
    write_script(s, quanta_add_script(&q));
    const unsigned bits = SETTLE_BITS + s->bits.length + AFTER_BITS;
    while (q.nodes[0].now < bits * quanta_bit(&s->timing) * s->timing.quantum)
        quanta_step(&q);
    assert_true(q.nodes[0].received == 1 || q.nodes[0].errors > 0);
    return q.nodes[0].errors == 0;
}

/* Checks where the stuff bit is sampled: it is read when it lasts so many quanta, and not when it
 * lasts one less. */
static void check_sampled(const quanta_timing *timing, int late, unsigned length, unsigned glitch)
{
    for (unsigned less = 0; less < 2; less++) {
        script s;
        begin_script(&s, timing, 0xFF);
        disturb(&s, late, length - less);
        s.glitch_at = glitch;
        if (reads(&s) != (less == 0))
            fail_msg("%u-%u-%u/%u: an edge %d quanta late, the bit of %u quanta, is %s",
                     timing->prop, timing->seg1, timing->seg2, timing->sjw, late, length - less,
                     less ? "read" : "not read");
    }
}

static unsigned quanta_to_sample(const quanta_timing *t)
{
    return 1 + t->prop + t->seg1;
}

/* 7.7.1 */
TEST(a_bit_is_sampled_at_its_sample_point)
{
    for (unsigned i = 0; i < PAIRS; i++)
        check_sampled(&pairs[i].timing, 0, quanta_to_sample(&pairs[i].timing), 0);
}

/* T12: an edge at the very moment of a look comes in the next quantum. */
TEST(a_level_is_seen_after_its_moment)
{
    for (unsigned i = 0; i < PAIRS; i++) {
        script s;
        begin_script(&s, &pairs[i].timing, 0xFF);
        s.offset = 0;
        disturb(&s, 0, quanta_to_sample(&s.timing));
        assert_true(reads(&s));
        disturb(&s, 0, quanta_to_sample(&s.timing) - 1);
        assert_false(reads(&s));
    }
}

/* 7.7.3, 7.7.4 */
TEST(a_late_edge_is_corrected_up_to_the_jump_width)
{
    for (unsigned i = 0; i < PAIRS; i++) {
        const quanta_timing *t = &pairs[i].timing;
        for (unsigned e = 1; e < t->prop + t->seg1; e++) {
            const unsigned rest = e > t->sjw ? e - t->sjw : 0;
            check_sampled(t, (int)e, quanta_to_sample(t) - rest, 0);
        }
    }
}

/* 7.7.5, 7.7.6 */
TEST(an_early_edge_is_corrected_up_to_the_jump_width)
{
    for (unsigned i = 0; i < PAIRS; i++) {
        const quanta_timing *t = &pairs[i].timing;
        for (unsigned e = 1; e <= t->seg2; e++) {
            const unsigned rest = e > t->sjw ? e - t->sjw : 0;
            check_sampled(t, -(int)e, quanta_to_sample(t) + rest, 0);
        }
    }
}

/* 7.7.7: a second edge would move the sample point once more. */
TEST(only_one_edge_synchronises_between_samples)
{
    for (unsigned i = 0; i < PAIRS; i++) {
        const quanta_timing *t = &pairs[i].timing;
        if (quanta_to_sample(t) > 4)
            check_sampled(t, 0, quanta_to_sample(t), 1);
    }
}

/* 7.7.10: the bench is recessive for a quantum after the sample point of a dominant bit. The bit
 * after it is dominant, too, and cut at its sample point. */
TEST(an_edge_after_a_dominant_sample_does_not_synchronise)
{
    for (unsigned i = 0; i < PAIRS; i++)
        for (unsigned less = 0; less < 2; less++) {
            script s;
            begin_script(&s, &pairs[i].timing, 0xF5);
            s.glitch_at = quanta_to_sample(&s.timing);
            s.quanta[s.stuff + 1] = quanta_to_sample(&s.timing) - less;
            s.quanta[s.stuff + 2] += quanta_bit(&s.timing) - s.quanta[s.stuff + 1];
            assert_int_equal(reads(&s), less == 0);
        }
}

/* 7.7.9.1 */
TEST(a_glitch_in_idle_is_no_frame)
{
    for (unsigned i = 0; i < PAIRS; i++) {
        const quanta_timing *t = &pairs[i].timing;
        const int64_t begin = SETTLE_BITS * quanta_bit(t) * t->quantum + t->quantum / 2;
        for (unsigned length = 1; length <= quanta_to_sample(t); length++) {
            quanta q = {.next_frame = sends_nothing};
            quanta_add(&q, t, 0);
            quanta_node *bench = quanta_add_script(&q);
            quanta_script(bench, begin, CW_DOMINANT);
            quanta_script(bench, begin + length * t->quantum, CW_RECESSIVE);
            while (q.nodes[0].now < 2 * begin)
                quanta_step(&q);
            assert_int_equal(q.nodes[0].errors, length == quanta_to_sample(t));
        }
    }
}

/* 8.7.7: the transceiver gives a transmitter's own edges back two quanta late. */
TEST(a_transmitter_does_not_follow_its_own_delay)
{
    for (unsigned i = 0; i < PAIRS; i++) {
        const quanta_timing *t = &pairs[i].timing;
        quanta q = {.next_frame = next_frame};
        quanta_add(&q, t, 0);
        quanta_add(&q, t, 0);
        q.delay[0][0][0] = q.delay[0][0][1] = 2 * t->quantum;
        integrate(&q);
        while (q.nodes[0].edges < 20)
            quanta_step(&q);
        for (unsigned k = 1; k < 20; k++)
            assert_int_equal((q.nodes[0].edge_at[k] - q.nodes[0].edge_at[0]) %
                                 (quanta_bit(t) * t->quantum), 0);
    }
}
