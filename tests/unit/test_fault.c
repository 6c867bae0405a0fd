/* SPDX-License-Identifier: MIT
 *
 * test_fault.c - fault rules where a scenario cannot show them: random streams, rules that come and
 * go while the bus runs, many rules, odd moments, the same trace however time is advanced, no frame
 * lost, and a bus that takes over.
 *
 * What each action and each condition does is in tests/scenarios.
 */
#include "rig.h"

#include "bus_private.h"

#define ALL_RULES_MAX 64
#define RECOVERY_BITS (128u * 11u)

/* ---- Help ------------------------------------------------------------------------------------ */

/* A rule that acts on each match; harmless when nobody changes it. */
static cw_rule new_rule(const char *name, cw_trigger trigger, cw_action action)
{
    return (cw_rule){.name = name, .trigger = trigger, .action = action, .time_end = CW_NEVER,
                     .every = 1, .probability = UINT64_MAX, .bits = 1, .tec = CW_KEEP,
                     .rec = CW_KEEP, .number = 1, .frame = {.id = 0x7F0}};
}

/* Shows when it acts and does nothing else: the counters are what they are. */
static cw_rule probe(const char *name, cw_trigger trigger)
{
    cw_rule rule = new_rule(name, trigger, CW_ACTION_COUNTERS);
    rule.nodes = NODE(0);
    return rule;
}

static void exactly(cw_rule *rule, uint32_t id)
{
    rule->filters[0] = (cw_filter){.value = id, .mask = CW_FILTER_EXTENDED | 0x1FFFFFFFu};
    rule->filter_count = 1;
}

static cw_rule *rig_rule(rig *r, cw_rule rule)
{
    assert_in_range(r->config.rule_count, 0, RIG_RULES_MAX - 1);
    r->rules[r->config.rule_count] = rule;
    return &r->rules[r->config.rule_count++];
}

static unsigned add(rig *r, cw_rule rule)
{
    unsigned index = UINT32_MAX;
    assert_int_equal(cw_bus_add_rule(r->bus, &index, &rule), CW_OK);
    return index;
}

static cw_rule_stats rule_stats(const rig *r, unsigned rule)
{
    cw_rule_stats stats;
    assert_int_equal(cw_rule_get_stats(r->bus, rule, &stats), CW_OK);
    return stats;
}

static uint64_t hits(const rig *r, unsigned rule)
{
    return rule_stats(r, rule).hits;
}

/* Node 0 sends `count` frames, one every `every` bits from bit JOIN on. */
static void send_every(rig *r, const cw_frame *frame, unsigned every, unsigned count)
{
    for (unsigned i = 0; i < count; i++)
        rig_send(r, 0, frame, (JOIN + (uint64_t)every * i) * BIT);
}

/* ---- Random streams -------------------------------------------------------------------------- */

#define DRAWS 100u

/* A bit for each of DRAWS frames: whether the rule of that name took it. Rules with draws of their
 * own stand before and behind it. */
static void drawn_by(const char *name, uint64_t seed, unsigned before, unsigned behind, char *out)
{
    static const char *const others[] = {"p", "q", "r", "s"};
    rig *r = rig_new(2);
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
    rig_free(r);
}

static void other_rules_do_not_change_the_draws(void **state)
{
    (void)state;
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

static void seed_and_name_decide_the_draws(void **state)
{
    (void)state;
    char one[DRAWS + 1];
    char other[DRAWS + 1];
    drawn_by("x", 7, 0, 0, one);
    drawn_by("x", 8, 0, 0, other);
    assert_string_not_equal(one, other);
    drawn_by("y", 7, 0, 0, other);
    assert_string_not_equal(one, other);
}

/* ---- Rules that come and go ------------------------------------------------------------------ */

static void a_rule_added_at_run_time_acts_from_then_on(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    r->config.rule_room = 2;
    rig_start(r);
    send_every(r, &frame, 100, 4);
    rig_run_bits(r, 200);
    unsigned frames = add(r, probe("frames", CW_TRIGGER_FRAME));
    cw_rule late = probe("late", CW_TRIGGER_TIME);
    late.time_begin = 100 * BIT; /* that was before */
    unsigned at_once = add(r, late);
    unsigned index = 77;
    assert_int_equal(cw_bus_add_rule(r->bus, &index, &late), CW_FULL);
    assert_int_equal(index, 77);
    rig_run_bits(r, 500);
    assert_int_equal(hits(r, frames), 2);
    assert_int_equal(hits(r, at_once), 1);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 0)->tick, 200 * BIT);
    rig_free(r);
}

/* The index is used again; nothing of the old rule is left. */
static void a_cleared_rule_is_gone(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    r->config.rule_room = 2;
    rig_start(r);
    cw_rule stuck = new_rule("stuck", CW_TRIGGER_TIME, CW_ACTION_STUCK);
    stuck.level = CW_RECESSIVE;
    unsigned first = add(r, stuck);
    cw_rule follower = probe("follower", CW_TRIGGER_ARMED);
    follower.has_after = true;
    follower.after = (uint16_t)first;
    unsigned second = add(r, follower);
    rig_run_bits(r, 20);
    assert_true(rule_stats(r, first).active);
    assert_int_equal(hits(r, second), 1);
    assert_int_equal(cw_bus_clear_rule(r->bus, first), CW_OK);
    assert_int_equal(cw_bus_clear_rule(r->bus, first), CW_INVALID);
    assert_int_equal(cw_bus_stop_rule(r->bus, first), CW_INVALID);
    assert_int_equal(cw_bus_fire_rule(r->bus, first), CW_INVALID);
    cw_rule_stats stats;
    assert_int_equal(cw_rule_get_stats(r->bus, first, &stats), CW_INVALID);
    assert_int_equal(add(r, probe("new", CW_TRIGGER_FRAME)), first);
    assert_int_equal(hits(r, first), 0);
    rig_send(r, 0, &frame, 30 * BIT);
    rig_run_bits(r, 200);
    assert_int_equal(hits(r, first), 1);
    assert_int_equal(hits(r, second), 1); /* it came after a rule that is no more */
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 1);
    rig_free(r);
}

/* A rule of each kind that lasts is stopped: what it did is over, the rule stays. */
static void a_stopped_rule_can_act_again(void **state)
{
    (void)state;
    static const cw_action actions[] = {CW_ACTION_STUCK, CW_ACTION_NOISE, CW_ACTION_NO_ACK,
                                        CW_ACTION_DISCONNECT, CW_ACTION_PARTITION};
    const cw_frame frame = rig_frame(0x123, 0, 0);
    for (size_t i = 0; i < sizeof actions / sizeof actions[0]; i++) {
        rig *r = rig_new(2);
        cw_rule rule = new_rule("lasting", CW_TRIGGER_ARMED, actions[i]);
        rule.manual = true;
        rule.error_rate = UINT64_MAX;
        rule.nodes = NODE(1);
        rule.group[1] = 1;
        rig_rule(r, rule);
        rig_start(r);
        for (unsigned round = 0; round < 2; round++) {
            uint64_t start = cw_bus_now(r->bus);
            size_t sent = rig_count(r, CW_EVENT_TX, 0);
            assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_OK);
            rig_send(r, 0, &frame, start + 20 * BIT);
            rig_run(r, start + 200 * BIT);
            assert_true(rule_stats(r, 0).active);
            assert_int_equal(rig_count(r, CW_EVENT_TX, 0), sent);
            assert_int_equal(cw_bus_stop_rule(r->bus, 0), CW_OK);
            assert_false(rule_stats(r, 0).active);
            rig_run(r, start + 5000 * BIT);
            assert_int_equal(rig_count(r, CW_EVENT_TX, 0), sent + 1);
        }
        rig_free(r);
    }
}

/* A follower that stands before the rule comes after it no more, either. */
static void a_rule_before_the_cleared_one_is_left_alone(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    cw_rule *follower = rig_rule(r, probe("follower", CW_TRIGGER_ARMED));
    follower->has_after = true;
    follower->after = 1;
    rig_rule(r, probe("old", CW_TRIGGER_TIME));
    rig_start(r);
    rig_run_bits(r, 10);
    assert_int_equal(hits(r, 0), 1);
    assert_int_equal(cw_bus_clear_rule(r->bus, 1), CW_OK);
    assert_int_equal(add(r, probe("new", CW_TRIGGER_TIME)), 1);
    rig_run_bits(r, 20);
    assert_int_equal(hits(r, 1), 1);
    assert_int_equal(hits(r, 0), 1);
    rig_free(r);
}

/* What a cleared rule has put into a queue is sent, and is not taken for that of its successor. */
static void check_frames_of_a_cleared_rule(uint8_t node)
{
    rig *r = rig_new(2);
    cw_rule babble = new_rule("babble", CW_TRIGGER_TIME, CW_ACTION_BABBLE);
    babble.node = node;
    r->config.rule_room = 1;
    rig_start(r);
    assert_int_equal(add(r, babble), 0);
    rig_run_bits(r, 20);
    assert_int_equal(rig_stats(r, node).queue, 1);
    assert_int_equal(cw_bus_clear_rule(r->bus, 0), CW_OK);
    babble.name = "other";
    babble.frame.id = 0x7F1;
    assert_int_equal(add(r, babble), 0);
    rig_run_bits(r, 21);
    assert_int_equal(rig_stats(r, node).queue, 2); /* at once: it has none on the way yet */
    rig_run_bits(r, 500);
    assert_int_equal(rig_stats(r, node).queue, 1);
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->frame.id, 0x7F0);
    for (size_t i = 1; i < rig_count(r, CW_EVENT_TX, node); i++)
        assert_int_equal(rig_nth(r, CW_EVENT_TX, i)->frame.id, 0x7F1);
    rig_free(r);
}

static void frames_of_a_cleared_rule_are_sent(void **state)
{
    (void)state;
    check_frames_of_a_cleared_rule(0);
    check_frames_of_a_cleared_rule(1);
}

/* Frames that a rule holds back go on their way when it is cleared. */
static void held_frames_go_on_when_the_rule_is_cleared(void **state)
{
    (void)state;
    const cw_frame frame = rig_frame(0x123, 0, 0);
    for (unsigned side = CW_SIDE_TX; side <= CW_SIDE_RX; side++) {
        rig *r = rig_new(2);
        cw_rule rule = new_rule("late", CW_TRIGGER_FRAME, CW_ACTION_DELAY);
        rule.for_ticks = 100000 * BIT;
        rule.side = (cw_side)side;
        rig_rule(r, rule);
        rig_start(r);
        rig_send(r, 0, &frame, 0);
        rig_run_bits(r, 1000);
        assert_int_equal(rig_count(r, CW_EVENT_RX, -1), 0);
        assert_int_equal(cw_bus_pending(r->bus), 1);
        assert_int_equal(rig_bus_stats(r).pending, 1);
        assert_int_equal(cw_bus_clear_rule(r->bus, 0), CW_OK);
        rig_run_bits(r, 2000);
        assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 1);
        assert_int_equal(cw_bus_pending(r->bus), 0);
        if (side == CW_SIDE_RX)
            assert_int_equal(rig_nth(r, CW_EVENT_RX, 0)->tick, 1000 * BIT);
        assert_int_equal(rig_nth(r, CW_EVENT_RX, 0)->from, NODE(0));
        assert_int_equal(rig_nth(r, CW_EVENT_RX, 0)->handed_in,
                         rig_nth(r, CW_EVENT_TX, 0)->handed_in);
        rig_free(r);
    }
}

