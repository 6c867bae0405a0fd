/* SPDX-License-Identifier: MIT
 *
 * test_fault_step.c - fault rules on a bus that takes frames in steps: the same matches, hits and
 * events as bit by bit, however time is advanced.
 */
#include "cases.h"
#include "rules.h"

#define ALL_RULES_MAX 64

/* ---- Matches --------------------------------------------------------------------------------- */

/* Makes two rules on each frame, or the first one alone; the last one hits one in so many
 * frames. */
static rig *patient_rules(cw_field first, cw_field second, unsigned every, bool stepping)
{
    rig *r = rig_new(2);
    rig_flip(r, "first", first, first == CW_FIELD_EOF ? 6 : 0)->skip = 1000;
    if (second != CW_FIELD_NONE)
        rig_flip(r, "second", second, 0);
    r->rules[r->config.rule_count - 1u].skip = 3;
    r->rules[r->config.rule_count - 1u].every = every;
    r->config.inbox = 16;
    r->nodes[0].queue = 1;
    r->config.events = stepping ? 4096 : 0;
    rig_start(r);
    cw_bus_set_stepping(r->bus, stepping);
    return r;
}

/* Sends frames, of which some are dropped while earlier ones are sent. */
static void send_some(rig *r)
{
    for (unsigned n = 0; n < 8; n++) {
        const cw_frame frame = rig_frame(0x100 + n, 0, 8);
        rig_send(r, n == 0, &frame, cw_bus_now(r->bus) + 37 * n * BIT);
    }
}

static void assert_same_matches(const rig *fast, const rig *reference)
{
    for (unsigned rule = 0; rule < fast->config.rule_count; rule++) {
        cw_rule_stats a, b;
        assert_int_equal(cw_rule_get_stats(fast->bus, rule, &a), CW_OK);
        assert_int_equal(cw_rule_get_stats(reference->bus, rule, &b), CW_OK);
        assert_int_equal(a.matches, b.matches);
        assert_int_equal(a.hits, b.hits);
    }
}

/* Matches of past bits are visible in the middle of a frame and with a full ring of events,
 * whatever the rules let pass. */
TEST(matches_count_with_their_bits)
{
    static const struct {
        cw_field first;
        cw_field second;
        unsigned every;
    } cases[] = {{CW_FIELD_CRC, CW_FIELD_EOF, 1000},
                 {CW_FIELD_R0, CW_FIELD_DATA, 40},
                 {CW_FIELD_CRC, CW_FIELD_NONE, 40},
                 {CW_FIELD_EOF, CW_FIELD_NONE, 1000},
                 {CW_FIELD_ID, CW_FIELD_NONE, 40},
                 {CW_FIELD_DATA, CW_FIELD_DATA, 1000},
                 {CW_FIELD_CRC_DELIMITER, CW_FIELD_INTERMISSION, 1000},
                 {CW_FIELD_EOF, CW_FIELD_INTERMISSION, 1000}};
    for (unsigned i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        RIG *fast = patient_rules(cases[i].first, cases[i].second, cases[i].every, false);
        RIG *reference = patient_rules(cases[i].first, cases[i].second, cases[i].every, true);
        unsigned full = 0;
        for (uint64_t bit = 0; bit < 60000; bit += 1 + bit % 900) {
            if (cw_bus_pending(fast->bus) == 0) {
                send_some(fast);
                send_some(reference);
            }
            bool stuck = cw_bus_advance(fast->bus, bit * BIT) == CW_FULL;
            rig_run(reference, cw_bus_now(fast->bus));
            assert_same_matches(fast, reference);
            full += stuck;
            if (stuck)
                rig_run_bits(fast, bit);
            rig_run_bits(reference, bit);
        }
        assert_int_not_equal(full, 0);
        rig_poll(fast);
        rig_assert_same_events(fast, reference);
    }
}

/* A frame that comes in the first bit of another one ends the frame step over it (M6). The frame
 * step goes on later, up to the bits of the rules that are bound by then. */
static rig *run_joined_frames(unsigned every, bool stepping)
{
    rig *r = rig_new(3);
    rig_flip(r, "crc", CW_FIELD_CRC, 3)->every = every;
    rig_flip(r, "end", CW_FIELD_EOF, 2)->skip = 1000;
    rig_start(r);
    cw_bus_set_stepping(r->bus, stepping);
    for (unsigned i = 0; i < 20; i++) {
        const uint64_t start = (JOIN + 400 * i) * BIT;
        const cw_frame frame = rig_frame(0x100 + i, 0, i % 9);
        const cw_frame later = rig_frame(0x200, 0, 0);
        rig_run(r, start);
        rig_send(r, 0, &frame, start);
        rig_run(r, start + BIT);
        rig_send(r, 1, &later, start + BIT);
        for (unsigned bits = 2; bits < 400; bits += 1 + i)
            rig_run(r, start + bits * BIT);
    }
    return r;
}

