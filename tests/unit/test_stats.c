/* SPDX-License-Identifier: MIT
 *
 * test_stats.c - delay histograms against an exact computation, and the counters of nodes and bus.
 */
#include "model.h"
#include "rig.h"

#include "state/stats.h"

#define SAMPLES 5000
#define SECOND_BITS 500000u

/* ---- Delays ---------------------------------------------------------------------------------- */

TEST(buckets_are_four_an_octave_without_gaps)
{
    assert_int_equal(cw_delay_bucket_ticks(0), 0);
    for (unsigned b = 1; b < CW_DELAY_BUCKETS; b++)
        assert_true(cw_delay_bucket_ticks(b) > cw_delay_bucket_ticks(b - 1));
    for (unsigned b = 4; b + 4 < CW_DELAY_BUCKETS; b++)
        assert_int_equal(cw_delay_bucket_ticks(b + 4), 2 * cw_delay_bucket_ticks(b));
}

TEST(a_delay_goes_into_the_bucket_of_its_edges)
{
    for (unsigned b = 0; b < CW_DELAY_BUCKETS; b++) {
        cw_delay first = {.count = 0};
        cw_delay last = {.count = 0};
        cw_delay_add(&first, cw_delay_bucket_ticks(b));
        assert_int_equal(first.bucket[b], 1);
        if (b + 1 == CW_DELAY_BUCKETS)
            break;
        cw_delay_add(&last, cw_delay_bucket_ticks(b + 1) - 1);
        assert_int_equal(last.bucket[b], 1);
    }
    cw_delay longest = {.count = 0};
    cw_delay_add(&longest, UINT64_MAX - 1);
    assert_int_equal(longest.bucket[CW_DELAY_BUCKETS - 1], 1);
}

static int compare_ticks(const void *a, const void *b)
{
    uint64_t x = *(const uint64_t *)a;
    uint64_t y = *(const uint64_t *)b;
    return x < y ? -1 : x > y;
}

/* Returns the edge above a value, or the largest value when that is less. */
static uint64_t edge_above(uint64_t ticks, uint64_t max)
{
    for (unsigned b = 1; b < CW_DELAY_BUCKETS; b++)
        if (cw_delay_bucket_ticks(b) > ticks)
            return cw_delay_bucket_ticks(b) < max ? cw_delay_bucket_ticks(b) : max;
    return max;
}

TEST(quantiles_are_exact_up_to_the_bucket)
{
    static uint64_t all[SAMPLES];
    rig_random random = {99};
    cw_delay delay = {.count = 0};
    uint64_t sum = 0;
    for (unsigned i = 0; i < SAMPLES; i++) {
        all[i] = rig_next(&random) >> rig_below(&random, 24);
        sum += all[i];
        cw_delay_add(&delay, all[i]);
    }
    qsort(all, SAMPLES, sizeof all[0], compare_ticks);
    assert_int_equal(delay.count, SAMPLES);
    assert_int_equal(delay.sum_ticks, sum);
    assert_int_equal(delay.min_ticks, all[0]);
    assert_int_equal(delay.max_ticks, all[SAMPLES - 1]);
    for (unsigned permille = 1; permille <= 1000; permille++) {
        uint64_t exact = all[(SAMPLES * permille + 999) / 1000 - 1];
        uint64_t told = cw_delay_quantile_ticks(&delay, permille);
        assert_int_equal(told, edge_above(exact, all[SAMPLES - 1]));
        assert_true(told >= exact);
        assert_true(exact < 1280 || told <= exact + exact / 4);
    }
}

TEST(no_delay_has_no_quantile)
{
    cw_delay delay = {.count = 0};
    assert_int_equal(cw_delay_quantile_ticks(&delay, 500), 0);
    cw_delay_add(&delay, 5000);
    assert_int_equal(cw_delay_quantile_ticks(&delay, 1), 5000);
    assert_int_equal(cw_delay_quantile_ticks(&delay, 1000), 5000);
}

