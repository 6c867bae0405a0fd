/* SPDX-License-Identifier: MIT
 *
 * test_fault_match.c - which frames a fault rule matches, which matches it takes, and what it is
 * bound to.
 */
#include "cases.h"
#include "model.h"
#include "rules.h"
#include "times.h"

/* ---- Chosen matches -------------------------------------------------------------------------- */

/* Makes a bus with a listener at which a rule acts: only hits happen. */
static rig *new_observed_bus(unsigned rules)
{
    static const char *const names[] = {"a", "b", "c"};
    rig *r = rig_new(3);
    r->nodes[0].queue = 256;
    r->nodes[2].modes = CW_MODE_LISTEN_ONLY;
    for (unsigned i = 0; i < rules; i++)
        rig_flip(r, names[i], CW_FIELD_BIT, 20)->at = NODE(2);
    return r;
}

#define OBSERVED_FRAMES 200u
#define OBSERVED_PAUSE 200u

/* Prints one character per frame: '1' where the rule hit. */
static void hit_pattern(char *pattern, rig *r, unsigned rule)
{
    memset(pattern, '0', OBSERVED_FRAMES);
    pattern[OBSERVED_FRAMES] = '\0';
    for (size_t i = 0; i < r->count; i++)
        if (r->events[i].kind == CW_EVENT_FAULT && r->events[i].rule == rule)
            pattern[r->events[i].tick / (OBSERVED_PAUSE * BIT)] = '1';
}

static void run_observed(rig *r)
{
    rig_start(r);
    for (unsigned i = 0; i < OBSERVED_FRAMES; i++) {
        cw_frame f = rig_frame(0x100 + i % 4, 0, 1);
        rig_send(r, 0, &f, (uint64_t)i * OBSERVED_PAUSE * BIT);
    }
    rig_run_bits(r, OBSERVED_FRAMES * OBSERVED_PAUSE);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), OBSERVED_FRAMES);
}

typedef struct choice {
    uint32_t skip;
    uint32_t every;
    uint32_t count;
    const char *pattern; /* of the first frames; behind them '0' when count is not 0 */
} choice;

TEST(matches_are_chosen_by_skip_every_and_count)
{
    static const choice cases[] = {
        {0, 1, 0, "11111111111111"}, {3, 1, 0, "00011111111111"}, {0, 4, 0, "10001000100010"},
        {2, 3, 0, "00100100100100"}, {0, 1, 3, "11100000000000"}, {3, 4, 2, "00010001000000"},
        {0, 0, 1, "10000000000000"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char pattern[OBSERVED_FRAMES + 1];
        cw_rule_stats stats;
        RIG *r = new_observed_bus(1);
        r->rules[0].skip = cases[i].skip;
        r->rules[0].every = cases[i].every;
        r->rules[0].count = cases[i].count;
        run_observed(r);
        hit_pattern(pattern, r, 0);
        assert_memory_equal(pattern, cases[i].pattern, strlen(cases[i].pattern));
        assert_int_equal(cw_rule_get_stats(r->bus, 0, &stats), CW_OK);
        assert_int_equal(stats.hits, rig_count(r, CW_EVENT_FAULT, -1));
        assert_int_equal(rig_nth(r, CW_EVENT_FAULT, stats.hits - 1)->hit, stats.hits);
        if (cases[i].count)
            assert_int_equal(stats.hits, cases[i].count);
        else
            assert_int_equal(stats.matches, OBSERVED_FRAMES);
    }
}

typedef struct passed_over {
    cw_field field;
    unsigned index;
    uint64_t time_end;
    unsigned matches; /* of ten frames: base and extended in turns, of no byte and one */
} passed_over;

/* Each frame has finished before a call reads anything. Matches that `skip` passes over still
 * count, and only in frames that have the bit. */
TEST(matches_passed_over_are_counted_in_frames_that_have_the_bit)
{
    static const passed_over cases[] = {
        {CW_FIELD_CRC, 3, CW_NEVER, 10},   {CW_FIELD_ID, 10, CW_NEVER, 10},
        {CW_FIELD_ID, 28, CW_NEVER, 5},    {CW_FIELD_SRR, 0, CW_NEVER, 5},
        {CW_FIELD_DATA, 7, CW_NEVER, 5},   {CW_FIELD_DATA, 8, CW_NEVER, 0},
        {CW_FIELD_CRC, 3, 1000 * BIT, 5},  {CW_FIELD_ERROR_FLAG, 0, CW_NEVER, 0},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        cw_rule_stats stats;
        RIG *r = rig_new(2);
        cw_rule *rule = rig_flip(r, "a", cases[i].field, cases[i].index);
        rule->skip = 100;
        rule->time_end = cases[i].time_end;
        rig_start(r);
        for (unsigned n = 0; n < 10; n++) {
            cw_frame f = rig_frame(0x100, n % 2 ? CW_FRAME_EXTENDED : 0, (n + n / 2) % 2);
            rig_send(r, 0, &f, (uint64_t)n * OBSERVED_PAUSE * BIT);
        }
        rig_run_bits(r, 10 * OBSERVED_PAUSE);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 10);
        assert_int_equal(cw_rule_get_stats(r->bus, 0, &stats), CW_OK);
        assert_int_equal(stats.matches, cases[i].matches);
        assert_int_equal(stats.hits, 0);
    }
}

