/* SPDX-License-Identifier: MIT
 *
 * test_fault_noise.c - noise: bits flipped at random.
 */
#include "cases.h"
#include "rules.h"

#include "state/state.h"

/* A match that is passed over counts once, also when noise flips the very bit. */
TEST(noise_and_a_position_in_one_bit)
{
    cw_rule_stats stats[2];
    for (unsigned stepping = 0; stepping < 2; stepping++) {
        RIG *r = rig_new(2);
        const cw_frame frame = rig_frame(0x123, 0, 0);
        rig_flip(r, "flip", CW_FIELD_R0, 0)->skip = 1000;
        ADD_RULE(r, "noise", TIME, NOISE, .error_rate = UINT64_MAX / 80, .at = NODE(1));
        rig_start(r);
        cw_bus_set_stepping(r->bus, stepping == 1);
        for (unsigned i = 0; i < 200; i++)
            rig_send(r, 0, &frame, i * 100 * BIT);
        rig_run_bits(r, 200 * 100);
        assert_int_equal(cw_rule_get_stats(r->bus, 0, &stats[stepping]), CW_OK);
    }
    assert_in_range(stats[1].matches, 50, 300);
    assert_int_equal(stats[0].matches, stats[1].matches);
}

/* A follower of noise comes its delay after the end of the inverted bit. */
TEST(noise_is_followed_from_the_end_of_its_bit)
{
    RIG *r = rig_new(2);
    r->nodes[1].modes = CW_MODE_LISTEN_ONLY;
    ADD_RULE(r, "noise", TIME, NOISE, .time_begin = 100 * BIT, .error_rate = UINT64_MAX,
             .at = NODE(1), .count = 1);
    cw_rule *after = rig_rule(r, probe("after", CW_TRIGGER_ARMED));
    after->has_after = true;
    after->after_delay = 10 * BIT;
    rig_start(r);
    rig_run_bits(r, 200);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 0)->tick, 101 * BIT);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 1)->tick, 111 * BIT);
}

/* Noise counts its flips; it ends with its count, and takes frames as other rules do. */
TEST(noise_with_count_and_skip)
{
    RIG *r = rig_new(3);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    r->nodes[2].modes = CW_MODE_LISTEN_ONLY; /* whom it does not disturb */
    ADD_RULE(r, "noise", FRAME, NOISE, .error_rate = UINT64_MAX, .at = NODE(2), .skip = 1,
             .every = 2, .count = 60);
    rig_start(r);
    send_every(r, &frame, 100, 5); /* it takes the second and the fourth */
    rig_run_bits(r, JOIN + 99);
    assert_int_equal(hits(r, 0), 0);
    rig_run_bits(r, JOIN + 199);
    uint64_t length = hits(r, 0);
    assert_in_range(length, 44, 50);
    rig_run_bits(r, JOIN + 299);
    assert_int_equal(hits(r, 0), length);
    rig_run_bits(r, JOIN + 600);
    assert_int_equal(hits(r, 0), 60);
    assert_true(rule_stats(r, 0).over);
    assert_false(rule_stats(r, 0).active);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 5);
}

/* Makes a bus with two noises of one kind each and a listener, so that frames go on. */
static rig *noisy_rig(void)
{
    rig *r = rig_new(3);
    static const uint64_t rates[] = {UINT64_MAX / 50, UINT64_MAX / 3000};
    for (unsigned i = 0; i < 2; i++) {
        cw_rule *noise =
            ADD_RULE(r, i ? "seldom" : "often", TIME, NOISE);
        noise->error_rate = rates[i];
        noise->at = i ? 0 : NODE(2);
    }
    r->nodes[2].modes = CW_MODE_LISTEN_ONLY;
    rig_start(r);
    return r;
}