#define RULE(t, a, ...)                                                                            \
    {.name = "rule", .trigger = CW_TRIGGER_##t, .action = CW_ACTION_##a, __VA_ARGS__}
#define FLIP(...) RULE(FRAME, FLIP, .field = CW_FIELD_SOF, .bits = 1, __VA_ARGS__)
#define SET(...) RULE(TIME, SET, .nodes = NODE(1) | NODE(2), .settings = {__VA_ARGS__})

/* On a bus of three nodes with room for four rules. */
static void bad_rules_are_refused(void **state)
{
    (void)state;
    static const cw_rule bad[] = {
        /* no such kind, node or rule */
        {.trigger = CW_TRIGGER_TIME, .action = CW_ACTION_STUCK}, /* no name */
        {.name = "rule", .trigger = (cw_trigger)4, .action = CW_ACTION_STUCK},
        {.name = "action", .action = CW_ACTION_COUNT},
        RULE(TIME, STUCK, .line = (cw_line)(CW_LINE_RX + 1)),
        RULE(TIME, STUCK, .node = 3),
        RULE(FRAME, DROP, .side = (cw_side)(CW_SIDE_RX + 1)),
        FLIP(.from = NODE(3)),
        FLIP(.at = NODE(63)),
        RULE(TIME, BUS_OFF, .nodes = NODE(3) | NODE(1)),
        RULE(TIME, BUS_OFF, .state_nodes = NODE(5)),
        RULE(ARMED, BUS_OFF, .has_after = true, .after = 4),
        FLIP(.filter_count = CW_RULE_FILTERS_MAX + 1),
        FLIP(.data_length = 9),
        /* no moment */
        RULE(FRAME, FLIP, .bits = 1),
        RULE(FRAME, FLIP, .bits = 1, .field = CW_FIELD_COUNT),
        RULE(FRAME, FORCE, .bits = 0, .field = CW_FIELD_SOF),
        RULE(TIME, FLIP, .bits = 1, .field = CW_FIELD_SOF),
        RULE(FRAME, GLITCH, .bits = CW_PATTERN_MAX + 1, .field = CW_FIELD_SOF),
        RULE(TIME, WRONG_CRC, .nodes = NODE(0)),
        RULE(ERROR, DROP, .error_mask = 4),
        RULE(TIME, CHANGE, .side = CW_SIDE_RX),
        RULE(ARMED, REPLY, .manual = true),
        /* values */
        RULE(TIME, SEND, .frame = {.id = 0x800}),
        RULE(TIME, BABBLE, .frame = {.dlc = 16}),
        RULE(FRAME, REPLY, .frame = {.flags = CW_FRAME_FD}),
        RULE(TIME, COUNTERS, .tec = 264, .rec = CW_KEEP),
        RULE(TIME, COUNTERS, .tec = CW_KEEP, .rec = 256),
        RULE(TIME, OVERLOAD, .number = 0),
        RULE(TIME, OVERLOAD, .number = 3),
        RULE(FRAME, DUPLICATE, .number = CW_COPIES_MAX + 1),
        RULE(TIME, LOAD, .load_permille = 1001),
        SET(.which = CW_SET_QUEUE, .queue = 0),
        SET(.which = CW_SET_QUEUE, .queue = 17),
        SET(.which = CW_SET_WARNING, .warning_limit = 256),
    };
    rig *r = rig_new(3);
    r->config.rule_room = 4;
    rig_start(r);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        unsigned index = 77;
        if (cw_bus_add_rule(r->bus, &index, &bad[i]) != CW_INVALID)
            fail_msg("rule %zu was accepted", i);
        assert_int_equal(index, 77);
    }
    cw_rule good = new_rule("flip", CW_TRIGGER_FRAME, CW_ACTION_FLIP);
    good.field = CW_FIELD_SOF;
    good.from = good.at = good.nodes = good.state_nodes = NODE(2);
    good.node = 2;
    good.has_after = true;
    good.after = 3; /* one that may come later */
    assert_int_equal(add(r, good), 0);
    rig_free(r);

    r = rig_new(3);
    rig_rule(r, new_rule("bad", CW_TRIGGER_TIME, CW_ACTION_SEND))->frame.id = 0x800;
    void *memory = malloc(cw_bus_size(&r->config));
    assert_null(cw_bus_init(memory, &r->config));
    free(memory);
    rig_free(r);
}

/* Limits that are still good. */
static void rules_at_the_limits_are_good(void **state)
{
    (void)state;
    rig *r = rig_new(CW_NODES_MAX);
    static const cw_rule good[] = {
        RULE(TIME, COUNTERS, .tec = 263, .rec = 255, .nodes = UINT64_MAX),
        RULE(FRAME, GLITCH, .field = CW_FIELD_SOF, .bits = CW_PATTERN_MAX, .at = NODE(63),
             .filter_count = CW_RULE_FILTERS_MAX, .data_length = 8),
        RULE(FRAME, FORCE, .field = CW_FIELD_BIT, .for_ticks = 1),
        RULE(FRAME, FLIP, .field = CW_FIELD_BIT, .bits = UINT16_MAX),
        RULE(FRAME, DUPLICATE, .number = CW_COPIES_MAX),
        RULE(TIME, LOAD, .load_permille = 1000),
        RULE(TIME, OVERLOAD, .number = 2),
        SET(.which = CW_SET_QUEUE | CW_SET_WARNING, .queue = 16, .warning_limit = 255),
        RULE(ARMED, BUS_OFF, .has_after = true, .after = 8),
        RULE(TIME, SET, .nodes = NODE(5), .settings = {.which = CW_SET_QUEUE, .queue = 32}),
    };
    r->nodes[5].queue = 32;
    r->config.rule_room = sizeof good / sizeof good[0];
    rig_start(r);
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++)
        assert_int_equal(add(r, good[i]), i);
    rig_free(r);
}

/* ---- By hand --------------------------------------------------------------------------------- */

static void a_manual_rule_acts_when_fired(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    cw_rule rule = probe("by hand", CW_TRIGGER_ARMED);
    rule.manual = true;
    rule.count = 3;
    rig_rule(r, rule);
    rig_rule(r, probe("not manual", CW_TRIGGER_TIME));
    rig_start(r);
    assert_int_equal(cw_bus_fire_rule(r->bus, 1), CW_REFUSED);
    assert_int_equal(cw_bus_fire_rule(r->bus, 2), CW_INVALID);
    rig_run_bits(r, 50);
    assert_int_equal(hits(r, 0), 0);
    assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_OK);
    rig_run_bits(r, 100);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 1)->tick, 50 * BIT);
    assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_OK); /* twice: one of them a bit later */
    assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_OK);
    rig_run_bits(r, 200);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 2)->tick, 100 * BIT);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 3)->tick, 101 * BIT);
    assert_true(rule_stats(r, 0).over);
    assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_REFUSED);
    rig_free(r);
}

/* With a condition on frames each firing is good for one match. */
static void a_manual_rule_on_frames_takes_one_match(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    cw_rule rule = probe("by hand", CW_TRIGGER_FRAME);
    rule.manual = true;
    rig_rule(r, rule);
    rig_start(r);
    send_every(r, &frame, 100, 8);
    rig_run_bits(r, 200); /* two frames */
    assert_int_equal(rule_stats(r, 0).matches, 0);
    for (unsigned i = 0; i < 2; i++)
        assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_OK);
    rig_run_bits(r, 1000);
    assert_int_equal(hits(r, 0), 2);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 0)->tick, (JOIN + 200 + 1) * BIT);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 1)->tick, (JOIN + 300 + 1) * BIT);
    rig_free(r);
}

/* Armings take place at their times, whoever came first. */
static void armings_take_place_in_time_order(void **state)
{
    (void)state;
    static const unsigned expected[] = {30, 50, 110, 130};
    rig *r = rig_new(2);
    cw_rule *first = rig_rule(r, probe("first", CW_TRIGGER_ARMED));
    first->manual = true;
    cw_rule *both = rig_rule(r, probe("both", CW_TRIGGER_ARMED));
    both->manual = true;
    both->has_after = true;
    both->after = 0;
    both->after_delay = 100 * BIT;
    rig_start(r);
    for (unsigned bit = 10; bit <= 50; bit += 20) { /* armed at 110, 130; by hand at 30, 50 */
        rig_run_bits(r, bit);
        if (bit < 50)
            assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_OK);
        if (bit > 10)
            assert_int_equal(cw_bus_fire_rule(r->bus, 1), CW_OK);
    }
    rig_run_bits(r, 300);
    assert_int_equal(hits(r, 1), 4);
    unsigned n = 0;
    for (size_t i = 0; i < r->count; i++)
        if (r->events[i].kind == CW_EVENT_FAULT && r->events[i].rule == 1)
            assert_int_equal(r->events[i].tick, expected[n++] * (uint64_t)BIT);
    rig_free(r);
}

/* Armings under way are bounded; what does not fit is lost, and told to him who fires. */
static void armings_are_bounded(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    cw_rule rule = probe("by hand", CW_TRIGGER_ARMED);
    rule.manual = true;
    rig_rule(r, rule);
    rig_start(r);
    for (unsigned i = 0; i < CW_ARMINGS_MAX; i++)
        assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_OK);
    assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_REFUSED);
    rig_run_bits(r, 100);
    assert_int_equal(hits(r, 0), CW_ARMINGS_MAX);
    assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_OK);
    rig_free(r);
}

