/* SPDX-License-Identifier: MIT
 *
 * test_midway.c - rules that come and go while a frame is on the wire: the same as bit by bit.
 */
#include "format/bits.h"
#include "rig.h"

static cw_rule rule_of(const char *name, cw_trigger trigger, cw_action action)
{
    return (cw_rule){.name = name, .time_end = CW_NEVER, .probability = UINT64_MAX, .every = 1,
                     .trigger = trigger, .action = action, .bits = 1};
}

static cw_rule flip_of(const char *name, cw_field field, unsigned index, uint64_t from)
{
    cw_rule rule = rule_of(name, CW_TRIGGER_FRAME, CW_ACTION_FLIP);
    rule.field = field;
    rule.index = (uint16_t)index;
    rule.from = from;
    return rule;
}

static unsigned add(rig *r, const cw_rule *rule)
{
    unsigned index;
    assert_int_equal(cw_bus_add_rule(r->bus, &index, rule), CW_OK);
    return index;
}

/* Disturbs the bus in a way that needs the controllers in their state of that bit. */
static void disturb(rig *r, uint64_t bit, cw_action action, uint64_t nodes)
{
    cw_rule rule = rule_of("disturb", CW_TRIGGER_TIME, action);
    rule.time_begin = bit * BIT;
    rule.nodes = nodes;
    rule.tec = rule.rec = 1;
    (void)add(r, &rule);
}

/* R8 makes node 2 error-active again at the ACK slot. */
static void a_new_rule_on_a_state(rig *r)
{
    cw_rule warn = rule_of("warn", CW_TRIGGER_TIME, CW_ACTION_COUNTERS);
    warn.nodes = NODE(2);
    warn.rec = 96;
    (void)add(r, &warn);
    rig_run_bits(r, 40);
    cw_rule flag = rule_of("flag", CW_TRIGGER_ERROR, CW_ACTION_ERROR_FLAG);
    flag.error_mask = 0x004;
    flag.nodes = NODE(2);
    flag.count = 1;
    (void)add(r, &flag);
}

static void the_earlier_of_two_rules_goes(rig *r)
{
    const cw_rule early = flip_of("early", CW_FIELD_BIT, 25, NODE(0));
    const cw_rule late = flip_of("late", CW_FIELD_BIT, 40, NODE(0));
    unsigned index = add(r, &early);
    (void)add(r, &late);
    rig_run_bits(r, 30);
    assert_int_equal(cw_bus_clear_rule(r->bus, index), CW_OK);
}

/* The rule binds at SOF, and this one has passed. */
static void a_new_rule_on_a_node_that_will_lose(rig *r)
{
    cw_rule never = flip_of("never", CW_FIELD_ACK_SLOT, 0, NODE(1));
    never.skip = 1000;
    (void)add(r, &never);
    rig_run_bits(r, 25);
    const cw_rule late = flip_of("late", CW_FIELD_ID, 8, NODE(1));
    (void)add(r, &late);
    disturb(r, 26, CW_ACTION_COUNTERS, NODE(2));
}

/* Node 1 wins once node 0 has gone; the stopped rule leaves this transmission alone. */
static void a_rule_stops_that_a_loser_has_not_met(rig *r)
{
    const cw_rule flip = flip_of("flip", CW_FIELD_ACK_SLOT, 0, NODE(1));
    unsigned index = add(r, &flip);
    rig_run_bits(r, 25);
    assert_int_equal(cw_bus_stop_rule(r->bus, index), CW_OK);
    disturb(r, 26, CW_ACTION_DISCONNECT, NODE(0));
}

/* bit[0] is the SOF, which no frame step may have begun with. */
static void a_rule_on_the_first_bit_by_its_number(rig *r)
{
    cw_rule flip = flip_of("flip", CW_FIELD_BIT, 0, NODE(0));
    flip.count = 2;
    (void)add(r, &flip);
}

/* Returns a frame that gets another number of stuff bits when the last bit of its CRC is wrong. */
static cw_frame frame_that_shows_its_crc(void)
{
    cw_frame frame = rig_frame(0x200, 0, 0);
    cw_bits right, wrong;
    do {
        frame.id++;
        assert_int_equal(cw_bits_encode(&right, &frame), CW_OK);
        assert_int_equal(cw_bits_encode_crc(&wrong, &frame, 1), CW_OK);
    } while (right.length == wrong.length);
    return frame;
}