/* However often and for how many bits rules are asked, what comes is what they have said. */
TEST(questions_change_nothing)
{
    RIG *asked = noisy_rig(), *left_alone = noisy_rig();
    for (unsigned i = 1; i <= 400; i++) {
        const uint64_t before = hits(asked, 0) + hits(asked, 1);
        const unsigned touch = cw_rules_touch(&asked->bus->rules);
        const uint64_t quiet = cw_rules_keep_quiet(&asked->bus->rules, 4096, false);
        assert_true(touch == 0 || (touch & CW_TOUCH_AT_RANDOM) || (touch & CW_TOUCH_MORE));
        assert_int_equal(cw_rules_keep_quiet(&asked->bus->rules, 4096, false), quiet);
        assert_int_equal(cw_rules_keep_quiet(&asked->bus->rules, 10, false),
                         quiet < 10 ? quiet : 10);
        rig_run_bits(asked, 10 * i);
        rig_run_bits(left_alone, 10 * i);
        if (touch == CW_TOUCH_AT_RANDOM)
            assert_int_equal(hits(asked, 0) + hits(asked, 1) == before, quiet >= 10);
        for (unsigned rule = 0; rule < 2; rule++)
            assert_int_equal(hits(asked, rule), hits(left_alone, rule));
    }
    assert_in_range(hits(asked, 0), 40, 160);
}

/* ---- Bursts ---------------------------------------------------------------------------------- */

typedef struct seen_bursts {
    unsigned of[CW_BURST_MAX + 1]; /* by length */
    unsigned count;
    unsigned inner;         /* bits between the first and the last one ... */
    unsigned inner_flipped;
} seen_bursts;

static void end_burst(seen_bursts *b, uint64_t first, uint64_t last, unsigned flipped)
{
    const unsigned length = (unsigned)((last - first) / BIT + 1);
    assert_in_range(length, 1, CW_BURST_MAX);
    b->of[length]++;
    b->count++;
    b->inner += length > 2 ? length - 2 : 0;
    b->inner_flipped += flipped > 2 ? flipped - 2 : 0;
}

/* Groups flipped bits of a rule that has a hit once in some 5000 bits. */
static seen_bursts run_bursts(unsigned least, unsigned most, uint64_t at, bool stepping)
{
    seen_bursts b = {.count = 0};
    uint64_t first = 0, last = 0;
    unsigned flipped = 0;
    RIG *r = rig_new(2);
    ADD_RULE(r, "noise", TIME, NOISE, .error_rate = UINT64_MAX / 5000,
             .burst_least = (uint16_t)least, .burst_most = (uint16_t)most, .at = at);
    rig_start(r);
    cw_bus_set_stepping(r->bus, stepping);
    rig_run_bits(r, 1000000);
    for (size_t i = 0; i < r->count; i++) {
        const uint64_t tick = r->events[i].tick;
        if (r->events[i].kind != CW_EVENT_FAULT)
            continue;
        if (flipped && tick > first + (CW_BURST_MAX - 1) * BIT) {
            end_burst(&b, first, last, flipped);
            flipped = 0;
        }
        first = flipped++ ? first : tick;
        last = tick;
    }
    return b;
}

/* Some of the some 200 begin so early that they look like one with the burst before. */
TEST(a_burst_has_its_length)
{
    const seen_bursts b = run_bursts(15, 15, 0, false);
    assert_in_range(b.count, 150, 250);
    assert_in_range(b.of[15], b.count - 6, b.count);
    assert_in_range(b.inner_flipped, b.inner * 4 / 10, b.inner * 6 / 10);
    const seen_bursts stepped = run_bursts(15, 15, 0, true);
    assert_memory_equal(&b, &stepped, sizeof b);
}

TEST(lengths_are_drawn_evenly)
{
    const seen_bursts b = run_bursts(1, 15, NODE(1), false);
    for (unsigned length = 1; length <= 15; length++)
        assert_in_range(b.of[length], b.count / 15 / 3, b.count / 15 * 2 + 4);
    const seen_bursts single = run_bursts(1, 1, NODE(1), false);
    const seen_bursts none = run_bursts(0, 0, NODE(1), false);
    assert_memory_equal(&single, &none, sizeof none);
}

TEST(bursts_out_of_range_are_refused)
{
    static const uint16_t wrong[][2] = {{0, 5}, {5, 4}, {1, CW_BURST_MAX + 1}, {1, 0}};
    RIG *r = rig_new(2);
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        r->config.rule_count = 0;
        ADD_RULE(r, "noise", TIME, NOISE, .burst_least = wrong[i][0], .burst_most = wrong[i][1]);
        FREED void *memory = malloc(cw_bus_size(&r->config));
        assert_non_null(memory);
        assert_null(cw_bus_init(memory, &r->config));
    }
}