/* Rules that arm each other without delay go round once in a bit, and time goes on. */
static void a_ring_of_rules_goes_round_once_in_a_bit(void **state)
{
    (void)state;
    enum { LENGTH = 5 };
    static const char *const names[LENGTH] = {"a", "b", "c", "d", "e"};
    rig *r = rig_new(1);
    for (uint16_t i = 0; i < LENGTH; i++) {
        cw_rule rule = probe(names[i], CW_TRIGGER_ARMED);
        rule.has_after = true;
        rule.after = (uint16_t)((i + 1) % LENGTH);
        rule.manual = i == 2;
        rig_rule(r, rule);
    }
    rig_start(r);
    assert_int_equal(cw_bus_fire_rule(r->bus, 2), CW_OK);
    rig_run_bits(r, 100);
    for (unsigned i = 0; i < LENGTH; i++)
        assert_in_range(hits(r, i), 100, 101);
    rig_free(r);
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

static void many_exact_identifiers_meet_their_own_frames(void **state)
{
    (void)state;
    rig *r = rig_new(2);
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
    rig_free(r);
    free(rules);
}

/* Rules on one identifier, and others between them, act in their order. */
static void rules_on_one_frame_act_in_their_order(void **state)
{
    (void)state;
    rig *r = rig_new(2);
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
    rig_free(r);
}

static void a_change_reaches_all_bytes(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    cw_frame frame = rig_frame(0x123, 0, 8);
    cw_rule *rule = rig_rule(r, new_rule("change", CW_TRIGGER_FRAME, CW_ACTION_CHANGE));
    for (unsigned i = 0; i < 8; i++) {
        rule->change.set_mask[i] = 0xF0;
        rule->change.set[i] = 0xA5;
        rule->change.and_mask[i] = (uint8_t)~(1u << i);
        rule->change.or_mask[i] = 0x02;
        rule->change.xor_mask[i] = (uint8_t)i;
        unsigned byte = 0xA0 | (frame.data[i] & 0x0F);
        frame.data[i] = (uint8_t)(((byte & ~(1u << i)) | 0x02) ^ i);
    }
    const cw_frame sent = rig_frame(0x123, 0, 8);
    rig_start(r);
    rig_send(r, 0, &sent, 0);
    rig_run_bits(r, 200);
    assert_true(cw_frame_equal(&rig_nth(r, CW_EVENT_RX, 0)->frame, &frame));
    rig_free(r);
}

/* ---- Odd moments ----------------------------------------------------------------------------- */

/* A command at the very tick at which a frame ends: the frame counts, once. */
static void commands_at_the_end_of_a_frame(void **state)
{
    (void)state;
    static const cw_action actions[] = {CW_ACTION_SET, CW_ACTION_BUS_OFF, CW_ACTION_ERROR_FLAG,
                                        CW_ACTION_DISCONNECT};
    const cw_frame frame = rig_frame(0x123, 0, 4);
    rig *plain = rig_new(2);
    rig_start(plain);
    rig_send(plain, 0, &frame, 0);
    rig_run_bits(plain, 200);
    uint64_t end = rig_nth(plain, CW_EVENT_TX, 0)->tick;
    rig_free(plain);
    for (size_t i = 0; i < sizeof actions / sizeof actions[0]; i++) {
        rig *r = rig_new(2);
        cw_rule *rule = rig_rule(r, new_rule("command", CW_TRIGGER_TIME, actions[i]));
        rule->time_begin = end;
        rule->nodes = NODE(0);
        rule->settings = (cw_settings){.which = CW_SET_MODES, .modes_mask = CW_MODE_LISTEN_ONLY,
                                       .modes = CW_MODE_LISTEN_ONLY};
        rig_start(r);
        rig_send(r, 0, &frame, 0);
        rig_send(r, 0, &frame, 0);
        rig_run(r, end);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
        assert_int_equal(rig_stats(r, 0).tx_frames, 1);
        bool dropped = actions[i] == CW_ACTION_SET;
        assert_int_equal(rig_stats(r, 0).queue, dropped ? 0 : 1);
        assert_int_equal(rig_stats(r, 0).dropped[CW_DROP_LISTEN_ONLY], dropped ? 1 : 0);
        assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 0)->tick, end);
        rig_run_bits(r, 1000);
        rig_free(r);
    }
}

/* A node that is disconnected while bus-off is not back on the bus when its recovery is over. */
static void recovery_does_not_reconnect(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    cw_rule *off = rig_rule(r, new_rule("off", CW_TRIGGER_TIME, CW_ACTION_BUS_OFF));
    off->nodes = NODE(2);
    cw_rule *away = rig_rule(r, new_rule("away", CW_TRIGGER_TIME, CW_ACTION_DISCONNECT));
    away->nodes = NODE(2);
    away->for_ticks = 3000 * BIT;
    rig_start(r);
    rig_run_bits(r, 20);
    assert_int_equal(cw_node_restart(r->bus, 2), CW_OK);
    rig_run_bits(r, 30 + RECOVERY_BITS);
    assert_int_equal(rig_stats(r, 2).state, CW_STATE_ERROR_ACTIVE);
    rig_send(r, 2, &frame, 2000 * BIT);
    rig_send(r, 0, &frame, 2000 * BIT);
    rig_run_bits(r, 2999);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 1);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 2), 0);
    rig_run_bits(r, 3200);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 2), 1);
    rig_free(r);
}

/* Nor does another rule that ends bring a node back, or the transmitter of a stuck line. */
static void a_disconnected_node_stays_away(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    cw_rule *away = rig_rule(r, new_rule("away", CW_TRIGGER_TIME, CW_ACTION_DISCONNECT));
    away->nodes = NODE(2);
    cw_rule *stuck = rig_rule(r, new_rule("stuck", CW_TRIGGER_TIME, CW_ACTION_STUCK));
    stuck->line = CW_LINE_TX;
    stuck->node = 2;
    cw_rule *other = rig_rule(r, new_rule("other", CW_TRIGGER_TIME, CW_ACTION_DISCONNECT));
    other->nodes = NODE(1) | NODE(2);
    other->for_ticks = 50 * BIT;
    rig_start(r);
    rig_send(r, 0, &frame, 100 * BIT);
    rig_run_bits(r, 500);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 1);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 2), 0);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
    rig_free(r);
}

/* Neither do they when the node has been bus-off for no time, of which no state is told. */
static void counters_do_not_reconnect(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    rig_rule(r, new_rule("away", CW_TRIGGER_TIME, CW_ACTION_DISCONNECT))->nodes = NODE(1);
    cw_rule *off = rig_rule(r, new_rule("off", CW_TRIGGER_TIME, CW_ACTION_BUS_OFF));
    off->nodes = NODE(1);
    off->time_begin = 50 * BIT;
    cw_rule *counters = rig_rule(r, new_rule("counters", CW_TRIGGER_TIME, CW_ACTION_COUNTERS));
    counters->nodes = NODE(1);
    counters->time_begin = 50 * BIT;
    counters->tec = 0;
    rig_start(r);
    rig_send(r, 0, &frame, 100 * BIT);
    rig_run_bits(r, 500);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 0);
    assert_int_not_equal(rig_count(r, CW_EVENT_ERROR, 0), 0);
    rig_free(r);
}

/* A match that is passed over counts once, also when noise flips the very bit. */
static void noise_and_a_position_in_one_bit(void **state)
{
    (void)state;
    cw_rule_stats stats[2];
    for (unsigned stepping = 0; stepping < 2; stepping++) {
        rig *r = rig_new(2);
        const cw_frame frame = rig_frame(0x123, 0, 0);
        rig_flip(r, "flip", CW_FIELD_R0, 0)->skip = 1000;
        cw_rule *noise = rig_rule(r, new_rule("noise", CW_TRIGGER_TIME, CW_ACTION_NOISE));
        noise->error_rate = UINT64_MAX / 80;
        noise->at = NODE(1);
        rig_start(r);
        cw_bus_set_stepping(r->bus, stepping == 1);
        for (unsigned i = 0; i < 200; i++)
            rig_send(r, 0, &frame, i * 100 * BIT);
        rig_run_bits(r, 200 * 100);
        assert_int_equal(cw_rule_get_stats(r->bus, 0, &stats[stepping]), CW_OK);
        rig_free(r);
    }
    assert_in_range(stats[1].matches, 50, 300);
    assert_int_equal(stats[0].matches, stats[1].matches);
}

/* Two rules on each frame, or the first one alone; the last one has hits, one in so many frames. */
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

/* Some of them are dropped, amid the frames that went first. */
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

/* Whoever looks finds the matches of the bits that have passed, be it amid a frame or because the
 * ring of events is full, whatever the rules let pass. */
static void matches_count_with_their_bits(void **state)
{
    (void)state;
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
        rig *fast = patient_rules(cases[i].first, cases[i].second, cases[i].every, false);
        rig *reference = patient_rules(cases[i].first, cases[i].second, cases[i].every, true);
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
        rig_free(fast);
        rig_free(reference);
    }
}

/* A frame that comes in the first bit of another one ends the leap over it (M6), which goes on
 * later: up to the bits of the rules that are bound by then. */
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

static void a_leap_that_goes_on_stops_for_bound_rules(void **state)
{
    (void)state;
    for (unsigned every = 1; every < 4; every++) {
        rig *fast = run_joined_frames(every, false);
        rig *reference = run_joined_frames(every, true);
        rig_assert_same_events(fast, reference);
        assert_same_matches(fast, reference);
        assert_int_not_equal(hits(fast, 0), 0);
        rig_free(fast);
        rig_free(reference);
    }
}

/* An error in the intermission, when the queue holds another frame in the same place already. */
static void a_rule_knows_its_frame_to_the_end(void **state)
{
    (void)state;
    for (unsigned stepping = 0; stepping < 2; stepping++) {
        rig *r = rig_new(2);
        const cw_frame frame = rig_frame(0x123, 0, 0);
        const cw_frame other = rig_frame(0x456, 0, 0);
        cw_rule *flip = rig_flip(r, "flip", CW_FIELD_ERROR_FLAG, 2);
        exactly(flip, 0x123);
        cw_rule *error = rig_rule(r, new_rule("error", CW_TRIGGER_ARMED, CW_ACTION_ERROR_FLAG));
        error->nodes = NODE(1);
        error->manual = true;
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
        rig_free(r);
    }
}

/* O1 a: an error after two overload frames gives no right to a third one, in whatever way the nodes
 * are simulated. */
static void two_overload_frames_are_all_before_the_next_frame(void **state)
{
    (void)state;
    for (unsigned stepping = 0; stepping < 2; stepping++) {
        rig *r = rig_new(4);
        const cw_frame frame = rig_frame(0x123, 0, 0);
        cw_rule *ask = rig_rule(r, new_rule("ask", CW_TRIGGER_FRAME, CW_ACTION_OVERLOAD));
        ask->nodes = NODE(1);
        ask->number = 2;
        cw_rule *error = rig_rule(r, new_rule("error", CW_TRIGGER_ARMED, CW_ACTION_ERROR_FLAG));
        error->nodes = NODE(2);
        error->manual = true;
        cw_rule *again = rig_rule(r, new_rule("again", CW_TRIGGER_ARMED, CW_ACTION_OVERLOAD));
        again->nodes = NODE(1);
        again->number = 1;
        again->manual = true;
        rig_start(r);
        cw_bus_set_stepping(r->bus, stepping == 1);
        rig_send(r, 0, &frame, 0);
        while (rig_count(r, CW_EVENT_OVERLOAD, 1) < 2)
            rig_run(r, cw_bus_now(r->bus) + BIT);
        rig_run(r, cw_bus_now(r->bus) + 15 * BIT); /* the intermission begins */
        assert_int_equal(cw_bus_fire_rule(r->bus, 1), CW_OK);
        assert_int_equal(cw_bus_fire_rule(r->bus, 2), CW_OK);
        rig_run_bits(r, 300);
        assert_int_equal(rig_count(r, CW_EVENT_OVERLOAD, 1), 3); /* and an answer, O1 b */
        rig_free(r);
    }
}

/* A state that changes with a clean frame is no reason to look at its bits again. */
static void a_state_changes_while_a_node_is_away(void **state)
{
    (void)state;
    cw_bus_stats stats[2];
    for (unsigned stepping = 0; stepping < 2; stepping++) {
        rig *r = rig_new(3);
        const cw_frame frame = rig_frame(0x123, 0, 0);
        cw_rule *away = rig_rule(r, new_rule("away", CW_TRIGGER_TIME, CW_ACTION_DISCONNECT));
        away->nodes = NODE(2);
        cw_rule *tec = rig_rule(r, new_rule("tec", CW_TRIGGER_TIME, CW_ACTION_COUNTERS));
        tec->nodes = NODE(0);
        tec->tec = 96;
        cw_rule *rec = rig_rule(r, new_rule("rec", CW_TRIGGER_TIME, CW_ACTION_COUNTERS));
        rec->nodes = NODE(1);
        rec->rec = 96;
        rig_start(r);
        cw_bus_set_stepping(r->bus, stepping == 1);
        rig_send(r, 0, &frame, 0);
        rig_send(r, 0, &frame, 0);
        rig_run_bits(r, 500);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 2);
        assert_int_equal(rig_count(r, CW_EVENT_STATE, -1), 4);
        stats[stepping] = rig_bus_stats(r);
        rig_free(r);
    }
    assert_int_equal(stats[0].busy_bits, stats[1].busy_bits);
}