/* Filter, sender, time: half open, at the start of the bit. */
TEST(matches_need_frame_sender_and_time)
{
    char pattern[OBSERVED_FRAMES + 1];
    RIG *r = new_observed_bus(3);
    r->rules[0].filters[0] = (cw_filter){.value = 0x101, .mask = 0x7FF};
    r->rules[0].filter_count = 1;
    r->rules[1].from = NODE(1);
    /* the 20th bit of the third frame starts at 400 + 20, that of the fifth at 800 + 20 */
    r->rules[2].time_begin = 420 * BIT;
    r->rules[2].time_end = 820 * BIT;
    run_observed(r);
    hit_pattern(pattern, r, 0);
    assert_memory_equal(pattern, "0100010001000100", 16);
    hit_pattern(pattern, r, 1);
    assert_null(strchr(pattern, '1'));
    hit_pattern(pattern, r, 2);
    assert_memory_equal(pattern, "0011000000", 10);
    assert_null(strchr(pattern + 10, '1'));
}

TEST(an_inverted_filter_and_a_second_one)
{
    char pattern[OBSERVED_FRAMES + 1];
    RIG *r = new_observed_bus(2);
    r->rules[0].filters[0] = (cw_filter){.value = 0x101, .mask = 0x7FF, .inverted = true};
    r->rules[0].filter_count = 1;
    r->rules[1].filters[0] = (cw_filter){.value = 0x101, .mask = 0x7FF};
    r->rules[1].filters[1] = (cw_filter){.value = 0x103, .mask = 0x7FF};
    r->rules[1].filter_count = 2;
    run_observed(r);
    hit_pattern(pattern, r, 0);
    assert_memory_equal(pattern, "10111011", 8);
    hit_pattern(pattern, r, 1);
    assert_memory_equal(pattern, "01010101", 8);
}

/* Each rule draws from its own stream: another rule, before or behind it, changes nothing. */
TEST(random_streams_of_rules_are_independent)
{
    char alone[OBSERVED_FRAMES + 1];
    char beside[OBSERVED_FRAMES + 1];
    char other[OBSERVED_FRAMES + 1];
    RIG *r = new_observed_bus(1);
    r->rules[0].name = "b";
    r->rules[0].probability = UINT64_C(1) << 63;
    run_observed(r);
    hit_pattern(alone, r, 0);
    assert_in_range(rig_count(r, CW_EVENT_FAULT, -1), 70, 130); /* about half */
    rig_free(r);
    r = new_observed_bus(3);
    for (unsigned i = 0; i < 3; i++)
        r->rules[i].probability = UINT64_C(1) << 63;
    run_observed(r);
    hit_pattern(beside, r, 1);
    hit_pattern(other, r, 0);
    assert_string_equal(alone, beside);
    assert_string_not_equal(alone, other);
    rig_free(r);
    r = new_observed_bus(2);
    r->rules[1].probability = UINT64_C(1) << 63;
    r->config.seed = 2;
    run_observed(r);
    hit_pattern(other, r, 1);
    assert_string_not_equal(alone, other);
}