/* ---- Load ------------------------------------------------------------------------------------ */

/* Busy are SOF to the third intermission bit: a frame of L bits takes L + 3. */
TEST(busy_bits_are_the_frame_and_its_intermission)
{
    RIG *r = rig_new(2);
    cw_frame f = rig_frame(0x123, 0, 4);
    unsigned length = model_encode(&f).length;
    rig_start(r);
    rig_send(r, 0, &f, 0);
    rig_run_bits(r, JOIN);
    assert_int_equal(rig_bus_stats(r).busy_bits, 0);
    rig_run_bits(r, JOIN + length + 3);
    assert_int_equal(rig_bus_stats(r).busy_bits, length + 3);
    rig_run_bits(r, 1000);
    cw_bus_stats s = rig_bus_stats(r);
    assert_int_equal(s.busy_bits, length + 3);
    assert_int_equal(s.bits, 1000);
    assert_int_equal(s.ticks, 1000 * BIT);
    assert_int_equal(s.frames, 1);
    assert_int_equal(s.frame_bits, length);
    assert_int_equal(s.load_permille, length + 3);
}

TEST(a_saturated_bus_is_at_full_load)
{
    RIG *r = rig_new(2);
    cw_frame f = rig_frame(0x123, 0, 8);
    rig_start(r);
    for (unsigned i = 0; i < 16; i++)
        rig_send(r, 0, &f, 0);
    rig_run_bits(r, JOIN);
    cw_bus_stats before = rig_bus_stats(r);
    rig_run_bits(r, JOIN + 16 * (model_encode(&f).length + 3));
    cw_bus_stats after = rig_bus_stats(r);
    assert_int_equal(after.frames, 16);
    assert_int_equal(cw_load_permille(&before, &after), 1000);
    assert_int_equal(cw_load_permille(&after, &after), 0);
}

/* The second is made of ten slices of 100 ms; the present one and the nine before it count. */
TEST(load_of_the_last_second_slides)
{
    enum { SLICE = SECOND_BITS / 10, SLICES = 35 };
    uint64_t busy[SLICES + 1] = {0}; /* up to the beginning of each slice */
    RIG *r = rig_new(2);
    cw_frame f = rig_frame(0x123, 0, 8);
    rig_random random = {5};
    rig_start(r);
    for (unsigned i = 1; i <= SLICES; i++) {
        uint64_t start = (uint64_t)(i - 1) * SLICE * BIT;
        unsigned frames = i % 17 > 12 ? 0 : rig_below(&random, 300); /* with longer pauses */
        for (unsigned k = 0; k < frames; k++)
            rig_send(r, 0, &f, start + (uint64_t)k * 160 * BIT);
        rig_run_bits(r, (uint64_t)i * SLICE);
        cw_bus_stats s = rig_bus_stats(r);
        busy[i] = s.busy_bits;
        unsigned oldest = i > 10 ? i - 10 : 0;
        assert_int_equal(s.load_permille,
                         (busy[i] - busy[oldest]) * 1000 / ((uint64_t)(i - oldest) * SLICE));
    }
}

/* ---- Counters -------------------------------------------------------------------------------- */

/* Delay: from hand-in, in the middle of a bit too, to the end of EOF. */
TEST(delay_is_from_hand_in_to_the_end_of_eof)
{
    RIG *r = rig_new(2);
    cw_frame first = rig_frame(0x100, 0, 8);
    cw_frame second = rig_frame(0x200, 0, 0);
    uint64_t end_of_first = (JOIN + model_encode(&first).length) * (uint64_t)BIT;
    uint64_t end_of_second = end_of_first + (3 + model_encode(&second).length) * (uint64_t)BIT;
    rig_start(r);
    rig_send(r, 0, &first, 0);
    rig_send(r, 0, &second, 1234);
    rig_run_bits(r, 1000);
    cw_delay d = rig_stats(r, 0).delay;
    assert_int_equal(d.count, 2);
    assert_int_equal(d.min_ticks, end_of_first);
    assert_int_equal(d.max_ticks, end_of_second - 1234);
    assert_int_equal(d.sum_ticks, end_of_first + end_of_second - 1234);
}