/* On a partitioned bus a frame is from those on the receiver's own wire. */
static void the_sender_is_on_the_same_wire(void **state)
{
    (void)state;
    rig *r = rig_new(4);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    cw_rule *cut = rig_rule(r, new_rule("cut", CW_TRIGGER_TIME, CW_ACTION_PARTITION));
    cut->group[2] = cut->group[3] = 1;
    cw_rule *drop = rig_rule(r, new_rule("drop", CW_TRIGGER_FRAME, CW_ACTION_DROP));
    drop->side = CW_SIDE_RX;
    drop->from = NODE(0);
    rig_start(r);
    rig_send(r, 0, &frame, 0);
    rig_send(r, 2, &frame, 0);
    rig_run_bits(r, 200);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 2);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 0);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 3), 1);
    rig_free(r);
}

/* The transmitter has an error in the bit in which the others take its frame. */
static void the_sender_may_have_an_error_in_the_last_bit(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    cw_rule *flip = rig_flip(r, "flip", CW_FIELD_EOF, 5);
    flip->at = NODE(0);
    flip->count = 1;
    cw_rule *drop = rig_rule(r, new_rule("drop", CW_TRIGGER_FRAME, CW_ACTION_DROP));
    drop->side = CW_SIDE_RX;
    drop->from = NODE(0);
    rig_start(r);
    rig_send(r, 0, &frame, 0);
    rig_run_bits(r, 300);
    assert_int_equal(rig_count(r, CW_EVENT_RX, -1), 0);
    assert_int_equal(hits(r, 1), 2); /* one a frame, whoever receives it */
    rig_free(r);
}

/* A rule is bound to one transmission: not to the next one, even right behind it. */
static void a_rule_is_bound_to_its_own_frame(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    cw_rule *mark = rig_rule(r, new_rule("mark", CW_TRIGGER_FRAME, CW_ACTION_FORCE));
    mark->level = CW_RECESSIVE;
    mark->field = CW_FIELD_EOF;
    exactly(mark, 0x101);
    rig_start(r);
    for (unsigned i = 0; i < 4; i++) {
        const cw_frame frame = rig_frame(0x100 + i, 0, 0);
        rig_send(r, 0, &frame, 0);
    }
    rig_run_bits(r, 400);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 4);
    assert_int_equal(hits(r, 0), 1);
    rig_free(r);
}

/* Nor to any when it has been stopped. */
static void a_stopped_rule_lets_go_of_the_frame(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    (void)rig_flip(r, "end", CW_FIELD_EOF, 6);
    rig_start(r);
    rig_send(r, 0, &frame, 0);
    rig_run_bits(r, JOIN + 20);
    assert_int_equal(cw_bus_stop_rule(r->bus, 0), CW_OK);
    rig_run_bits(r, 100);
    assert_int_equal(hits(r, 0), 0);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
    rig_free(r);
}

/* A pattern starts over with each hit. */
static void each_hit_of_a_glitch_starts_its_pattern(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    r->nodes[2].modes = CW_MODE_LISTEN_ONLY;
    cw_rule *rule = rig_rule(r, new_rule("glitch", CW_TRIGGER_FRAME, CW_ACTION_GLITCH));
    rule->field = CW_FIELD_EOF;
    rule->bits = 3;
    rule->pattern_mask = 7;
    rule->pattern_level = 5; /* only the middle bit is `d` */
    rule->at = NODE(2);
    rig_start(r);
    send_every(r, &frame, 100, 3);
    rig_run_bits(r, 400);
    assert_int_equal(hits(r, 0), 3);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, 2), 3);
    for (unsigned i = 0; i < 3; i++)
        assert_int_equal(rig_nth(r, CW_EVENT_ERROR, i)->error.place.index, 1);
    rig_free(r);
}

/* On a partitioned bus a bit is one of its transmitter's wire. */
static void bits_are_on_the_wire_of_their_frame(void **state)
{
    (void)state;
    const cw_frame frame = rig_frame(0x123, 0, 0);
    for (unsigned sender = 0; sender < 4; sender += 2) {
        rig *r = rig_new(4);
        cw_rule *cut = rig_rule(r, new_rule("cut", CW_TRIGGER_TIME, CW_ACTION_PARTITION));
        cut->group[2] = cut->group[3] = 1;
        cw_rule *flip = rig_flip(r, "flip", CW_FIELD_EOF, 2);
        flip->count = 1;
        rig_start(r);
        rig_send(r, sender, &frame, 0);
        rig_run_bits(r, 300);
        for (unsigned node = 0; node < 4; node++)
            assert_int_equal(rig_count(r, CW_EVENT_ERROR, (int)node), node / 2 == sender / 2);
        rig_free(r);
    }
}

/* Bits go on when the frame, and so what the rule is bound to, is long over. A time that is no
 * whole number of bits is rounded up. */
static void bits_last_as_long_as_they_are_told_to(void **state)
{
    (void)state;
    static const struct {
        uint16_t bits;
        uint64_t ticks;
        unsigned expected;
    } cases[] = {{1, 0, 1},       {3, 0, 3},           {300, 0, 300},    {0, 1, 1},
                 {0, BIT, 1},     {0, BIT + 1, 2},     {0, 2 * BIT, 2},  {0, 200 * BIT, 200}};
    const cw_frame frame = rig_frame(0x123, 0, 0);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        rig *r = rig_new(3);
        r->nodes[2].modes = CW_MODE_LISTEN_ONLY; /* whom it does not disturb */
        cw_rule *rule = rig_rule(r, new_rule("force", CW_TRIGGER_FRAME, CW_ACTION_FORCE));
        rule->level = CW_RECESSIVE;
        rule->field = CW_FIELD_EOF;
        rule->index = 6;
        rule->bits = cases[i].bits;
        rule->for_ticks = cases[i].ticks;
        rule->at = NODE(2);
        rig_start(r);
        rig_send(r, 0, &frame, 0);
        unsigned acting = 0;
        for (unsigned bit = 1; bit < 500; bit++) {
            rig_run_bits(r, bit);
            acting += rule_stats(r, 0).active;
        }
        assert_int_equal(acting + 1, cases[i].expected); /* in the last one it is over at its end */
        assert_int_equal(cw_bus_next(r->bus), CW_NEVER); /* nothing to look at any more */
        rig_free(r);
    }
}

/* What begins with a frame and lasts for a time ends when it is over, with no other rule about. */
static void what_begins_with_a_frame_ends_in_time(void **state)
{
    (void)state;
    static const cw_action actions[] = {CW_ACTION_STUCK, CW_ACTION_NOISE, CW_ACTION_NO_ACK,
                                        CW_ACTION_DISCONNECT, CW_ACTION_PARTITION, CW_ACTION_BABBLE,
                                        CW_ACTION_LOAD};
    const cw_frame frame = rig_frame(0x123, 0, 0);
    for (size_t i = 0; i < sizeof actions / sizeof actions[0]; i++) {
        rig *r = rig_new(3);
        r->nodes[2].modes = CW_MODE_LISTEN_ONLY;
        cw_rule *rule = rig_rule(r, new_rule("lasting", CW_TRIGGER_FRAME, actions[i]));
        exactly(rule, 0x123);
        rule->count = 1;
        rule->for_ticks = 150 * BIT + 1;
        rule->line = CW_LINE_RX;
        rule->at = rule->nodes = NODE(2);
        rule->node = 2;
        rule->group[2] = 1;
        rig_start(r);
        rig_send(r, 0, &frame, 0);
        rig_run_bits(r, JOIN + 151 - 1);
        assert_true(rule_stats(r, 0).active);
        rig_run_bits(r, JOIN + 151);
        assert_false(rule_stats(r, 0).active);
        rig_run_bits(r, 2000);
        assert_int_equal(cw_bus_next(r->bus), CW_NEVER);
        rig_free(r);
    }
}

/* A rule on errors needs no other rule about. */
static void a_rule_on_errors_alone(void **state)
{
    (void)state;
    rig *r = rig_new(1);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    cw_rule *rule = rig_rule(r, new_rule("once", CW_TRIGGER_ERROR, CW_ACTION_SET));
    rule->error_mask = 0x20; /* no ACK */
    rule->nodes = NODE(0);
    rule->settings = (cw_settings){.which = CW_SET_MODES, .modes_mask = CW_MODE_PRESUME_ACK,
                                   .modes = CW_MODE_PRESUME_ACK};
    rig_start(r);
    rig_send(r, 0, &frame, 0);
    rig_run_bits(r, 500);
    assert_int_equal(hits(r, 0), 1);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
    rig_free(r);
}

/* A follower of noise comes its delay after the end of the inverted bit. */
static void noise_is_followed_from_the_end_of_its_bit(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    r->nodes[1].modes = CW_MODE_LISTEN_ONLY;
    cw_rule *noise = rig_rule(r, new_rule("noise", CW_TRIGGER_TIME, CW_ACTION_NOISE));
    noise->time_begin = 100 * BIT;
    noise->error_rate = UINT64_MAX;
    noise->at = NODE(1);
    noise->count = 1;
    cw_rule *after = rig_rule(r, probe("after", CW_TRIGGER_ARMED));
    after->has_after = true;
    after->after_delay = 10 * BIT;
    rig_start(r);
    rig_run_bits(r, 200);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 0)->tick, 101 * BIT);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 1)->tick, 111 * BIT);
    rig_free(r);
}

/* The flag of the node that asks is over a bit before the others': the delimiter begins with the
 * first recessive bit. */
static void the_overload_delimiter_begins_when_the_wire_is_free(void **state)
{
    (void)state;
    const cw_frame frame = rig_frame(0x123, 0, 0);
    rig *r = rig_new(2);
    cw_rule *ask = rig_rule(r, new_rule("ask", CW_TRIGGER_TIME, CW_ACTION_OVERLOAD));
    ask->nodes = NODE(0);
    cw_rule *mark = rig_rule(r, new_rule("mark", CW_TRIGGER_FRAME, CW_ACTION_FORCE));
    mark->level = CW_RECESSIVE;
    mark->field = CW_FIELD_OVERLOAD_DELIMITER;
    rig_start(r);
    rig_send(r, 0, &frame, 0);
    rig_run_bits(r, 300);
    uint64_t end = rig_nth(r, CW_EVENT_TX, 0)->tick;
    assert_int_equal(hits(r, 1), 1);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 1)->tick, end + (6 + 1 + 1) * BIT);
    rig_free(r);
}

/* What a single node sees is not on the wire. */
static void a_stuck_rx_is_not_on_the_wire(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    r->nodes[1].modes = CW_MODE_LISTEN_ONLY; /* it signals to itself only */
    cw_rule *stuck = rig_rule(r, new_rule("stuck", CW_TRIGGER_TIME, CW_ACTION_STUCK));
    stuck->line = CW_LINE_RX;
    stuck->node = 1;
    stuck->time_begin = 50 * BIT;
    rig_start(r);
    rig_run_bits(r, 200);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, 1), 1);
    assert_int_equal(cw_bus_recessive_bits(r->bus), 200);
    rig_free(r);
}

/* Noise counts its flips; it ends with its count, and takes frames as other rules do. */
static void noise_with_count_and_skip(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    r->nodes[2].modes = CW_MODE_LISTEN_ONLY; /* whom it does not disturb */
    cw_rule *noise = rig_rule(r, new_rule("noise", CW_TRIGGER_FRAME, CW_ACTION_NOISE));
    noise->error_rate = UINT64_MAX;
    noise->at = NODE(2);
    noise->skip = 1;
    noise->every = 2;
    noise->count = 60;
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
    rig_free(r);
}