/* The second attempt has the right CRC. */
static void a_wrong_crc_once(rig *r)
{
    const cw_frame frame = frame_that_shows_its_crc();
    cw_rule wrong = rule_of("wrong", CW_TRIGGER_FRAME, CW_ACTION_WRONG_CRC);
    wrong.nodes = wrong.from = NODE(2);
    wrong.count = 1;
    (void)add(r, &wrong);
    rig_send(r, 2, &frame, 300 * BIT);
}

/* A frame for now is in the queue that is flushed, with or without a rule to wait for. */
static void a_frame_for_now_of_a_node_that_goes(rig *r)
{
    cw_rule never = flip_of("never", CW_FIELD_ACK_SLOT, 0, NODE(0));
    never.skip = 1000;
    (void)add(r, &never);
    rig_run_bits(r, 25);
    const cw_frame more = rig_frame(0x080, 0, 0);
    rig_send(r, 0, &more, 25 * BIT);
    assert_int_equal(cw_node_attach(r->bus, 0, false), CW_OK);
}

/* A passive flag does not stop the frame, so that the next flag is another one. */
static void a_node_goes_amid_its_flag(rig *r)
{
    cw_rule passive = rule_of("passive", CW_TRIGGER_TIME, CW_ACTION_COUNTERS);
    passive.nodes = NODE(2);
    passive.rec = 200;
    (void)add(r, &passive);
    disturb(r, 45, CW_ACTION_ERROR_FLAG, NODE(2));
    disturb(r, 60, CW_ACTION_ERROR_FLAG, NODE(1));
    rig_run_bits(r, 47);
    assert_int_equal(cw_node_attach(r->bus, 2, false), CW_OK);
}

/* The frame comes at the very end of a bit, so that nothing is due before it is looked at. */
static void a_frame_that_comes_sets_off(rig *r, cw_rule rule)
{
    const cw_frame third = rig_frame(0x200, 0, 0);
    cw_rule host = rule_of("host", CW_TRIGGER_FRAME, CW_ACTION_DUPLICATE);
    host.from = NODE(2);
    rule.has_after = true;
    rule.after = (uint16_t)add(r, &host);
    rule.for_ticks = 15 * BIT;
    (void)add(r, &rule);
    rig_send(r, 2, &third, 50 * BIT);
}

static void a_frame_that_comes_sets_off_a_stuck_wire(rig *r)
{
    cw_rule stuck = rule_of("stuck", CW_TRIGGER_ARMED, CW_ACTION_STUCK);
    stuck.level = CW_RECESSIVE;
    a_frame_that_comes_sets_off(r, stuck);
}

static void a_frame_that_comes_sets_off_a_partition(rig *r)
{
    cw_rule partition = rule_of("partition", CW_TRIGGER_ARMED, CW_ACTION_PARTITION);
    partition.group[0] = 1;
    a_frame_that_comes_sets_off(r, partition);
}

/* ---- Levels that rules hold ------------------------------------------------------------------ */

static void stick(rig *r, cw_line line, unsigned node, bool level, uint64_t from, uint64_t bits)
{
    cw_rule stuck = rule_of("stuck", CW_TRIGGER_TIME, CW_ACTION_STUCK);
    stuck.line = line;
    stuck.node = (uint8_t)node;
    stuck.level = level;
    stuck.time_begin = from * BIT;
    stuck.for_ticks = bits * BIT;
    (void)add(r, &stuck);
}

/* Nodes 0 and 1 begin together; node 0 would win. */
static void the_winner_is_mute(rig *r)
{
    stick(r, CW_LINE_TX, 0, CW_RECESSIVE, 12, 100);
}

static void a_loser_is_mute(rig *r)
{
    stick(r, CW_LINE_TX, 1, CW_RECESSIVE, 12, 100);
}

static void a_listener_is_mute(rig *r)
{
    stick(r, CW_LINE_TX, 2, CW_RECESSIVE, 12, 400);
}

static void nobody_can_acknowledge(rig *r)
{
    stick(r, CW_LINE_TX, 2, CW_RECESSIVE, 12, 200);
    stick(r, CW_LINE_TX, 1, CW_RECESSIVE, 12, 200);
}

/* The time limit ends before the first SOF. */
static void a_line_was_dominant_for_too_long(rig *r)
{
    cw_rule stuck = rule_of("stuck", CW_TRIGGER_TIME, CW_ACTION_STUCK);
    stuck.line = CW_LINE_TX;
    stuck.node = 2;
    stuck.for_ticks = 500 * BIT;
    stuck.dominant_timeout = BIT;
    (void)add(r, &stuck);
}