TEST(a_step_that_goes_on_stops_for_bound_rules)
{
    for (unsigned every = 1; every < 4; every++) {
        RIG *fast = run_joined_frames(every, false);
        RIG *reference = run_joined_frames(every, true);
        rig_assert_same_events(fast, reference);
        assert_same_matches(fast, reference);
        assert_int_not_equal(hits(fast, 0), 0);
    }
}

/* ---- All actions at once --------------------------------------------------------------------- */

/* Actions for parts of bits would let all nodes go by their own clocks: no fast path would be
 * taken. */
#define TIMED_ACTIONS 3u /* from CW_ACTION_PULSE on */
#define STORM_RULES (CW_ACTION_COUNT - TIMED_ACTIONS)
#define STORM_SETTINGS (UINT8_MAX & ~(CW_SET_QUEUE | CW_SET_TIMING))

static cw_action storm_action(unsigned rule)
{
    return (cw_action)(rule < CW_ACTION_PULSE ? rule : rule + TIMED_ACTIONS);
}

#define STORM_NODES 6u
#define STORM_BITS 6000u
#define STORM_SLICE 300u /* bits */
#define STORM_FRAMES 4u  /* handed in in a slice, at most */

static uint64_t some_nodes(rig_random *random)
{
    return 1 + rig_below(random, (1u << STORM_NODES) - 1);
}

static void random_moment(cw_rule *rule, unsigned i, rig_random *random)
{
    if (rule->trigger == CW_TRIGGER_TIME)
        rule->time_begin = rig_below(random, STORM_BITS * BIT / 2);
    if (rig_below(random, 3) == 0)
        rule->time_end = rule->time_begin + (1 + rig_below(random, STORM_BITS)) * (uint64_t)BIT;
    if (rig_below(random, 3) == 0)
        rule->from = some_nodes(random);
    if (rig_below(random, 3) == 0)
        rule->filters[rule->filter_count++] =
            (cw_filter){.value = rig_next(random), .mask = rig_below(random, 8)};
    if (i > 0 && (rule->trigger == CW_TRIGGER_ARMED || rig_below(random, 5) == 0)) {
        rule->has_after = true;
        rule->after = (uint16_t)rig_below(random, STORM_RULES);
        rule->after_delay = rig_below(random, 100 * BIT);
    }
    rule->every = 1 + rig_below(random, 3);
    rule->skip = rig_below(random, 2);
    rule->hold_off = rig_below(random, 2) * rig_below(random, 500 * BIT);
    rule->probability = rig_below(random, 2) ? UINT64_MAX : UINT64_MAX / 2;
    rule->error_mask = 0x1FF;
    if (rig_below(random, 6) == 0) {
        rule->state_nodes = NODE(rig_below(random, STORM_NODES));
        rule->state_mask = (uint8_t)(1 + rig_below(random, 7));
    }
}

static void random_change(cw_change *change, rig_random *random)
{
    change->set_id = rig_below(random, 2);
    change->id = rig_below(random, 0x800);
    change->set_dlc = rig_below(random, 2);
    change->dlc = (uint8_t)rig_below(random, 16);
    for (unsigned i = 0; i < 8; i++) {
        change->set_mask[i] = (uint8_t)rig_next(random);
        change->set[i] = (uint8_t)rig_next(random);
        change->and_mask[i] = (uint8_t)rig_next(random);
        change->or_mask[i] = (uint8_t)rig_next(random);
        change->xor_mask[i] = (uint8_t)rig_next(random);
    }
}