/* ---- Settings -------------------------------------------------------------------------------- */

static void settings_are_changed_and_read(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    cw_settings s;
    const cw_settings all = {.which = UINT8_MAX, .modes_mask = CW_MODE_ONE_SHOT,
                             .modes = CW_MODE_ONE_SHOT | CW_MODE_LISTEN_ONLY,
                             .order = CW_ORDER_FIFO, .queue = 3, .warning_limit = 50,
                             .restart_ticks = 1000};
    r->nodes[1].modes = CW_MODE_PRESUME_ACK;
    rig_start(r);
    assert_int_equal(cw_node_set(r->bus, 1, &all), CW_OK);
    assert_int_equal(cw_node_get_settings(r->bus, 1, &s), CW_OK);
    assert_int_equal(s.modes, CW_MODE_ONE_SHOT | CW_MODE_PRESUME_ACK); /* masked */
    assert_int_equal(s.order, CW_ORDER_FIFO);
    assert_int_equal(s.queue, 3);
    assert_int_equal(s.warning_limit, 50);
    assert_int_equal(s.restart_ticks, 1000);
    const cw_settings none = {.which = 0, .queue = 0, .warning_limit = 0};
    assert_int_equal(cw_node_set(r->bus, 1, &none), CW_OK);
    const cw_settings bad[] = {{.which = CW_SET_QUEUE, .queue = 0},
                               {.which = CW_SET_QUEUE, .queue = 17},
                               {.which = CW_SET_WARNING, .warning_limit = 0},
                               {.which = CW_SET_WARNING, .warning_limit = 256},
                               {.which = CW_SET_ORDER | CW_SET_QUEUE, .queue = 17}};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        assert_int_equal(cw_node_set(r->bus, 1, &bad[i]), CW_INVALID);
    assert_int_equal(cw_node_set(r->bus, 2, &none), CW_INVALID);
    assert_int_equal(cw_node_get_settings(r->bus, 2, &s), CW_INVALID);
    assert_int_equal(cw_node_get_settings(r->bus, 1, &s), CW_OK);
    assert_int_equal(s.queue, 3);
    assert_int_equal(s.order, CW_ORDER_FIFO);
    rig_free(r);
}

/* Frames beyond a smaller limit stay; a rule from the start may enlarge the queue. */
static void a_queue_limit_is_for_new_frames(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    r->nodes[0].queue = 2;
    cw_rule *larger = rig_rule(r, new_rule("larger", CW_TRIGGER_TIME, CW_ACTION_SET));
    larger->nodes = NODE(0);
    larger->settings = (cw_settings){.which = CW_SET_QUEUE, .queue = 5};
    larger->time_begin = 5 * BIT;
    rig_start(r);
    for (unsigned i = 0; i < 3; i++)
        rig_send(r, 0, &frame, 0);
    rig_run_bits(r, 4);
    assert_int_equal(rig_stats(r, 0).queue, 2);
    for (unsigned i = 0; i < 5; i++)
        rig_send(r, 0, &frame, 6 * BIT);
    rig_run_bits(r, 10);
    assert_int_equal(rig_stats(r, 0).queue, 5);
    assert_int_equal(rig_stats(r, 0).dropped[CW_DROP_QUEUE_FULL], 1 + 2);
    const cw_settings one = {.which = CW_SET_QUEUE, .queue = 1};
    assert_int_equal(cw_node_set(r->bus, 0, &one), CW_OK);
    rig_send(r, 0, &frame, 10 * BIT);
    rig_run_bits(r, 1000);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 5);
    assert_int_equal(rig_stats(r, 0).dropped[CW_DROP_QUEUE_FULL], 1 + 2 + 1);
    rig_free(r);
}

/* ---- All actions at once --------------------------------------------------------------------- */

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
        rule->after = (uint16_t)rig_below(random, CW_ACTION_COUNT);
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
    rule->settings = (cw_settings){.which = UINT8_MAX & ~CW_SET_QUEUE, .modes_mask = UINT8_MAX,
                                   .modes = (uint8_t)(rig_next(random) & rig_next(random) & 0x1F),
                                   .warning_limit = 96, .restart_ticks = 500 * BIT};
    random_change(&rule->change, random);
    rule->frame = rig_random_frame(random);
    if (rule->action == CW_ACTION_PARTITION || rule->action == CW_ACTION_STUCK)
        rule->count = 10;
    if (rule->action == CW_ACTION_SEND || rule->action == CW_ACTION_BABBLE)
        rule->for_ticks = 500 * BIT;
}

static bool needs_frame(cw_action action)
{
    return action <= CW_ACTION_GLITCH || action == CW_ACTION_WRONG_CRC ||
           (action >= CW_ACTION_DROP && action <= CW_ACTION_CHANGE) || action == CW_ACTION_REPLY;
}

/* A rule of each action. */
static rig *storm(uint64_t seed, cw_rule *rules)
{
    static const char names[] = "abcdefghijklmnopqrstuvwxyz0123456789";
    static char name[ALL_RULES_MAX][2];
    rig_random random = {.state = seed * 0x9E3779B97F4A7C15u + 1};
    rig *r = rig_new(STORM_NODES);
    for (unsigned i = 0; i < CW_ACTION_COUNT; i++) {
        name[i][0] = names[i];
        rules[i] = new_rule(name[i], CW_TRIGGER_FRAME, (cw_action)i);
        if (!needs_frame(rules[i].action))
            rules[i].trigger = (cw_trigger)rig_below(&random, 4);
        random_moment(&rules[i], i, &random);
        random_effect(&rules[i], &random);
    }
    for (unsigned i = 0; i < STORM_NODES; i++)
        r->nodes[i].restart_ticks = 300 * BIT;
    r->config.seed = seed;
    r->config.rules = rules;
    r->config.rule_count = CW_ACTION_COUNT;
    r->config.inbox = STORM_NODES * STORM_FRAMES;
    return r;
}