/* Drawn only for matches that skip and every let through. */
TEST(probability_is_drawn_last)
{
    char all[OBSERVED_FRAMES + 1];
    char some[OBSERVED_FRAMES + 1];
    RIG *r = new_observed_bus(1);
    r->rules[0].probability = UINT64_C(1) << 63;
    run_observed(r);
    hit_pattern(all, r, 0);
    rig_free(r);
    r = new_observed_bus(1);
    r->rules[0].probability = UINT64_C(1) << 63;
    r->rules[0].skip = 2;
    r->rules[0].every = 3;
    run_observed(r);
    hit_pattern(some, r, 0);
    for (unsigned i = 2, k = 0; i < OBSERVED_FRAMES; i += 3, k++)
        assert_int_equal(some[i], all[k]);
}

/* A node that lost arbitration transmits no more: a rule for its later bits does not match. */
TEST(a_rule_ends_with_lost_arbitration)
{
    RIG *r = rig_new(3);
    cw_frame high = rig_frame(0x100, 0, 1);
    cw_frame low = rig_frame(0x101, 0, 1);
    r->nodes[2].modes = CW_MODE_LISTEN_ONLY;
    rig_flip(r, "low", CW_FIELD_DATA, 0)->from = NODE(1);
    r->rules[0].at = NODE(2);
    rig_start(r);
    rig_send(r, 0, &high, 0);
    rig_send(r, 1, &low, 0);
    rig_run_bits(r, 300);
    uint64_t sof = JOIN + model_encode(&high).length + INTERMISSION_BITS;
    assert_int_equal(rig_count(r, CW_EVENT_FAULT, -1), 1);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 0)->tick, end_of(sof, model_encode(&low).at[19]));
}

/* ---- Random streams -------------------------------------------------------------------------- */

#define DRAWS 100u

/* Returns a bit for each of DRAWS frames that the rule of that name took. Rules with draws of their
 * own stand before and behind it. */
static void drawn_by(const char *name, uint64_t seed, unsigned before, unsigned behind, char *out)
{
    static const char *const others[] = {"p", "q", "r", "s"};
    RIG *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    r->config.seed = seed;
    for (unsigned i = 0; i <= before + behind; i++) {
        cw_rule rule = probe(i == before ? name : others[i % 4], CW_TRIGGER_FRAME);
        rule.probability = UINT64_MAX / 2;
        *rig_rule(r, rule) = rule;
    }
    rig_start(r);
    send_every(r, &frame, 100, DRAWS);
    for (unsigned i = 0; i < DRAWS; i++) {
        uint64_t past = hits(r, before);
        rig_run_bits(r, JOIN + 100 * (i + 1));
        out[i] = hits(r, before) > past ? '1' : '0';
    }
    out[DRAWS] = '\0';
}

TEST(other_rules_do_not_change_the_draws)
{
    char alone[DRAWS + 1];
    char among[DRAWS + 1];
    drawn_by("x", 7, 0, 0, alone);
    for (unsigned before = 0; before < 4; before++) {
        for (unsigned behind = 0; behind < 4; behind++) {
            drawn_by("x", 7, before, behind, among);
            assert_string_equal(alone, among);
        }
    }
}

TEST(seed_and_name_decide_the_draws)
{
    char one[DRAWS + 1];
    char other[DRAWS + 1];
    drawn_by("x", 7, 0, 0, one);
    drawn_by("x", 8, 0, 0, other);
    assert_string_not_equal(one, other);
    drawn_by("y", 7, 0, 0, other);
    assert_string_not_equal(one, other);
}

/* ---- Many rules ------------------------------------------------------------------------------ */

#define MANY 1000u