/* Checks that every frame was sent, waits, or was dropped for a reason. */
static void assert_frames_are_conserved(const rig *r)
{
    size_t waiting = 0;
    for (unsigned i = 0; i < r->config.node_count; i++) {
        cw_node_stats s = rig_stats(r, i);
        uint64_t dropped = 0;
        for (unsigned why = 0; why < CW_DROP_COUNT; why++)
            dropped += s.dropped[why];
        assert_int_equal(s.handed_in, s.tx_frames + s.queue + dropped);
        assert_true(cw_node_stats_balance(&s));
        assert_in_range(s.queue, 0, s.queue_peak);
        assert_int_equal(s.delay.count, s.tx_frames);
        assert_int_equal(rig_count(r, CW_EVENT_DROP, (int)i), dropped);
        assert_int_equal(rig_count(r, CW_EVENT_TX, (int)i), s.tx_frames);
        assert_int_equal(rig_count(r, CW_EVENT_RX, (int)i), s.rx_frames);
        waiting += s.queue;
    }
    assert_int_equal(rig_bus_stats(r).pending, waiting);
}

/* Makes a bus with one node of every kind; bad frames; bus-off with restart; a full queue. */
static rig *new_busy_bus(void)
{
    static const uint8_t modes[] = {0, CW_MODE_ONE_SHOT, CW_MODE_LISTEN_ONLY, 0, 0};
    rig *r = rig_new(5);
    for (unsigned i = 0; i < 5; i++)
        r->nodes[i].modes = modes[i];
    r->nodes[3].queue = 2;
    r->nodes[4].restart_ticks = 10000 * BIT;
    rig_flip(r, "own-r0", CW_FIELD_R0, 0)->from = NODE(4);
    r->rules[0].at = NODE(4);
    rig_flip(r, "now-and-then", CW_FIELD_CRC, 3)->probability = UINT64_MAX / 4;
    rig_start(r);
    return r;
}

static void hand_in_random_frames(rig *r, unsigned frames)
{
    rig_random random = {31};
    for (unsigned i = 0; i < frames; i++) {
        cw_frame f = rig_random_frame(&random);
        if (rig_below(&random, 20) == 0)
            f.id |= 0x20000000;
        rig_send(r, rig_below(&random, 5), &f, rig_below(&random, 200000 * BIT));
    }
}

TEST(frames_are_conserved)
{
    RIG *r = new_busy_bus();
    hand_in_random_frames(r, 1500);
    for (unsigned bits = 0; bits <= 200000; bits += 977) {
        rig_run_bits(r, bits);
        assert_frames_are_conserved(r);
    }
    cw_node_stats one_shot = rig_stats(r, 1);
    cw_node_stats off = rig_stats(r, 4);
    assert_true(one_shot.dropped[CW_DROP_ONE_SHOT] > 0);
    assert_true(rig_stats(r, 2).dropped[CW_DROP_LISTEN_ONLY] > 0);
    assert_true(rig_stats(r, 0).dropped[CW_DROP_BAD_FRAME] > 0);
    assert_true(rig_stats(r, 3).dropped[CW_DROP_QUEUE_FULL] > 0);
    assert_true(off.dropped[CW_DROP_BUS_OFF] > 0);
    assert_true(off.bus_off > 1 && off.restarts > 1);
    assert_true(off.error_warning >= off.bus_off && off.error_passive >= off.bus_off);
}