static void hand_in_slice(rig *r, uint64_t start, rig_random *random)
{
    for (unsigned i = 0; i < STORM_NODES; i++) {
        for (unsigned n = rig_below(random, STORM_FRAMES); n > 0; n--) {
            const cw_frame frame = rig_random_frame(random);
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
static void the_trace_does_not_depend_on_the_pace(void **state)
{
    (void)state;
    static cw_rule rules[ALL_RULES_MAX];
    unsigned used[CW_ACTION_COUNT] = {0};
    for (uint64_t seed = 1; seed <= 60; seed++) {
        rig *whole = run_storm(seed, rules, WHOLE, UINT16_MAX);
        rig *bits = run_storm(seed, rules, BITS, 1);
        rig *pieces = run_storm(seed, rules, PIECES, 1);
        rig *small = run_storm(seed, rules, WHOLE, 1);
        rig_assert_same_events(whole, bits);
        rig_assert_same_events(whole, pieces);
        rig_assert_same_events(whole, small);
        for (unsigned i = 0; i < CW_ACTION_COUNT; i++)
            used[i] += hits(whole, i) > 0;
        rig_free(whole);
        rig_free(bits);
        rig_free(pieces);
        rig_free(small);
    }
    for (unsigned i = 0; i < CW_ACTION_COUNT; i++)
        assert_in_range(used[i], 5, 60); /* each action did something in several storms */
}

/* In this order: time, then faults in the order of the rules, then nodes, then kinds. */
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

static void events_are_in_order(void **state)
{
    (void)state;
    static cw_rule rules[ALL_RULES_MAX];
    char one[RIG_LINE_MAX];
    char other[RIG_LINE_MAX];
    for (uint64_t seed = 1; seed <= 60; seed++) {
        rig *r = run_storm(seed, rules, WHOLE, UINT16_MAX);
        for (size_t i = 1; i < r->count; i++) {
            if (in_order(&r->events[i - 1], &r->events[i]))
                continue;
            rig_line(one, &r->events[i - 1]);
            rig_line(other, &r->events[i]);
            fail_msg("seed %u: %s, then %s", (unsigned)seed, one, other);
        }
        rig_free(r);
    }
}

/* ---- No frame is lost ------------------------------------------------------------------------ */

static uint64_t held_at(const rig *r, unsigned node, cw_side side)
{
    uint64_t n = 0;
    for (unsigned i = 0; i < r->bus->held_count; i++)
        n += r->bus->held[i].node == node && r->bus->held[i].side == side;
    return n;
}

static uint64_t all_dropped(const uint64_t dropped[CW_DROP_COUNT])
{
    uint64_t n = 0;
    for (unsigned why = 0; why < CW_DROP_COUNT; why++)
        n += dropped[why];
    return n;
}

static void check_sender(const rig *r, uint64_t copies)
{
    const cw_node_stats s = rig_stats(r, 0);
    assert_int_equal(s.made_by_rules, copies);
    assert_int_equal(s.held, held_at(r, 0, CW_SIDE_TX));
    assert_int_equal(s.handed_in + copies, s.tx_frames + s.queue + all_dropped(s.dropped) + s.held);
    assert_true(cw_node_stats_balance(&s));
}

/* What node 0 has sent, and what its receiver, node 1, has got of it. */
static void check_receiver(const rig *r, uint64_t copies)
{
    const cw_node_stats s = rig_stats(r, 1);
    assert_true(cw_node_stats_balance(&s));
    assert_int_equal(all_dropped(s.dropped), 0);
    if (!cw_bus_idle(r->bus))
        return; /* a frame may be between the two */
    assert_int_equal(rig_stats(r, 0).tx_frames, s.rx_accepted);
    assert_int_equal(s.rx_made_by_rules, copies);
    assert_int_equal(s.rx_held, held_at(r, 1, CW_SIDE_RX));
    assert_int_equal(s.rx_accepted + copies, s.rx_frames + all_dropped(s.rx_dropped) + s.rx_held);
}

static void host_rules(rig *r, cw_side side)
{
    static const char *const names[] = {"drop", "delay", "duplicate", "reorder", "change"};
    for (unsigned i = 0; i < 5; i++) {
        cw_rule *rule = rig_rule(r, new_rule(names[i], CW_TRIGGER_FRAME,
                                             (cw_action)(CW_ACTION_DROP + i)));
        rule->side = side;
        rule->probability = UINT64_MAX / 3;
        rule->for_ticks = 333 * BIT;
        rule->number = 2;
        memset(rule->change.and_mask, 0x0F, sizeof rule->change.and_mask);
        rule->at = side == CW_SIDE_RX ? NODE(1) : 0;
    }
}

static void no_frame_is_lost_at_the_host_side(void **state)
{
    (void)state;
    for (unsigned side = CW_SIDE_TX; side <= CW_SIDE_RX; side++) {
        rig *r = rig_new(2);
        rig_random random = {.state = 42};
        r->nodes[0].queue = 4;
        host_rules(r, (cw_side)side);
        rig_start(r);
        for (unsigned i = 0; i < 300; i++) {
            const cw_frame frame = rig_random_frame(&random);
            rig_send(r, 0, &frame, cw_bus_now(r->bus) + rig_below(&random, 50 * BIT));
            rig_run(r, cw_bus_now(r->bus) + (50 + rig_below(&random, 150)) * BIT);
            uint64_t copies = 2 * hits(r, 2);
            check_sender(r, side == CW_SIDE_TX ? copies : 0);
            check_receiver(r, side == CW_SIDE_RX ? copies : 0);
        }
        for (unsigned rule = 0; rule < 5; rule++) {
            assert_in_range(hits(r, rule), 20, 400);
            assert_int_equal(cw_bus_clear_rule(r->bus, rule), CW_OK);
        }
        rig_run(r, cw_bus_now(r->bus) + 2000 * BIT);
        assert_int_equal(cw_bus_pending(r->bus), 0);
        rig_free(r);
    }
}

/* There is room for CW_HELD_FRAMES; a further frame is not held back. */
static void frames_held_back_are_bounded(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    r->nodes[0].queue = 1000;
    cw_rule *rule = rig_rule(r, new_rule("late", CW_TRIGGER_FRAME, CW_ACTION_DELAY));
    rule->for_ticks = 1000 * BIT;
    rig_start(r);
    for (unsigned i = 0; i < CW_HELD_FRAMES + 3; i++)
        rig_send(r, 0, &frame, 0);
    rig_run_bits(r, 10);
    assert_int_equal(rig_stats(r, 0).queue, 3);
    assert_int_equal(cw_bus_pending(r->bus), CW_HELD_FRAMES + 3);
    rig_run_bits(r, 1100);
    assert_int_equal(rig_stats(r, 0).tx_frames + rig_stats(r, 0).queue, CW_HELD_FRAMES + 3);
    rig_free(r);
}

/* Frames that rules make are counted apart from those of the host. */
static void frames_that_rules_make_are_counted_apart(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    cw_rule *once = rig_rule(r, new_rule("send", CW_TRIGGER_TIME, CW_ACTION_SEND));
    once->node = 0;
    once->frame = rig_frame(0x700, 0, 1);
    cw_rule *answer = rig_rule(r, new_rule("reply", CW_TRIGGER_FRAME, CW_ACTION_REPLY));
    answer->node = 1;
    answer->frame = rig_frame(0x456, 0, 2);
    answer->from = NODE(0);
    cw_rule *twice = rig_rule(r, new_rule("twice", CW_TRIGGER_FRAME, CW_ACTION_DUPLICATE));
    twice->filters[0] = (cw_filter){.value = 0x123, .mask = 0x7FF};
    twice->filter_count = 1;
    twice->number = 1;
    rig_start(r);
    rig_send(r, 0, &frame, 0);
    rig_run_bits(r, 2000);
    const cw_node_stats sender = rig_stats(r, 0);
    const cw_node_stats replier = rig_stats(r, 1);
    assert_int_equal(sender.handed_in, 1);
    assert_int_equal(sender.made_by_rules, 2); /* 700, and 123 once more */
    assert_int_equal(sender.tx_frames, 3);
    assert_int_equal(replier.handed_in, 0);
    assert_int_equal(replier.made_by_rules, 3);
    assert_true(cw_node_stats_balance(&sender) && cw_node_stats_balance(&replier));
    rig_free(r);
}

/* Rules that make more copies in one bit than there is room for events. */
static void frames_that_the_event_ring_cannot_hold_are_counted(void **state)
{
    (void)state;
    const cw_frame frame = rig_frame(0x123, 0, 0);
    rig *r = rig_new(8);
    for (unsigned i = 0; i < RIG_RULES_MAX; i++) {
        static const char *const names[RIG_RULES_MAX] = {"a", "b", "c", "d", "e", "f", "g", "h"};
        cw_rule *copies = rig_rule(r, new_rule(names[i], CW_TRIGGER_FRAME, CW_ACTION_DUPLICATE));
        copies->side = CW_SIDE_RX;
        copies->number = 16;
    }
    for (unsigned i = 0; i < 8; i++)
        r->nodes[i].queue = 1;
    r->config.events = 0;
    r->config.inbox = 1;
    rig_start(r);
    rig_send(r, 0, &frame, 0);
    rig_run_bits(r, 100);
    uint64_t lost = 0;
    for (unsigned i = 1; i < 8; i++) {
        const cw_node_stats s = rig_stats(r, i);
        assert_int_equal(rig_count(r, CW_EVENT_RX, (int)i), s.rx_frames);
        assert_int_equal(s.rx_accepted + s.rx_made_by_rules, 1 + 16 * RIG_RULES_MAX);
        assert_true(cw_node_stats_balance(&s));
        lost += s.rx_dropped[CW_DROP_QUEUE_FULL];
    }
    assert_in_range(lost, 1, 7 * 16 * RIG_RULES_MAX);
    assert_true(rig_bus_stats(r).events_lost >= lost);
    rig_free(r);
}

static void statistics_that_do_not_balance_are_known(void **state)
{
    (void)state;
    static const struct {
        cw_node_stats stats;
        bool balance;
    } cases[] = {
        {{.handed_in = 0}, true},
        {{.handed_in = 5, .made_by_rules = 2, .tx_frames = 3, .queue = 1, .held = 1,
          .dropped = {[CW_DROP_FAULT] = 2}}, true},
        {{.handed_in = 1}, false},
        {{.made_by_rules = 1}, false},
        {{.tx_frames = 1}, false},
        {{.dropped = {[CW_DROP_REMOVED] = 1}}, false},
        {{.rx_accepted = 2, .rx_made_by_rules = 3, .rx_frames = 3, .rx_held = 1,
          .rx_dropped = {[CW_DROP_FAULT] = 1}}, true},
        {{.rx_accepted = 1}, false},
        {{.rx_frames = 1}, false},
        {{.handed_in = 1, .rx_frames = 1}, false},
        {{.handed_in = 1, .rx_dropped = {[CW_DROP_FAULT] = 1}}, false},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        assert_int_equal(cw_node_stats_balance(&cases[i].stats), cases[i].balance);
}

/* ---- Another bus takes over ------------------------------------------------------------------ */

/* A bus of the same kind at tick 0. */
static rig *successor(unsigned nodes)
{
    rig *r = rig_new(nodes);
    r->config.rule_room = 4;
    return r;
}

/* However often the bus is exchanged, the trace is that of one. */
static void a_bus_that_takes_over_goes_on(void **state)
{
    (void)state;
    static const uint8_t same[] = {0, 1, 2};
    rig_random random = {.state = 11};
    rig *one = rig_new(3);
    rig *now = rig_new(3);
    rig_start(one);
    rig_start(now);
    for (unsigned round = 0; round < 50; round++) {
        for (unsigned n = 0; n < 4; n++) {
            const cw_frame frame = rig_random_frame(&random);
            unsigned node = rig_below(&random, 3);
            uint64_t tick = cw_bus_now(one->bus) + rig_below(&random, 400 * BIT);
            rig_send(one, node, &frame, tick);
            rig_send(now, node, &frame, tick);
        }
        uint64_t until = cw_bus_now(one->bus) + rig_below(&random, 300) * BIT;
        rig_run(one, until);
        rig_run(now, until);
        rig *next = rig_new(3);
        rig_start(next);
        assert_int_equal(cw_bus_take_over(next->bus, now->bus, same), CW_OK);
        free(now->memory);
        now->memory = next->memory;
        now->bus = next->bus;
        next->memory = NULL;
        rig_free(next);
    }
    rig_assert_same_events(one, now);
    const cw_bus_stats left = rig_bus_stats(one);
    const cw_bus_stats right = rig_bus_stats(now);
    assert_memory_equal(&left, &right, sizeof left);
    rig_free(one);
    rig_free(now);
}

/* Nodes come, go and change places; frames and counters go with their node. */
static void nodes_are_matched_when_taking_over(void **state)
{
    (void)state;
    static const uint8_t from[] = {CW_NO_NODE, 2, 0};
    rig *old = rig_new(3);
    cw_rule *set = rig_rule(old, new_rule("tec", CW_TRIGGER_TIME, CW_ACTION_COUNTERS));
    set->nodes = NODE(2);
    set->tec = 50;
    rig_start(old);
    for (unsigned node = 0; node < 3; node++) {
        const cw_frame frame = rig_frame(0x100 + node, 0, 0);
        for (unsigned i = 0; i <= node; i++)
            rig_send(old, node, &frame, i < 2 ? 0 : 500 * BIT);
    }
    rig_run_bits(old, 5);
    rig *r = successor(3);
    rig_start(r);
    rig_run_bits(r, 1);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, from), CW_INVALID); /* not at tick 0 */
    rig_free(r);
    r = successor(3);
    rig_start(r);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, from), CW_OK);
    assert_int_equal(cw_bus_now(r->bus), 5 * BIT);
    assert_int_equal(rig_stats(r, 0).queue, 0);
    assert_int_equal(rig_stats(r, 1).queue, 2);
    assert_int_equal(rig_stats(r, 1).tec, 50);
    assert_int_equal(rig_stats(r, 2).queue, 1);
    assert_int_equal(cw_bus_pending(r->bus), 4); /* one in the inbox */
    while (cw_node_flush(old->bus, 1) == CW_FULL)
        rig_poll(old);
    rig_poll(old);
    assert_int_equal(rig_count(old, CW_EVENT_DROP, 1), 2);
    assert_int_equal(rig_nth(old, CW_EVENT_DROP, 0)->why, CW_DROP_REMOVED);
    assert_int_equal(cw_node_flush(old->bus, 3), CW_INVALID);
    rig_run_bits(r, 1000);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 1), 3);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 2), 1);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 0), 3); /* it integrates in the first one */
    rig_free(old);
    rig_free(r);
}

/* The settings are those of the new configuration, at once. */
static void settings_are_the_new_ones_when_taking_over(void **state)
{
    (void)state;
    static const uint8_t same[] = {0, 1, 2, 3};
    const cw_frame frame = rig_frame(0x123, 0, 0);
    rig *old = rig_new(4);
    cw_rule *warn = rig_rule(old, new_rule("tec", CW_TRIGGER_TIME, CW_ACTION_COUNTERS));
    warn->nodes = NODE(0);
    warn->tec = 100;
    cw_rule *off = rig_rule(old, new_rule("off", CW_TRIGGER_TIME, CW_ACTION_BUS_OFF));
    off->nodes = NODE(2) | NODE(3);
    old->nodes[3].restart_ticks = 200 * BIT;
    rig_start(old);
    for (unsigned i = 0; i < 3; i++) {
        rig_send(old, 0, &frame, 0);
        rig_send(old, 1, &frame, 0);
    }
    rig_run_bits(old, 5);
    rig *r = successor(4);
    r->nodes[0].queue = 2;
    r->nodes[0].warning_limit = 101;
    r->nodes[1].modes = CW_MODE_LISTEN_ONLY;
    r->nodes[2].restart_ticks = 100 * BIT;
    rig_start(r);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, same), CW_OK);
    rig_run_bits(r, 300);
    assert_int_equal(rig_stats(r, 0).dropped[CW_DROP_QUEUE_FULL], 1);
    assert_int_equal(rig_stats(r, 1).dropped[CW_DROP_LISTEN_ONLY], 3);
    assert_int_equal(rig_nth(r, CW_EVENT_STATE, 0)->state, CW_STATE_ERROR_ACTIVE);
    assert_int_equal(rig_nth(r, CW_EVENT_RESTART, 0)->tick, 100 * BIT); /* R12: from bus-off */
    assert_int_equal(rig_count(r, CW_EVENT_RESTART, 3), 0); /* restart-ms is 0 now */
    assert_int_equal(cw_bus_pending(r->bus), 2);
    rig_free(old);
    rig_free(r);
}