static void random_effect(cw_rule *rule, rig_random *random)
{
    rule->field = (cw_field)(1 + rig_below(random, CW_FIELD_COUNT - 1));
    rule->index = (uint16_t)rig_below(random, 8);
    rule->bits = (uint16_t)(1 + rig_below(random, 12));
    rule->for_ticks = (1 + rig_below(random, 120)) * (uint64_t)BIT + rig_below(random, BIT);
    rule->at = rig_below(random, 2) ? some_nodes(random) : 0;
    rule->nodes = some_nodes(random);
    rule->node = (uint8_t)rig_below(random, STORM_NODES);
    rule->level = rig_below(random, 2);
    rule->line = (cw_line)rig_below(random, 3);
    rule->side = (cw_side)rig_below(random, 2);
    rule->dominant_timeout = rig_below(random, 2) * 20u * BIT;
    rule->pattern_level = rig_next(random);
    rule->pattern_mask = rig_next(random);
    rule->error_rate = UINT64_MAX / 50;
    rule->tec = (uint16_t)rig_below(random, 264);
    rule->rec = (uint16_t)rig_below(random, 200);
    rule->number = 1 + rig_below(random, 2);
    rule->load_permille = (uint16_t)rig_below(random, 1000);
    rule->period_ticks = rig_below(random, 400 * BIT);
    for (unsigned i = 0; i < STORM_NODES; i++)
        rule->group[i] = (uint8_t)rig_below(random, 2);
    rule->settings = (cw_settings){.which = STORM_SETTINGS, .modes_mask = UINT8_MAX,
                                   .modes = (uint8_t)(rig_next(random) & rig_next(random) & 0x1F),
                                   .warning_limit = 96, .restart_ticks = 500 * BIT};
    random_change(&rule->change, random);
    rule->frame = rig_random_frame(random);
    if (rule->action == CW_ACTION_PARTITION || rule->action == CW_ACTION_STUCK)
        rule->count = 10;
    if (rule->action == CW_ACTION_SEND || rule->action == CW_ACTION_BABBLE)
        rule->for_ticks = 500 * BIT;
    if (rule->action == CW_ACTION_COUNTER || rule->action == CW_ACTION_CHECKSUM)
        rule->side = CW_SIDE_TX; /* they act where a frame is made */
}

static bool needs_frame(cw_action action)
{
    return action <= CW_ACTION_GLITCH || action == CW_ACTION_WRONG_CRC ||
           (action >= CW_ACTION_DROP && action <= CW_ACTION_CHECKSUM) || action == CW_ACTION_REPLY;
}

/* Each node has a frame with a counter and a checksum. */
#define PROTECTED_ID 0x123u

static void protect_frames(rig *r)
{
    static cw_protection protections[STORM_NODES];
    for (unsigned i = 0; i < STORM_NODES; i++)
        protections[i] = (cw_protection){
            .node = (uint8_t)i, .id = PROTECTED_ID,
            .counter = {.bit = 12, .bits = 4, .max = 14},
            .checksum = {.kind = CW_CHECKSUM_CRC8, .polynomial = 0x1D, .start = 0xFF}};
    r->config.protections = protections;
    r->config.protection_count = STORM_NODES;
}

/* Makes a rule of each action. */
static rig *storm(uint64_t seed, cw_rule *rules)
{
    static const char names[] = "abcdefghijklmnopqrstuvwxyz0123456789";
    static char name[ALL_RULES_MAX][2];
    rig_random random = {.state = seed * 0x9E3779B97F4A7C15u + 1};
    rig *r = rig_new(STORM_NODES);
    for (unsigned i = 0; i < STORM_RULES; i++) {
        name[i][0] = names[i];
        rules[i] = new_rule(name[i], CW_TRIGGER_FRAME, storm_action(i));
        if (!needs_frame(rules[i].action))
            rules[i].trigger = (cw_trigger)rig_below(&random, 4);
        random_moment(&rules[i], i, &random);
        random_effect(&rules[i], &random);
    }
    for (unsigned i = 0; i < STORM_NODES; i++)
        r->nodes[i].restart_ticks = 300 * BIT;
    r->config.seed = seed;
    r->config.rules = rules;
    r->config.rule_count = STORM_RULES;
    r->config.inbox = STORM_NODES * STORM_FRAMES;
    protect_frames(r);
    return r;
}

static void hand_in_slice(rig *r, uint64_t start, rig_random *random)
{
    for (unsigned i = 0; i < STORM_NODES; i++) {
        for (unsigned n = rig_below(random, STORM_FRAMES); n > 0; n--) {
            cw_frame frame = rig_random_frame(random);
            if (rig_below(random, 3) == 0)
                frame = (cw_frame){.id = PROTECTED_ID, .dlc = 8, .data = {0, 0, frame.data[2]}};
            rig_send(r, i, &frame, start + rig_below(random, STORM_SLICE * BIT));
        }
    }
}

typedef enum pace { WHOLE, BITS, PIECES } pace;

static void run_slice(rig *r, uint64_t end, pace how, rig_random *random)
{
    if (how == WHOLE)
        rig_run(r, end);
    while (cw_bus_now(r->bus) < end) {
        uint64_t step = how == BITS ? BIT : 1 + rig_below(random, 40 * BIT);
        uint64_t to = cw_bus_now(r->bus) + step;
        rig_run(r, to < end ? to : end);
        if (to >= end)
            return;
    }
}