/* Identifiers in a mixed order, all different; every third one extended. */
static cw_frame frame_of_rule(unsigned i)
{
    bool extended = i % 3 == 0;
    cw_frame frame = {.id = i * 7919u % 2048u, .flags = extended ? CW_FRAME_EXTENDED : 0};
    if (extended)
        frame.id |= i << 11;
    return frame;
}

static cw_rule *many_rules(void)
{
    static char names[MANY][8];
    cw_rule *rules = calloc(MANY, sizeof *rules);
    assert_non_null(rules);
    for (unsigned i = 0; i < MANY; i++) {
        const cw_frame frame = frame_of_rule(i);
        snprintf(names[i], sizeof names[i], "r%u", i);
        rules[i] = probe(names[i], CW_TRIGGER_FRAME);
        exactly(&rules[i], frame.id | (frame.flags ? CW_FILTER_EXTENDED : 0));
    }
    return rules;
}

TEST(many_exact_identifiers_meet_their_own_frames)
{
    RIG *r = rig_new(2);
    cw_rule *rules = many_rules();
    r->config.rules = rules;
    r->config.rule_count = MANY;
    rig_start(r);
    for (unsigned i = 0; i < MANY; i += 3) /* a third is taken out again */
        assert_int_equal(cw_bus_clear_rule(r->bus, (i + 1) % MANY), CW_OK);
    for (unsigned i = 0; i < MANY; i++) {
        const cw_frame frame = frame_of_rule(i);
        size_t before = r->count;
        bool cleared = i == 0 || i % 3 == 1;
        rig_send(r, i % 2, &frame, cw_bus_now(r->bus));
        rig_run_bits(r, JOIN + 100 * (i + 1));
        assert_int_equal(rig_count(r, CW_EVENT_TX, -1), i + 1);
        bool told = r->events[before].kind == CW_EVENT_FAULT;
        assert_int_equal(told, !cleared);
        if (told)
            assert_int_equal(r->events[before].rule, i);
    }
    free(rules);
}

/* Rules on one identifier, and others between them, act in their order. */
TEST(rules_on_one_frame_act_in_their_order)
{
    RIG *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 1);
    for (unsigned i = 0; i < 6; i++) {
        cw_rule rule = new_rule("change", CW_TRIGGER_FRAME, CW_ACTION_CHANGE);
        memset(rule.change.and_mask, 0xFF, sizeof rule.change.and_mask);
        if (i % 2)
            exactly(&rule, 0x123);
        if (i % 3 == 0)
            rule.change.set_mask[0] = 0xFF;
        rule.change.set[0] = (uint8_t)i;
        rule.change.xor_mask[0] = (uint8_t)(i << 4);
        rig_rule(r, rule);
    }
    rig_start(r);
    rig_send(r, 0, &frame, 0);
    rig_run_bits(r, 200);
    /* 0: set 00; 1, 2: xor 10, 20; 3: set 03 xor 30; 4, 5: xor 40, 50 */
    assert_int_equal(rig_nth(r, CW_EVENT_RX, 0)->frame.data[0], 0x33 ^ 0x40 ^ 0x50);
    for (unsigned i = 0; i < 6; i++)
        assert_int_equal(rig_nth(r, CW_EVENT_FAULT, i)->rule, i);
}

/* ---- Filters of any shape -------------------------------------------------------------------- */

#define SHAPES 48u
#define SHAPED_FRAMES 64u

/* More kinds of masks than the index has classes. Some match only base frames, some both formats,
 * some remote frames, and some all but the named ones. */
static cw_filter shaped_filter(unsigned i)
{
    static const uint32_t masks[] = {0x800007FF, 0x800007FE, 0x9FFFFFFF, 0x000007FF, 0x80000000,
                                     0x9FFFFFF0, 0x40000000, 0x4000000F, 0x80000700, 0x80000003,
                                     0x00000000, 0x9FF00000, 0x8000000C};
    const uint32_t scrambled = i * UINT32_C(2654435761);
    return (cw_filter){.value = scrambled >> 28 | (scrambled & CW_FILTER_EXTENDED) |
                                (i % 5 == 0 ? CW_FILTER_REMOTE : 0) | (i % 7 == 0 ? 0x1000u : 0),
                       .mask = masks[i % (sizeof masks / sizeof masks[0])],
                       .inverted = i % 11 == 10};
}