/* A passive flag of the transmitter around the end of the CRC: when what is left of that is
 * recessive, the receivers take the frame all the same, and nobody is left who sends it. On another
 * wire others may send. */
static unsigned run_frames_that_are_left(bool partitioned)
{
    unsigned taken = 0;
    for (unsigned k = 0; k < 64 * 32; k++) {
        const cw_frame frame = rig_frame(0x6C0 + k / 32, 0, 0);
        const cw_frame other = rig_frame(0x123, 0, 8);
        rig *r = rig_new(5);
        cw_rule *split = rig_rule(r, new_rule("split", CW_TRIGGER_TIME, CW_ACTION_PARTITION));
        split->group[3] = split->group[4] = partitioned;
        cw_rule *passive = rig_rule(r, new_rule("passive", CW_TRIGGER_TIME, CW_ACTION_COUNTERS));
        passive->nodes = NODE(0);
        passive->tec = 200;
        cw_rule *flag = rig_rule(r, new_rule("flag", CW_TRIGGER_TIME, CW_ACTION_ERROR_FLAG));
        flag->nodes = NODE(0);
        flag->time_begin = (11 + 20 + k % 32) * BIT;
        rig_start(r);
        rig_send(r, 0, &frame, 0);
        for (unsigned i = 0; partitioned && i < 3; i++)
            rig_send(r, 3, &other, 0);
        rig_run_by_next(r, 300 * BIT);
        taken += rig_count(r, CW_EVENT_RX, 1) > 1;
        rig_free(r);
    }
    return taken;
}

static void a_frame_that_its_transmitter_leaves_is_foreseen(void **state)
{
    (void)state;
    assert_in_range(run_frames_that_are_left(false), 64, 64 * 16);
    assert_in_range(run_frames_that_are_left(true), 64, 64 * 16);
}

/* A smaller queue keeps what goes first, not what has lost an arbitration before. */
static void a_smaller_queue_keeps_the_first_frames(void **state)
{
    (void)state;
    static const uint8_t same[] = {0, 1, 2};
    const cw_frame low = rig_frame(0x300, 0, 0);
    const cw_frame middle = rig_frame(0x200, 0, 0);
    const cw_frame high = rig_frame(0x100, 0, 8);
    for (unsigned stepping = 0; stepping < 2; stepping++) {
        rig *old = rig_new(3);
        rig_start(old);
        cw_bus_set_stepping(old->bus, stepping == 1);
        rig_send(old, 0, &high, 0);
        rig_send(old, 1, &low, 0);
        rig_send(old, 1, &middle, 50 * BIT);
        rig_run_bits(old, 60);
        assert_int_equal(rig_count(old, CW_EVENT_ARBITRATION_LOST, 1), 1);
        rig *r = successor(3);
        r->nodes[1].queue = 1;
        r->nodes[1].queue_room = stepping ? 16 : 0; /* there is more, for later */
        rig_start(r);
        assert_int_equal(cw_bus_take_over(r->bus, old->bus, same), CW_OK);
        rig_run_bits(r, 300);
        assert_int_equal(rig_nth(r, CW_EVENT_DROP, 0)->frame.id, low.id);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
        assert_int_equal(rig_nth(r, CW_EVENT_TX, 1)->frame.id, middle.id);
        rig_free(old);
        rig_free(r);
    }
}

/* A wrong CRC on the wire stays wrong; the repetition is right. */
static void a_wrong_crc_is_taken_over(void **state)
{
    (void)state;
    static const uint8_t same[] = {0, 1};
    const cw_frame frame = rig_frame(0x123, 0, 0);
    rig *old = rig_new(2);
    cw_rule *wrong = rig_rule(old, new_rule("wrong", CW_TRIGGER_FRAME, CW_ACTION_WRONG_CRC));
    wrong->nodes = NODE(0);
    rig_start(old);
    rig_send(old, 0, &frame, 0);
    rig_run_bits(old, JOIN + 10);
    rig *r = successor(2);
    rig_start(r);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, same), CW_OK);
    rig_run_bits(r, 300);
    assert_int_equal(rig_nth(r, CW_EVENT_ERROR, 0)->error.type, CW_ERROR_ACK);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, 0), 1);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
    rig_free(old);
    rig_free(r);
}

/* Nodes have other numbers on the new bus, and one is no more. */
static void the_sender_of_a_held_frame_is_renumbered(void **state)
{
    (void)state;
    static const uint8_t turned[] = {2, 1, 0};
    static const uint8_t without[] = {CW_NO_NODE, 1, 2};
    const cw_frame frame = rig_frame(0x123, 0, 0);
    for (unsigned gone = 0; gone < 2; gone++) {
        rig *old = rig_new(3);
        cw_rule *late = rig_rule(old, new_rule("late", CW_TRIGGER_FRAME, CW_ACTION_DELAY));
        late->for_ticks = 100000 * BIT;
        late->side = CW_SIDE_RX;
        late->at = NODE(1);
        rig_start(old);
        rig_send(old, 0, &frame, 0);
        rig_run_bits(old, 100);
        rig *r = successor(3);
        rig_start(r);
        assert_int_equal(cw_bus_take_over(r->bus, old->bus, gone ? without : turned), CW_OK);
        rig_run_bits(r, 110);
        assert_int_equal(rig_nth(r, CW_EVENT_RX, 0)->nodes, NODE(1));
        assert_int_equal(rig_nth(r, CW_EVENT_RX, 0)->from, gone ? 0 : NODE(2));
        rig_free(old);
        rig_free(r);
    }
}

/* Rules start anew: what the old ones did is over, what they held back goes on. */
static void old_rules_end_when_taken_over(void **state)
{
    (void)state;
    static const uint8_t same[] = {0, 1, 2};
    const cw_frame frame = rig_frame(0x123, 0, 0);
    rig *old = rig_new(3);
    cw_rule *away = rig_rule(old, new_rule("away", CW_TRIGGER_TIME, CW_ACTION_DISCONNECT));
    away->nodes = NODE(2);
    cw_rule *deaf = rig_rule(old, new_rule("no-ack", CW_TRIGGER_TIME, CW_ACTION_NO_ACK));
    deaf->nodes = NODE(1);
    cw_rule *late = rig_rule(old, new_rule("late", CW_TRIGGER_FRAME, CW_ACTION_DELAY));
    late->for_ticks = 100000 * BIT;
    rig_start(old);
    rig_send(old, 0, &frame, 0);
    rig_run_bits(old, 100);
    rig *r = successor(3);
    cw_rule *soon = rig_rule(r, probe("soon", CW_TRIGGER_TIME));
    soon->time_begin = 50 * BIT;
    cw_rule *over = rig_rule(r, probe("over", CW_TRIGGER_TIME));
    over->time_end = 100 * BIT;
    cw_rule *later = rig_rule(r, probe("later", CW_TRIGGER_TIME));
    later->time_begin = 150 * BIT;
    rig_start(r);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, same), CW_OK);
    rig_run_bits(r, 400);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 0)->tick, 100 * BIT);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 1)->tick, 150 * BIT);
    assert_int_equal(rig_count(r, CW_EVENT_FAULT, -1) + hits(r, 1), 2);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 1);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
    rig_send(r, 2, &frame, 300 * BIT);
    rig_run_bits(r, 600);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 2), 1);
    rig_free(old);
    rig_free(r);
}

/* Each match is a hit or a miss; but the hits of noise are the bits that it flips. */
static void misses_are_matches_that_were_passed_over(void **state)
{
    (void)state;
    rig *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 8);
    cw_rule *noise = rig_rule(r, new_rule("noise", CW_TRIGGER_TIME, CW_ACTION_NOISE));
    noise->error_rate = UINT64_MAX / 4;
    noise->for_ticks = 1000 * BIT;
    noise->at = NODE(1);
    cw_rule *frames = rig_rule(r, new_rule("frames", CW_TRIGGER_FRAME, CW_ACTION_NOISE));
    frames->error_rate = UINT64_MAX / 4;
    frames->at = NODE(1);
    frames->skip = 1;
    frames->every = 2;
    cw_rule *drops = rig_rule(r, new_rule("drops", CW_TRIGGER_FRAME, CW_ACTION_DROP));
    drops->side = CW_SIDE_TX;
    drops->every = 3;
    rig_start(r);
    for (unsigned i = 0; i < 12; i++)
        rig_send(r, 0, &frame, (2000 + 500 * i) * BIT);
    rig_run_bits(r, 10000);
    cw_rule_stats stats[3];
    for (unsigned i = 0; i < 3; i++) {
        assert_int_equal(cw_rule_get_stats(r->bus, i, &stats[i]), CW_OK);
        assert_true(stats[i].misses <= stats[i].matches);
    }
    assert_int_equal(stats[0].matches, 1);
    assert_int_equal(stats[0].misses, 0);
    assert_in_range(stats[0].hits, 100, 500);
    assert_int_equal(stats[1].misses, (stats[1].matches + 1) / 2);
    assert_true(stats[1].hits > stats[1].matches);
    assert_int_equal(stats[2].matches, 12);
    assert_int_equal(stats[2].hits, 4);
    assert_int_equal(stats[2].misses, 8);
    rig_free(r);
}

/* All that a node holds is dropped and counted; it is not on the bus any more. */
static void a_flushed_node_is_gone(void **state)
{
    (void)state;
    rig *r = rig_new(3);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    cw_rule *late = rig_rule(r, new_rule("late", CW_TRIGGER_FRAME, CW_ACTION_DELAY));
    late->for_ticks = 1000 * BIT;
    late->count = 1;
    cw_rule *away = rig_rule(r, new_rule("away", CW_TRIGGER_TIME, CW_ACTION_DISCONNECT));
    away->nodes = NODE(1);
    away->for_ticks = 100 * BIT; /* its end must not bring the flushed node back */
    rig_start(r);
    for (unsigned i = 0; i < 4; i++)
        rig_send(r, 2, &frame, i == 3 ? 500 * BIT : i); /* held, on the wire, waiting, to come */
    rig_send(r, 1, &frame, 600 * BIT);
    rig_run_bits(r, JOIN + 20);
    assert_int_equal(cw_node_flush(r->bus, 2), CW_OK);
    assert_int_equal(rig_stats(r, 2).dropped[CW_DROP_REMOVED], 4);
    assert_int_equal(rig_stats(r, 2).handed_in, 4);
    assert_int_equal(cw_bus_pending(r->bus), 1);
    rig_run_bits(r, 2000);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 0), 1);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 2), 0);
    rig_free(r);
}