static void the_wire_is_cut_at_the_first_bit(rig *r)
{
    stick(r, CW_LINE_WIRE, 0, CW_RECESSIVE, 12, 9);
}

static void a_deaf_node(rig *r)
{
    stick(r, CW_LINE_RX, 2, CW_RECESSIVE, 12, 60);
}

static void a_deaf_node_that_sends(rig *r)
{
    stick(r, CW_LINE_RX, 1, CW_RECESSIVE, 12, 60);
}

/* The pattern begins behind the frame of node 2, and the frames of nodes 0 and 1 follow at once. It
 * changes one bit of their arbitration: the one that decides it, or a later one. */
static void change_after_node_2(rig *r, unsigned bit)
{
    const cw_frame third = rig_frame(0x080, 0, 0);
    cw_rule glitch = rule_of("glitch", CW_TRIGGER_FRAME, CW_ACTION_GLITCH);
    glitch.field = CW_FIELD_INTERMISSION;
    glitch.from = NODE(2);
    glitch.bits = 60;
    glitch.pattern_mask = UINT64_C(1) << (3 + bit);
    glitch.pattern_level = bit % 2 ? 0 : UINT64_MAX;
    glitch.filter_count = 1;
    glitch.filters[0] = (cw_filter){.value = third.id, .mask = 0x7FF};
    (void)add(r, &glitch);
    rig_send(r, 2, &third, 19 * BIT);
}

static void the_sof_is_changed(rig *r)
{
    change_after_node_2(r, 0);
}

static void a_bit_of_both_is_changed(rig *r)
{
    change_after_node_2(r, 1);
}

static void a_bit_of_both_is_made_recessive(rig *r)
{
    change_after_node_2(r, 6);
}

static void the_deciding_bit_is_changed(rig *r)
{
    change_after_node_2(r, 14);
}

static void a_bit_of_the_data_is_changed(rig *r)
{
    change_after_node_2(r, 25);
}

/* Node 0 is alone, and sees its dominant bits although they do not get through. */
static void two_faults_hide_each_other(rig *r)
{
    assert_int_equal(cw_node_attach(r->bus, 1, false), CW_OK);
    assert_int_equal(cw_node_attach(r->bus, 2, false), CW_OK);
    stick(r, CW_LINE_TX, 0, CW_RECESSIVE, 25, 3);
    stick(r, CW_LINE_RX, 0, CW_DOMINANT, 25, 3);
}

static void a_node_babbles(rig *r)
{
    cw_rule babble = rule_of("babble", CW_TRIGGER_TIME, CW_ACTION_BABBLE);
    babble.node = 2;
    babble.frame = rig_frame(0x300, 0, 1);
    babble.time_begin = 12 * BIT;
    babble.for_ticks = 300 * BIT;
    (void)add(r, &babble);
}

static void fill_up(rig *r, unsigned permille)
{
    cw_rule load = rule_of("load", CW_TRIGGER_TIME, CW_ACTION_LOAD);
    load.node = 2;
    load.load_permille = (uint16_t)permille;
    load.time_begin = 12 * BIT;
    load.for_ticks = 850 * BIT;
    (void)add(r, &load);
}

static void a_node_fills_up(rig *r)
{
    fill_up(r, 700);
}

static void a_node_fills_up_to_nothing(rig *r)
{
    fill_up(r, 0);
}

static void a_node_fills_up_to_all(rig *r)
{
    fill_up(r, 1000);
}

static void a_node_fills_up_while_another_is_mute(rig *r)
{
    fill_up(r, 600);
    stick(r, CW_LINE_TX, 1, CW_RECESSIVE, 12, 400);
}

/* ---- Both ways ------------------------------------------------------------------------------- */

static rig *run(void (*story)(rig *r), bool stepping)
{
    const cw_frame first = rig_frame(0x100, 0, 4);
    const cw_frame second = rig_frame(0x101, 0, 1);
    rig *r = rig_new(3);
    r->config.rule_room = 4;
    rig_start(r);
    cw_bus_set_stepping(r->bus, stepping);
    rig_send(r, 0, &first, 20 * BIT);
    rig_send(r, 1, &second, 20 * BIT);
    story(r);
    rig_run_bits(r, 600);
    return r;
}