static cw_frame shaped_frame(unsigned i)
{
    return (cw_frame){.id = (i & 15u) | (i % 3 == 0 ? 0x1000u : 0) * (i % 2),
                      .flags = (uint8_t)((i % 2 ? CW_FRAME_EXTENDED : 0) |
                                         (i & 16u ? CW_FRAME_REMOTE : 0))};
}

static cw_rule shaped_rule(unsigned i)
{
    static char names[SHAPES][8];
    cw_rule rule = probe(names[i], CW_TRIGGER_FRAME);
    snprintf(names[i], sizeof names[i], "s%u", i);
    rule.filter_count = (uint8_t)(i % 4);
    for (unsigned k = 0; k < rule.filter_count; k++)
        rule.filters[k] = shaped_filter(3 * i + k);
    return rule;
}

/* Sends one frame after the other; existing rules must match the frames that their filters
 * match. */
static void send_shaped_frames(rig *r, const bool *there)
{
    for (unsigned i = 0; i < SHAPED_FRAMES; i++) {
        const cw_frame frame = shaped_frame(i);
        uint64_t before[SHAPES] = {0};
        for (unsigned k = 0; k < SHAPES; k++)
            before[k] = there[k] ? hits(r, k) : 0;
        rig_send(r, 0, &frame, cw_bus_now(r->bus));
        rig_run_bits(r, cw_bus_now(r->bus) / BIT + 200);
        for (unsigned k = 0; k < SHAPES; k++) {
            const cw_rule rule = shaped_rule(k);
            bool matches = there[k] && cw_frame_matches(&frame, rule.filters, rule.filter_count);
            if ((there[k] ? hits(r, k) : 0) != before[k] + matches)
                fail_msg("frame %u, rule %u: should%s match", i, k, matches ? "" : " not");
        }
    }
}

TEST(filters_of_any_shape_find_their_frames)
{
    RIG *r = rig_new(2);
    bool there[SHAPES] = {false};
    r->config.rule_room = SHAPES;
    rig_start(r);
    for (unsigned i = 0; i < SHAPES; i++) {
        assert_int_equal(add(r, shaped_rule(i)), i);
        there[i] = true;
    }
    send_shaped_frames(r, there);
    for (unsigned i = 0; i < SHAPES; i++) {
        there[i] = i % 3 == 2;
        if (!there[i])
            assert_int_equal(cw_bus_clear_rule(r->bus, i), CW_OK);
    }
    send_shaped_frames(r, there);
    for (unsigned i = 0; i < SHAPES; i += 3) {
        unsigned place = add(r, shaped_rule(i));
        assert_in_range(place, 0, i); /* the lowest that is free */
        assert_int_equal(cw_bus_clear_rule(r->bus, place), CW_OK);
    }
    send_shaped_frames(r, there);
}

/* ---- What a rule is bound to ----------------------------------------------------------------- */

/* An error in the intermission, when the queue holds another frame in the same place already. */
TEST(a_rule_knows_its_frame_to_the_end)
{
    for (unsigned stepping = 0; stepping < 2; stepping++) {
        RIG *r = rig_new(2);
        const cw_frame frame = rig_frame(0x123, 0, 0);
        const cw_frame other = rig_frame(0x456, 0, 0);
        cw_rule *flip = rig_flip(r, "flip", CW_FIELD_ERROR_FLAG, 2);
        exactly(flip, 0x123);
        ADD_RULE(r, "error", ARMED, ERROR_FLAG, .nodes = NODE(1), .manual = true);
        r->nodes[0].queue = 1;
        rig_start(r);
        cw_bus_set_stepping(r->bus, stepping == 1);
        rig_send(r, 0, &frame, 0);
        while (rig_count(r, CW_EVENT_TX, 0) == 0)
            rig_run(r, cw_bus_now(r->bus) + BIT);
        rig_send(r, 0, &other, cw_bus_now(r->bus));
        rig_run(r, cw_bus_now(r->bus) + BIT);
        assert_int_equal(cw_bus_fire_rule(r->bus, 1), CW_OK);
        rig_run_bits(r, 500);
        assert_int_equal(hits(r, 0), 1);
    }
}