/* Neither its host nor a rule nor another bus brings it back; what it gets to send is dropped. */
static void a_flushed_node_stays_gone(void **state)
{
    (void)state;
    static const uint8_t same[] = {0, 1, 2};
    rig *r = rig_new(3);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    r->nodes[1].restart_ticks = 10 * BIT;
    cw_rule *off = rig_rule(r, new_rule("off", CW_TRIGGER_TIME, CW_ACTION_BUS_OFF));
    off->nodes = NODE(1);
    cw_rule *back = rig_rule(r, new_rule("back", CW_TRIGGER_TIME, CW_ACTION_COUNTERS));
    back->nodes = NODE(1);
    back->time_begin = 100 * BIT;
    rig_start(r);
    rig_run_bits(r, 5);
    assert_int_equal(cw_node_flush(r->bus, 1), CW_OK);
    assert_false(cw_node_attached(r->bus, 1));
    assert_int_equal(cw_node_attach(r->bus, 1, false), CW_OK);
    assert_int_equal(cw_node_attach(r->bus, 1, true), CW_REFUSED);
    rig_send(r, 1, &frame, 50 * BIT);
    rig_send(r, 0, &frame, 200 * BIT);
    rig_run_bits(r, 1000);
    assert_int_equal(rig_stats(r, 1).dropped[CW_DROP_REMOVED], 1);
    assert_int_equal(rig_stats(r, 1).restarts, 0);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 0);
    rig *next = rig_new(3);
    rig_start(next);
    assert_int_equal(cw_bus_take_over(next->bus, r->bus, same), CW_OK);
    rig_send(next, 0, &frame, 1000 * BIT);
    rig_run_bits(next, 2000);
    assert_int_equal(cw_node_attach(next->bus, 1, true), CW_REFUSED);
    assert_int_equal(rig_count(next, CW_EVENT_RX, 1), 0);
    assert_int_equal(rig_count(next, CW_EVENT_RX, 2), 1);
    rig_free(next);
    rig_free(r);
}

/* Two nodes cannot both go on as one: its frames would be there twice. */
static void a_node_is_taken_over_once(void **state)
{
    (void)state;
    static const uint8_t twice[] = {0, 0};
    static const uint8_t once[] = {0, CW_NO_NODE};
    rig *old = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    rig_start(old);
    rig_send(old, 0, &frame, 5 * BIT);
    rig_run_bits(old, 8);
    rig *r = rig_new(2);
    rig_start(r);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, twice), CW_INVALID);
    assert_int_equal(cw_bus_pending(r->bus), 0);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, once), CW_OK);
    assert_int_equal(cw_bus_pending(r->bus), 1);
    rig_free(old);
    rig_free(r);
}

/* ---- Traffic that is no fault ---------------------------------------------------------------- */

/* Its hits are neither told nor counted; all else is as with a rule that is not quiet. */
static void a_quiet_rule_is_not_told(void **state)
{
    (void)state;
    for (int quiet = 0; quiet < 2; quiet++) {
        rig *r = rig_new(2);
        const cw_frame question = rig_frame(0x123, CW_FRAME_REMOTE, 0);
        cw_rule *answer = rig_rule(r, new_rule("reply", CW_TRIGGER_FRAME, CW_ACTION_REPLY));
        answer->node = 1;
        answer->frame = rig_frame(0x123, 0, 2);
        answer->quiet = quiet;
        rig_start(r);
        rig_send(r, 0, &question, 0);
        rig_run_bits(r, 300);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 1), 1);
        assert_int_equal(rig_count(r, CW_EVENT_FAULT, -1), quiet ? 0 : 1);
        assert_int_equal(rig_bus_stats(r).faults, quiet ? 0 : 1);
        assert_int_equal(rig_stats(r, 1).made_by_rules, 1);
        rig_free(r);
    }
}

static void frames_match_filters(void **state)
{
    static const cw_filter base = {.value = 0x123, .mask = CW_FILTER_EXTENDED | 0x7FF};
    static const cw_filter remote = {.value = CW_FILTER_REMOTE, .mask = CW_FILTER_REMOTE};
    static const cw_filter others = {.value = 0x100, .mask = 0x700, .inverted = true};
    const cw_filter both[] = {base, remote};
    const cw_frame data = rig_frame(0x123, 0, 1);
    const cw_frame extended = rig_frame(0x123, CW_FRAME_EXTENDED, 1);
    const cw_frame request = rig_frame(0x456, CW_FRAME_REMOTE, 1);
    (void)state;
    assert_true(cw_frame_matches(&data, NULL, 0));
    assert_true(cw_frame_matches(&data, &base, 1));
    assert_false(cw_frame_matches(&extended, &base, 1));
    assert_false(cw_frame_matches(&request, &base, 1));
    assert_true(cw_frame_matches(&request, both, 2));
    assert_false(cw_frame_matches(&data, &others, 1));
    assert_true(cw_frame_matches(&request, &others, 1));
}

/* Any number of a stream at once, the same as one after the other. */
static void random_numbers_are_those_of_the_stream(void **state)
{
    (void)state;
    cw_prng prng;
    cw_prng_init(&prng, 42, "engine");
    for (uint64_t n = 0; n < 100; n++) {
        uint64_t number = cw_prng_next(&prng);
        assert_true(cw_random(42, "engine", n) == number);
        assert_true(cw_random(43, "engine", n) != number);
        assert_true(cw_random(42, "gearbox", n) != number);
    }
}

/* ---- Time in which nothing happens ----------------------------------------------------------- */

/* The work of a bus up to a second that is far away: a restart, a rule, a frame in the inbox are
 * still to come, noise is over, a node is off. */
static uint64_t work_of_idle_seconds(uint64_t seconds)
{
    const uint64_t end = seconds * CW_CLOCK_HZ;
    rig *r = rig_new(4);
    const cw_frame frame = rig_frame(0x123, 0, 8);
    r->nodes[1].restart_ticks = 2 * end;
    cw_rule *down = rig_rule(r, new_rule("down", CW_TRIGGER_TIME, CW_ACTION_BUS_OFF));
    down->nodes = NODE(1);
    down->time_begin = 10 * BIT;
    cw_rule *noise = rig_rule(r, new_rule("noise", CW_TRIGGER_TIME, CW_ACTION_NOISE));
    noise->error_rate = UINT64_MAX / 2;
    noise->for_ticks = 100 * BIT;
    cw_rule *late = rig_rule(r, new_rule("late", CW_TRIGGER_TIME, CW_ACTION_BUS_OFF));
    late->nodes = NODE(2);
    late->time_begin = 2 * end;
    rig_start(r);
    rig_send(r, 0, &frame, 3000 * BIT);
    rig_send(r, 0, &frame, 2 * end);
    assert_int_equal(cw_node_attach(r->bus, 3, false), CW_OK);
    rig_run_bits(r, 50000);
    uint64_t before = cw_bus_work(r->bus);
    assert_int_equal(cw_bus_advance(r->bus, end), CW_OK);
    assert_true(cw_bus_now(r->bus) > end - BIT);
    cw_bus_stats stats;
    cw_bus_get_stats(r->bus, &stats);
    assert_int_equal(stats.bits, end / BIT);
    assert_int_equal(stats.load_permille, 0);
    uint64_t work = cw_bus_work(r->bus) - before;
    rig_free(r);
    return work;
}

static void idle_time_costs_nothing(void **state)
{
    (void)state;
    assert_in_range(work_of_idle_seconds(10), 1, 10);
    assert_int_equal(work_of_idle_seconds(10), work_of_idle_seconds(UINT64_C(100000000000)));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(other_rules_do_not_change_the_draws),
        cmocka_unit_test(seed_and_name_decide_the_draws),
        cmocka_unit_test(a_rule_added_at_run_time_acts_from_then_on),
        cmocka_unit_test(a_cleared_rule_is_gone),
        cmocka_unit_test(a_stopped_rule_can_act_again),
        cmocka_unit_test(a_rule_before_the_cleared_one_is_left_alone),
        cmocka_unit_test(frames_of_a_cleared_rule_are_sent),
        cmocka_unit_test(held_frames_go_on_when_the_rule_is_cleared),
        cmocka_unit_test(bad_rules_are_refused),
        cmocka_unit_test(rules_at_the_limits_are_good),
        cmocka_unit_test(a_manual_rule_acts_when_fired),
        cmocka_unit_test(a_manual_rule_on_frames_takes_one_match),
        cmocka_unit_test(armings_take_place_in_time_order),
        cmocka_unit_test(armings_are_bounded),
        cmocka_unit_test(a_ring_of_rules_goes_round_once_in_a_bit),
        cmocka_unit_test(many_exact_identifiers_meet_their_own_frames),
        cmocka_unit_test(rules_on_one_frame_act_in_their_order),
        cmocka_unit_test(a_change_reaches_all_bytes),
        cmocka_unit_test(commands_at_the_end_of_a_frame),
        cmocka_unit_test(recovery_does_not_reconnect),
        cmocka_unit_test(a_disconnected_node_stays_away),
        cmocka_unit_test(counters_do_not_reconnect),
        cmocka_unit_test(noise_and_a_position_in_one_bit),
        cmocka_unit_test(matches_count_with_their_bits),
        cmocka_unit_test(a_leap_that_goes_on_stops_for_bound_rules),
        cmocka_unit_test(a_rule_knows_its_frame_to_the_end),
        cmocka_unit_test(two_overload_frames_are_all_before_the_next_frame),
        cmocka_unit_test(a_state_changes_while_a_node_is_away),
        cmocka_unit_test(the_sender_is_on_the_same_wire),
        cmocka_unit_test(the_sender_may_have_an_error_in_the_last_bit),
        cmocka_unit_test(a_rule_is_bound_to_its_own_frame),
        cmocka_unit_test(a_stopped_rule_lets_go_of_the_frame),
        cmocka_unit_test(each_hit_of_a_glitch_starts_its_pattern),
        cmocka_unit_test(bits_are_on_the_wire_of_their_frame),
        cmocka_unit_test(bits_last_as_long_as_they_are_told_to),
        cmocka_unit_test(what_begins_with_a_frame_ends_in_time),
        cmocka_unit_test(a_rule_on_errors_alone),
        cmocka_unit_test(noise_is_followed_from_the_end_of_its_bit),
        cmocka_unit_test(the_overload_delimiter_begins_when_the_wire_is_free),
        cmocka_unit_test(a_stuck_rx_is_not_on_the_wire),
        cmocka_unit_test(noise_with_count_and_skip),
        cmocka_unit_test(settings_are_changed_and_read),
        cmocka_unit_test(a_queue_limit_is_for_new_frames),
        cmocka_unit_test(the_trace_does_not_depend_on_the_pace),
        cmocka_unit_test(events_are_in_order),
        cmocka_unit_test(no_frame_is_lost_at_the_host_side),
        cmocka_unit_test(frames_held_back_are_bounded),
        cmocka_unit_test(frames_that_rules_make_are_counted_apart),
        cmocka_unit_test(frames_that_the_event_ring_cannot_hold_are_counted),
        cmocka_unit_test(statistics_that_do_not_balance_are_known),
        cmocka_unit_test(a_bus_that_takes_over_goes_on),
        cmocka_unit_test(nodes_are_matched_when_taking_over),
        cmocka_unit_test(settings_are_the_new_ones_when_taking_over),
        cmocka_unit_test(a_frame_that_its_transmitter_leaves_is_foreseen),
        cmocka_unit_test(a_smaller_queue_keeps_the_first_frames),
        cmocka_unit_test(a_wrong_crc_is_taken_over),
        cmocka_unit_test(the_sender_of_a_held_frame_is_renumbered),
        cmocka_unit_test(old_rules_end_when_taken_over),
        cmocka_unit_test(misses_are_matches_that_were_passed_over),
        cmocka_unit_test(idle_time_costs_nothing),
        cmocka_unit_test(a_flushed_node_is_gone),
        cmocka_unit_test(a_flushed_node_stays_gone),
        cmocka_unit_test(a_node_is_taken_over_once),
        cmocka_unit_test(a_quiet_rule_is_not_told),
        cmocka_unit_test(frames_match_filters),
        cmocka_unit_test(random_numbers_are_those_of_the_stream),
    };
    return cmocka_run_group_tests_name("fault", tests, NULL, NULL);
}