static void assert_same_stats(const rig *a, const rig *b)
{
    const cw_bus_stats bus_a = rig_bus_stats(a);
    const cw_bus_stats bus_b = rig_bus_stats(b);
    assert_memory_equal(&bus_a, &bus_b, sizeof bus_a);
    for (unsigned i = 0; i < a->config.node_count; i++) {
        const cw_node_stats node_a = rig_stats(a, i);
        const cw_node_stats node_b = rig_stats(b, i);
        assert_memory_equal(&node_a, &node_b, sizeof node_a);
    }
}

TEST(rules_that_change_in_a_frame_act_as_bit_by_bit)
{
    static void (*const stories[])(rig *r) = {
        a_new_rule_on_a_state, the_earlier_of_two_rules_goes, a_new_rule_on_a_node_that_will_lose,
        a_rule_stops_that_a_loser_has_not_met, a_rule_on_the_first_bit_by_its_number,
        a_wrong_crc_once, a_frame_for_now_of_a_node_that_goes,
        a_node_goes_amid_its_flag, a_frame_that_comes_sets_off_a_stuck_wire,
        a_frame_that_comes_sets_off_a_partition};
    for (size_t i = 0; i < sizeof stories / sizeof stories[0]; i++) {
        RIG *fast = run(stories[i], false);
        RIG *stepping = run(stories[i], true);
        assert_in_range(rig_count(stepping, CW_EVENT_TX, -1) +
                        rig_count(stepping, CW_EVENT_ERROR, -1), 1, SIZE_MAX);
        rig_assert_same_events(fast, stepping);
        assert_same_stats(fast, stepping);
    }
}

/* Compares the buses also in the middle of all activities. */
static void assert_same_bit_by_bit(rig *a, rig *b, unsigned bits)
{
    for (unsigned bit = 0; bit < bits; bit++) {
        rig_run_bits(a, bit);
        rig_run_bits(b, bit);
        assert_int_equal(cw_bus_recessive_bits(a->bus), cw_bus_recessive_bits(b->bus));
        assert_int_equal(cw_bus_idle(a->bus), cw_bus_idle(b->bus));
    }
}

static void watch_levels(void (*story)(rig *r), bool lost, unsigned single_bits)
{
    rig *rigs[2];
    for (unsigned stepping = 0; stepping < 2; stepping++) {
        rig *r = rigs[stepping] = rig_new(3);
        r->config.rule_room = 4;
        rig_start(r);
        cw_bus_set_stepping(r->bus, stepping);
        if (!lost)
            cw_bus_set_events(r->bus, UINT32_MAX & ~(1u << CW_EVENT_ARBITRATION_LOST));
        for (unsigned i = 0; i < 4; i++) {
            const cw_frame frame = rig_frame(0x100 + i % 2, 0, 2);
            rig_send(r, i % 2, &frame, 20 * BIT);
        }
        story(r);
    }
    assert_same_bit_by_bit(rigs[0], rigs[1], single_bits);
    rig_run_bits(rigs[0], 900);
    rig_run_bits(rigs[1], 900);
    rig_assert_same_events(rigs[0], rigs[1]);
    assert_same_stats(rigs[0], rigs[1]);
    rig_free(rigs[0]);
    rig_free(rigs[1]);
}

/* This also holds without an observer of the lost arbitration, when its end was computed
 * beforehand. */
TEST(levels_that_rules_hold_act_as_bit_by_bit)
{
    static void (*const stories[])(rig *r) = {
        the_winner_is_mute, a_loser_is_mute, a_listener_is_mute, nobody_can_acknowledge,
        a_line_was_dominant_for_too_long, the_wire_is_cut_at_the_first_bit, a_deaf_node,
        a_deaf_node_that_sends, the_sof_is_changed, a_bit_of_both_is_changed,
        a_bit_of_both_is_made_recessive, the_deciding_bit_is_changed, a_bit_of_the_data_is_changed,
        two_faults_hide_each_other, a_node_babbles, a_node_fills_up, a_node_fills_up_to_nothing,
        a_node_fills_up_to_all, a_node_fills_up_while_another_is_mute};
    for (size_t i = 0; i < sizeof stories / sizeof stories[0]; i++) {
        watch_levels(stories[i], true, 0);
        watch_levels(stories[i], false, 0);
        watch_levels(stories[i], true, 300);
    }
}