/* On a partitioned bus a frame is from those on the receiver's own wire. */
TEST(the_sender_is_on_the_same_wire)
{
    RIG *r = rig_new(4);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    cw_rule *cut = ADD_RULE(r, "cut", TIME, PARTITION);
    cut->group[2] = cut->group[3] = 1;
    ADD_RULE(r, "drop", FRAME, DROP, .side = CW_SIDE_RX, .from = NODE(0));
    rig_start(r);
    rig_send(r, 0, &frame, 0);
    rig_send(r, 2, &frame, 0);
    rig_run_bits(r, 200);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 2);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 0);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 3), 1);
}

/* The transmitter has an error in the bit in which the others take its frame. */
TEST(the_sender_may_have_an_error_in_the_last_bit)
{
    RIG *r = rig_new(3);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    cw_rule *flip = rig_flip(r, "flip", CW_FIELD_EOF, 5);
    flip->at = NODE(0);
    flip->count = 1;
    ADD_RULE(r, "drop", FRAME, DROP, .side = CW_SIDE_RX, .from = NODE(0));
    rig_start(r);
    rig_send(r, 0, &frame, 0);
    rig_run_bits(r, 300);
    assert_int_equal(rig_count(r, CW_EVENT_RX, -1), 0);
    assert_int_equal(hits(r, 1), 2); /* one per frame, whatever its receivers */
}

/* A rule is bound to one transmission: not to the next one, even right behind it. */
TEST(a_rule_is_bound_to_its_own_frame)
{
    RIG *r = rig_new(2);
    cw_rule *mark = ADD_RULE(r, "mark", FRAME, FORCE, .level = CW_RECESSIVE, .field = CW_FIELD_EOF);
    exactly(mark, 0x101);
    rig_start(r);
    for (unsigned i = 0; i < 4; i++) {
        const cw_frame frame = rig_frame(0x100 + i, 0, 0);
        rig_send(r, 0, &frame, 0);
    }
    rig_run_bits(r, 400);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 4);
    assert_int_equal(hits(r, 0), 1);
}

/* Nor to any when it has been stopped. */
TEST(a_stopped_rule_lets_go_of_the_frame)
{
    RIG *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    (void)rig_flip(r, "end", CW_FIELD_EOF, 6);
    rig_start(r);
    rig_send(r, 0, &frame, 0);
    rig_run_bits(r, JOIN + 20);
    assert_int_equal(cw_bus_stop_rule(r->bus, 0), CW_OK);
    rig_run_bits(r, 100);
    assert_int_equal(hits(r, 0), 0);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
}

/* ---- Filters alone --------------------------------------------------------------------------- */

TEST(frames_match_filters)
{
    static const cw_filter base = {.value = 0x123, .mask = CW_FILTER_EXTENDED | 0x7FF};
    static const cw_filter remote = {.value = CW_FILTER_REMOTE, .mask = CW_FILTER_REMOTE};
    static const cw_filter others = {.value = 0x100, .mask = 0x700, .inverted = true};
    const cw_filter both[] = {base, remote};
    const cw_frame data = rig_frame(0x123, 0, 1);
    const cw_frame extended = rig_frame(0x123, CW_FRAME_EXTENDED, 1);
    const cw_frame request = rig_frame(0x456, CW_FRAME_REMOTE, 1);
    assert_true(cw_frame_matches(&data, NULL, 0));
    assert_true(cw_frame_matches(&data, &base, 1));
    assert_false(cw_frame_matches(&extended, &base, 1));
    assert_false(cw_frame_matches(&request, &base, 1));
    assert_true(cw_frame_matches(&request, both, 2));
    assert_false(cw_frame_matches(&data, &others, 1));
    assert_true(cw_frame_matches(&request, &others, 1));
}