TEST(counters_agree_with_events)
{
    RIG *r = new_busy_bus();
    hand_in_random_frames(r, 1000);
    rig_run_bits(r, 200000);
    uint64_t lost = 0;
    for (unsigned i = 0; i < 5; i++) {
        cw_node_stats s = rig_stats(r, i);
        uint64_t errors = 0;
        for (unsigned type = 0; type < CW_ERROR_COUNT; type++)
            errors += s.errors[type];
        assert_int_equal(errors, rig_count(r, CW_EVENT_ERROR, (int)i));
        assert_int_equal(s.arbitration_lost, rig_count(r, CW_EVENT_ARBITRATION_LOST, (int)i));
        assert_int_equal(s.overloads, rig_count(r, CW_EVENT_OVERLOAD, (int)i));
        assert_int_equal(s.restarts, rig_count(r, CW_EVENT_RESTART, (int)i));
        lost += s.arbitration_lost;
    }
    assert_true(lost > 0);
    assert_int_equal(rig_bus_stats(r).arbitration_lost, lost);
    assert_int_equal(rig_bus_stats(r).faults, rig_count(r, CW_EVENT_FAULT, -1));
    assert_int_equal(rig_bus_stats(r).frames, rig_count(r, CW_EVENT_TX, -1));
}

/* Three attempts spoilt, the fourth good: three retransmissions and three error frames, each of
 * which is one although the flags of all nodes are superposed. */
TEST(retransmissions_and_error_frames)
{
    RIG *r = rig_new(3);
    cw_frame f = rig_frame(0x123, 0, 2);
    rig_flip(r, "three", CW_FIELD_DATA, 5)->count = 3;
    rig_start(r);
    rig_send(r, 0, &f, 0);
    rig_send(r, 0, &f, 0);
    rig_run_bits(r, 2000);
    cw_node_stats s = rig_stats(r, 0);
    assert_int_equal(s.tx_frames, 2);
    assert_int_equal(s.tx_bytes, 4);
    assert_int_equal(s.tx_bits, 2 * model_encode(&f).length);
    assert_int_equal(s.retransmissions, 3);
    assert_int_equal(s.errors[CW_ERROR_BIT], 3);
    assert_int_equal(s.tec, 22); /* three times 8, twice one less */
    assert_int_equal(rig_bus_stats(r).error_frames, 3);
    assert_int_equal(rig_bus_stats(r).overload_frames, 0);
    assert_int_equal(rig_stats(r, 1).rx_bytes, 4);
}

/* An attempt after lost arbitration is a retransmission too. */
TEST(attempts_after_lost_arbitration_count)
{
    RIG *r = rig_new(3);
    cw_frame high = rig_frame(0x100, 0, 0);
    cw_frame low = rig_frame(0x101, 0, 0);
    rig_start(r);
    rig_send(r, 0, &high, 0);
    rig_send(r, 1, &low, 0);
    rig_run_bits(r, 500);
    assert_int_equal(rig_stats(r, 0).retransmissions, 0);
    assert_int_equal(rig_stats(r, 1).retransmissions, 1);
    assert_int_equal(rig_stats(r, 1).arbitration_lost, 1);
}

TEST(queue_depth_and_its_peak)
{
    RIG *r = rig_new(2);
    cw_frame f = rig_frame(0x123, 0, 0);
    rig_start(r);
    for (unsigned i = 0; i < 5; i++)
        rig_send(r, 0, &f, 0);
    rig_run_bits(r, 20);
    assert_int_equal(rig_stats(r, 0).queue, 5);
    assert_int_equal(rig_bus_stats(r).pending, 5);
    assert_int_equal(cw_bus_pending(r->bus), 5);
    rig_run_bits(r, 1000);
    assert_int_equal(rig_stats(r, 0).queue, 0);
    assert_int_equal(rig_stats(r, 0).queue_peak, 5);
}

TEST(what_does_not_exist_has_no_statistics)
{
    RIG *r = rig_new(2);
    cw_node_stats node;
    cw_rule_stats rule;
    rig_start(r);
    assert_int_equal(cw_node_get_stats(r->bus, 2, &node), CW_INVALID);
    assert_int_equal(cw_rule_get_stats(r->bus, 0, &rule), CW_INVALID);
}