static rig *run_storm(uint64_t seed, cw_rule *rules, pace how, uint16_t events)
{
    rig *r = storm(seed, rules);
    rig_random traffic = {.state = seed + 99};
    rig_random pieces = {.state = seed + 5};
    r->config.events = events;
    rig_start(r);
    for (uint64_t bit = 0; bit < STORM_BITS; bit += STORM_SLICE) {
        hand_in_slice(r, bit * BIT, &traffic);
        run_slice(r, (bit + STORM_SLICE) * BIT, how, &pieces);
    }
    assert_int_equal(rig_bus_stats(r).events_lost, 0);
    return r;
}

/* Bit by bit, in one go, in pieces, with the smallest ring of events: the same events. */
TEST(the_trace_does_not_depend_on_the_pace)
{
    static cw_rule rules[ALL_RULES_MAX];
    unsigned used[STORM_RULES] = {0};
    for (uint64_t seed = 1; seed <= 60; seed++) {
        RIG *whole = run_storm(seed, rules, WHOLE, UINT16_MAX);
        RIG *bits = run_storm(seed, rules, BITS, 1);
        RIG *pieces = run_storm(seed, rules, PIECES, 1);
        RIG *small = run_storm(seed, rules, WHOLE, 1);
        rig_assert_same_events(whole, bits);
        rig_assert_same_events(whole, pieces);
        rig_assert_same_events(whole, small);
        for (unsigned i = 0; i < STORM_RULES; i++)
            used[i] += hits(whole, i) > 0;
    }
    for (unsigned i = 0; i < STORM_RULES; i++)
        assert_in_range(used[i], 5, 60); /* each action did something in several storms */
}

/* Returns true for the order of time, then faults in the order of the rules, then nodes, then
 * kinds. */
static bool in_order(const cw_event *a, const cw_event *b)
{
    if (a->tick != b->tick)
        return a->tick < b->tick;
    if (a->kind == CW_EVENT_FAULT || b->kind == CW_EVENT_FAULT)
        return a->kind == CW_EVENT_FAULT && (b->kind != CW_EVENT_FAULT || a->rule <= b->rule);
    unsigned last = 63u - (unsigned)__builtin_clzll(a->nodes);
    unsigned first = (unsigned)__builtin_ctzll(b->nodes);
    return last < first || (last == first && a->kind <= b->kind);
}

TEST(events_are_in_order)
{
    static cw_rule rules[ALL_RULES_MAX];
    char one[RIG_LINE_MAX];
    char other[RIG_LINE_MAX];
    for (uint64_t seed = 1; seed <= 60; seed++) {
        RIG *r = run_storm(seed, rules, WHOLE, UINT16_MAX);
        for (size_t i = 1; i < r->count; i++) {
            if (in_order(&r->events[i - 1], &r->events[i]))
                continue;
            rig_line(one, &r->events[i - 1]);
            rig_line(other, &r->events[i]);
            fail_msg("seed %u: %s, then %s", (unsigned)seed, one, other);
        }
    }
}

/* Returns the first frame of a generator that begins in the frame behind a clean one. */
static uint64_t first_of_generator(bool stepping)
{
    rig *r = rig_new(2);
    *rig_flip(r, "load", CW_FIELD_NONE, 0) =
        (cw_rule){.name = "load", .time_end = CW_NEVER, .probability = UINT64_MAX,
                  .filter_count = 1, .filters = {{0x2C0, 0x7FF, false}},
                  .action = CW_ACTION_LOAD, .load_permille = 816};
    rig_start(r);
    cw_bus_set_stepping(r->bus, stepping);
    const cw_frame clean = rig_frame(0x280, 0, 0);
    const cw_frame trigger = rig_frame(0x2C0, 0, 0);
    rig_send(r, 0, &clean, 0);
    rig_send(r, 0, &trigger, 0);
    rig_run_bits(r, 300);
    uint64_t tick = 0;
    for (size_t i = 0; i < r->count && tick == 0; i++)
        if (r->events[i].kind == CW_EVENT_TX && r->events[i].frame.id != 0x280 &&
            r->events[i].frame.id != 0x2C0)
            tick = r->events[i].tick;
    rig_free(r);
    assert_int_not_equal(tick, 0);
    return tick;
}

TEST(a_load_counts_the_bits_of_clean_frames)
{
    assert_int_equal(first_of_generator(false), first_of_generator(true));
}
