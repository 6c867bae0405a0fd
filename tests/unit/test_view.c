/* SPDX-License-Identifier: MIT
 *
 * test_view.c - the last bit as cw_bus_get_bit() shows it: levels, places, faults, counters.
 */
#include "rig.h"

#define INTERMISSION_BITS 3u
#define ALL UINT64_MAX

static void start_stepping(rig *r)
{
    rig_start(r);
    cw_bus_set_stepping(r->bus, true);
}

static cw_bit_view next_bit(rig *r)
{
    cw_bit_view view;
    rig_run(r, cw_bus_now(r->bus) + BIT);
    assert_int_equal(cw_bus_get_bit(r->bus, &view), CW_OK);
    assert_int_equal(view.end, cw_bus_now(r->bus));
    assert_int_equal(view.start, view.end - BIT);
    return view;
}

/* Returns the next bit whose place for a node is the given one, within 400 bits. */
static cw_bit_view bit_at(rig *r, unsigned node, cw_field field, unsigned index)
{
    for (unsigned n = 0; n < 400; n++) {
        cw_bit_view view = next_bit(r);
        const cw_place *p = &view.nodes[node].place;
        if (p->field == field && p->index == index && !p->stuff)
            return view;
    }
    fail_msg("%s[%u] does not come", cw_field_name(field), index);
    return (cw_bit_view){.start = 0};
}

static void assert_place(const cw_place *got, const cw_place *wanted)
{
    assert_string_equal(cw_field_name(got->field), cw_field_name(wanted->field));
    assert_int_equal(got->index, wanted->index);
    assert_int_equal(got->stuff, wanted->stuff);
}

/* ---- Frames ---------------------------------------------------------------------------------- */

TEST(bits_are_there_only_when_stepping)
{
    RIG *r = rig_new(2);
    cw_bit_view view = {.start = 42};
    rig_start(r);
    assert_int_equal(cw_bus_get_bit(r->bus, &view), CW_REFUSED);
    rig_run_bits(r, 1);
    assert_int_equal(cw_bus_get_bit(r->bus, &view), CW_REFUSED);
    cw_bus_set_stepping(r->bus, true);
    assert_int_equal(cw_bus_get_bit(r->bus, &view), CW_REFUSED);
    assert_int_equal(view.start, 42);
    rig_run_bits(r, 2);
    assert_int_equal(cw_bus_get_bit(r->bus, &view), CW_OK);
    assert_int_equal(view.start, BIT);
    cw_bus_set_stepping(r->bus, false);
    rig_run_bits(r, 30);
    assert_int_equal(cw_bus_get_bit(r->bus, &view), CW_REFUSED);
}

static void assert_same_bit(const cw_bit_view *a, const cw_bit_view *b)
{
    assert_int_equal(a->driven, b->driven);
    assert_int_equal(a->wire, b->wire);
    assert_int_equal(a->sampled, b->sampled);
    assert_int_equal(a->tx_faults, b->tx_faults);
    assert_int_equal(a->wire_faults, b->wire_faults);
    assert_int_equal(a->rx_faults, b->rx_faults);
    for (unsigned i = 0; i < a->node_count; i++) {
        assert_place(&a->nodes[i].place, &b->nodes[i].place);
        assert_int_equal(a->nodes[i].phase, b->nodes[i].phase);
        assert_int_equal(a->nodes[i].role, b->nodes[i].role);
        assert_int_equal(a->nodes[i].state, b->nodes[i].state);
        assert_int_equal(a->nodes[i].tec, b->nodes[i].tec);
        assert_int_equal(a->nodes[i].rec, b->nodes[i].rec);
        if ((a->alike & b->alike) >> i & 1u)
            assert_place(&a->nodes[i].place, &a->nodes[__builtin_ctzll(a->alike)].place);
    }
}

/* Makes a bus with noise and a frame from time to time. One node goes bus-off and comes back; the
 * counters of another are set while the bus is idle. */
static rig *make_troubled_bus(void)
{
    static const cw_rule troubles[] = {
        {.name = "noise", .action = CW_ACTION_NOISE, .error_rate = UINT64_MAX / 2000},
        {.name = "kill", .action = CW_ACTION_BUS_OFF, .nodes = NODE(0), .time_begin = 3000 * BIT},
        {.name = "set", .action = CW_ACTION_COUNTERS, .nodes = NODE(1), .time_begin = 7777 * BIT,
         .tec = 100, .rec = 3},
    };
    rig *r = rig_new(4);
    for (size_t i = 0; i < sizeof troubles / sizeof troubles[0]; i++) {
        cw_rule *rule = &r->rules[r->config.rule_count++];
        *rule = troubles[i];
        rule->trigger = CW_TRIGGER_TIME;
        rule->time_end = CW_NEVER;
        rule->probability = UINT64_MAX;
    }
    r->nodes[0].restart_ticks = 2000 * BIT;
    rig_start(r);
    for (unsigned i = 0; i < 20; i++) {
        const cw_frame frame = rig_frame(0x100 + 37 * i, 0, i % 9);
        rig_send(r, i % 4, &frame, i * 997 * BIT + i);
    }
    return r;
}

/* One bus is watched, but for what is said to be quiet; the other one shows all of its bits.
 * Returns the bits that were left out; in_frames: only those within frames. */
static uint64_t compare_quiet_bits(rig *watched, rig *reference, uint64_t end, bool in_frames,
                                   void (*compare)(const cw_bit_view *, const cw_bit_view *))
{
    cw_bit_view seen = {.start = 0}, real = {.start = 0};
    uint64_t skipped = 0;
    cw_bus_set_stepping(reference->bus, true);
    for (uint64_t bit = 0; bit < end;) {
        uint64_t quiet = cw_bus_quiet_until(watched->bus, end * BIT) / BIT;
        cw_bus_set_watching(watched->bus, quiet == bit);
        rig_run_bits(watched, quiet > bit ? quiet : bit + 1);
        if (!in_frames || seen.nodes[0].phase == CW_MAC_FRAME)
            skipped += quiet - bit;
        if (quiet == bit)
            assert_int_equal(cw_bus_get_bit(watched->bus, &seen), CW_OK);
        while (bit < cw_bus_now(watched->bus) / BIT) {
            rig_run_bits(reference, ++bit);
            assert_int_equal(cw_bus_get_bit(reference->bus, &real), CW_OK);
            compare(&seen, &real);
        }
    }
    assert_int_equal(seen.end, end * BIT);
    return skipped;
}

TEST(what_is_quiet_is_as_the_bit_before)
{
    const uint64_t end = 20000;
    RIG *watched = make_troubled_bus(), *reference = make_troubled_bus();
    assert_true(compare_quiet_bits(watched, reference, end, false, assert_same_bit) > end / 4);
    assert_true(rig_stats(watched, 0).restarts > 0);
}

/* Makes a bus with frames of all formats, some of which begin together. */
static rig *make_busy_bus(void)
{
    rig_random random = {.state = 11};
    rig *r = rig_new(4);
    rig_start(r);
    for (unsigned i = 0; i < 60; i++) {
        const cw_frame frame = rig_random_frame(&random);
        rig_send(r, i % 4, &frame, i / 2 * 331 * BIT + i % 3);
    }
    return r;
}

/* Skips no bit. Controllers take the bits of one bus only. */
TEST(bits_of_frames_are_those_of_controllers)
{
    rig *watched = make_busy_bus(), *reference = make_busy_bus();
    cw_bit_view seen = {.start = 0}, real = {.start = 0};
    uint64_t steady = 0;
    cw_bus_set_watching(watched->bus, true);
    cw_bus_set_stepping(reference->bus, true);
    for (uint64_t bit = 1; bit < 10000; bit++) {
        rig_run_bits(watched, bit);
        rig_run_bits(reference, bit);
        assert_int_equal(cw_bus_get_bit(watched->bus, &seen), CW_OK);
        assert_int_equal(cw_bus_get_bit(reference->bus, &real), CW_OK);
        assert_same_bit(&seen, &real);
        steady += seen.steady;
    }
    assert_true(steady > 1500);
    assert_int_equal(rig_stats(watched, 0).tx_frames, rig_stats(reference, 0).tx_frames);
    rig_free(watched);
    rig_free(reference);
}

/* Bits that are left out look like the one before, in a trace. */
static void assert_looks_alike(const cw_bit_view *seen, const cw_bit_view *real)
{
    cw_bit_view copy = *real;
    for (unsigned i = 0; i < copy.node_count; i++) {
        const cw_place *place = &seen->nodes[i].place;
        assert_true(place->field != CW_FIELD_DATA ||
                    copy.nodes[i].place.index / 8 == place->index / 8);
        copy.nodes[i].place.index = place->index;
    }
    assert_same_bit(seen, &copy);
}

TEST(quiet_bits_of_frames_look_alike)
{
    rig *watched = make_busy_bus(), *reference = make_busy_bus();
    assert_true(compare_quiet_bits(watched, reference, 10000, true, assert_looks_alike) > 800);
    rig_free(watched);
    rig_free(reference);
}

static void check_frame(rig *r, const cw_frame *frame)
{
    cw_bits bits;
    assert_int_equal(cw_bits_encode(&bits, frame), CW_OK);
    for (unsigned n = 0; n < bits.length; n++) {
        cw_bit_view view = next_bit(r);
        cw_place place = cw_bits_place(&bits, n);
        bool sent = cw_bits_level(&bits, n);
        bool ack = place.field == CW_FIELD_ACK_SLOT;
        assert_int_equal(view.driven, (sent ? ALL : ALL & ~NODE(0)) & (ack ? ~NODE(1) : ALL));
        assert_int_equal(view.wire, sent && !ack ? ALL : ALL & ~(NODE(0) | NODE(1)));
        assert_int_equal(view.sampled, view.wire);
        assert_int_equal(view.tx_faults | view.wire_faults | view.rx_faults, 0);
        assert_place(&view.nodes[0].place, &place);
        assert_place(&view.nodes[1].place, &place);
        assert_int_equal(view.nodes[0].role, CW_ROLE_TRANSMITTER);
        assert_int_equal(view.nodes[1].role, CW_ROLE_RECEIVER);
        assert_int_equal(view.nodes[0].phase, CW_MAC_FRAME);
        assert_int_equal(view.nodes[1].phase, CW_MAC_FRAME);
    }
}

TEST(a_frame_is_seen_as_it_was_encoded)
{
    rig_random random = {.state = 5};
    RIG *r = rig_new(2);
    start_stepping(r);
    for (unsigned i = 0; i < 60; i++) {
        cw_frame frame = rig_random_frame(&random);
        rig_send(r, 0, &frame, cw_bus_now(r->bus));
        cw_mac_phase before = i == 0 ? CW_MAC_INTEGRATING : CW_MAC_INTERMISSION;
        for (unsigned n = 0; n < (i == 0 ? JOIN : INTERMISSION_BITS); n++) {
            cw_bit_view view = next_bit(r);
            assert_int_equal(view.nodes[1].phase, before);
            assert_int_equal(view.wire & view.driven & view.sampled, ALL);
        }
        check_frame(r, &frame);
    }
    assert_int_equal(rig_stats(r, 1).rx_frames, 60);
}

/* M2: 124 loses against 123 in id[8]; in that bit it is still a transmitter. */
TEST(levels_part_where_arbitration_is_lost)
{
    RIG *r = rig_new(3);
    cw_frame low = rig_frame(0x123, 0, 1);
    cw_frame high = rig_frame(0x124, 0, 1);
    start_stepping(r);
    rig_send(r, 0, &low, 0);
    rig_send(r, 1, &high, 0);
    cw_bit_view view = bit_at(r, 1, CW_FIELD_ID, 8);
    assert_int_equal(view.driven, ALL & ~NODE(0));
    assert_int_equal(view.wire, ALL & ~(NODE(0) | NODE(1) | NODE(2)));
    assert_int_equal(view.nodes[1].role, CW_ROLE_TRANSMITTER);
    assert_int_equal(view.tx_faults | view.wire_faults | view.rx_faults, 0);
    assert_int_equal(rig_count(r, CW_EVENT_ARBITRATION_LOST, 1), 1);
    assert_int_equal(next_bit(r).nodes[1].role, CW_ROLE_RECEIVER);
}

static cw_rule *add_rule(rig *r, cw_action action)
{
    cw_rule *rule = &r->rules[r->config.rule_count++];
    *rule = (cw_rule){.name = "rule", .trigger = CW_TRIGGER_TIME, .time_end = CW_NEVER,
                      .probability = UINT64_MAX, .action = action};
    return rule;
}

/* The rule has been asked at SOF, and is not asked again when controllers take the frame back. */
TEST(a_frame_whose_rest_is_looked_at_matches_once)
{
    RIG *r = rig_new(2);
    cw_rule *rule = add_rule(r, CW_ACTION_NOISE);
    rule->trigger = CW_TRIGGER_FRAME;
    rule->probability = 1;
    rule->error_rate = UINT64_MAX;
    rule->burst_least = rule->burst_most = 1;
    rig_start(r);
    const cw_frame frame = rig_frame(0x150, 0, 0);
    rig_send(r, 1, &frame, 0);
    rig_run_bits(r, 12);
    cw_bus_set_watching(r->bus, true);
    rig_run_bits(r, 24);
    cw_bus_set_stepping(r->bus, true);
    rig_run_bits(r, 90);
    assert_int_equal(rig_stats(r, 1).tx_frames, 1);
    cw_rule_stats stats;
    assert_int_equal(cw_rule_get_stats(r->bus, 0, &stats), CW_OK);
    assert_int_equal(stats.matches, 1);
    assert_int_equal(stats.misses, 1);
}

/* M1, M6, M8: a dominant level is a SOF for those that take it as such, wherever they wait. Node 0
 * sent the last frame; passive, it owes eight bits of suspend after the three of intermission. */
TEST(a_foreign_sof_is_a_sof)
{
    static const struct {
        unsigned third_bits; /* of intermission that are dominant */
        unsigned tec;
        unsigned wait;       /* bits from the end of intermission to the frame of node 1 */
    } cases[] = {{1, 0, 0}, {1, 140, 0}, {0, 140, 0}, {0, 140, 7}, {0, 140, 8}, {0, 0, 0}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        RIG *r = rig_new(2);
        cw_frame frame = rig_frame(0x100, 0, 0);
        cw_rule *counters = add_rule(r, CW_ACTION_COUNTERS);
        counters->nodes = NODE(0);
        counters->tec = (uint16_t)cases[i].tec;
        counters->rec = CW_KEEP;
        if (cases[i].third_bits)
            (void)rig_flip(r, "third", CW_FIELD_INTERMISSION, 2);
        start_stepping(r);
        rig_send(r, 0, &frame, 0);
        (void)bit_at(r, 0, CW_FIELD_INTERMISSION, 1);
        if (!cases[i].third_bits) {
            (void)bit_at(r, 0, CW_FIELD_INTERMISSION, 2);
            rig_send(r, 1, &frame, cw_bus_now(r->bus) + cases[i].wait * BIT);
            for (unsigned n = 0; n < cases[i].wait; n++)
                assert_int_equal(next_bit(r).nodes[0].place.field,
                                 cases[i].tec && n < 8 ? CW_FIELD_SUSPEND : CW_FIELD_NONE);
        }
        cw_bit_view view = next_bit(r);
        assert_int_equal(view.nodes[0].place.field, CW_FIELD_SOF);
        assert_int_equal(view.nodes[0].phase, CW_MAC_FRAME);
        assert_int_equal(view.nodes[0].role, CW_ROLE_RECEIVER);
        assert_int_equal(view.sampled & NODE(0), 0);
        assert_int_equal(next_bit(r).nodes[0].place.field, CW_FIELD_ID);
    }
}

/* ---- Faults ---------------------------------------------------------------------------------- */

/* Bit data[0] of 11... is dominant. Node 0 sends it, nodes 1 and 2 listen. */
TEST(faults_show_where_they_act)
{
    static const struct {
        cw_rule rule;
        uint64_t driven; /* of nodes 0 to 2 */
        uint64_t wire;
        uint64_t sampled;
        uint64_t tx_faults;
        uint64_t wire_faults;
        uint64_t rx_faults;
    } cases[] = {
        {{.action = CW_ACTION_LOAD}, 6, 0, 0, 0, 0, 0},
        {{.action = CW_ACTION_FLIP}, 6, 7, 7, 0, 7, 0},
        {{.action = CW_ACTION_FLIP, .at = 4}, 6, 0, 4, 0, 0, 4},
        {{.action = CW_ACTION_FLIP, .at = 1}, 6, 0, 1, 0, 0, 1},
        {{.action = CW_ACTION_FORCE, .level = false}, 6, 0, 0, 0, 0, 0},
        {{.action = CW_ACTION_STUCK, .line = CW_LINE_TX, .level = true}, 7, 7, 7, 1, 0, 0},
        {{.action = CW_ACTION_STUCK, .line = CW_LINE_RX, .level = true}, 6, 0, 1, 0, 0, 1},
        {{.action = CW_ACTION_STUCK, .line = CW_LINE_WIRE, .level = true}, 6, 7, 7, 0, 7, 0},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        RIG *r = rig_new(3);
        cw_frame frame = rig_frame(0x555, 0, 1);
        cw_rule *rule = rig_flip(r, "rule", CW_FIELD_DATA, 0);
        rule->action = cases[i].rule.action;
        rule->at = cases[i].rule.at;
        rule->level = cases[i].rule.level;
        rule->line = cases[i].rule.line;
        if (rule->action == CW_ACTION_STUCK || rule->action == CW_ACTION_LOAD) {
            rule->trigger = CW_TRIGGER_ARMED;
            rule->manual = true;
        }
        start_stepping(r);
        rig_send(r, 0, &frame, 0);
        (void)bit_at(r, 0, CW_FIELD_DLC, 3);
        if (rule->action == CW_ACTION_STUCK)
            assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_OK);
        cw_bit_view view = next_bit(r);
        assert_int_equal(view.nodes[0].place.field, CW_FIELD_DATA);
        assert_int_equal(view.driven & 7, cases[i].driven);
        assert_int_equal(view.wire & 7, cases[i].wire);
        assert_int_equal(view.sampled & 7, cases[i].sampled);
        assert_int_equal(view.tx_faults, cases[i].tx_faults);
        assert_int_equal(view.wire_faults, cases[i].wire_faults);
        assert_int_equal(view.rx_faults, cases[i].rx_faults);
    }
}

TEST(a_partitioned_bus_has_several_wires)
{
    RIG *r = rig_new(4);
    cw_frame frame = rig_frame(0x555, 0, 1);
    cw_rule *rule = add_rule(r, CW_ACTION_PARTITION);
    rule->time_begin = 5 * BIT;
    rule->for_ticks = 200 * BIT;
    rule->group[1] = rule->group[3] = 1;
    start_stepping(r);
    rig_send(r, 1, &frame, 0);
    cw_bit_view view = {.start = 0};
    for (unsigned n = 0; n < 5; n++) {
        view = next_bit(r);
        assert_int_equal(view.wire_count, 1);
    }
    view = next_bit(r);
    assert_int_equal(view.wire_count, 2);
    view = bit_at(r, 1, CW_FIELD_SOF, 0);
    assert_int_equal(view.wire_count, 2);
    assert_int_equal(view.wire, ALL & ~(NODE(1) | NODE(3)));
    assert_int_equal(view.sampled, view.wire);
    for (unsigned i = 0; i < 4; i++)
        assert_int_equal(view.nodes[i].wire, i % 2);
    assert_int_equal(view.wire_faults, 0);
    assert_int_equal(view.nodes[3].place.field, CW_FIELD_SOF);
    assert_int_equal(view.nodes[2].phase, CW_MAC_IDLE);
    rig_run_bits(r, 300);
    assert_int_equal(next_bit(r).wire_count, 1);
}

/* Nodes that are not there are recessive and without faults, whatever happens to the wire. */
TEST(only_nodes_have_faults)
{
    static const unsigned counts[] = {1, 2, 63, 64};
    for (size_t i = 0; i < sizeof counts / sizeof counts[0]; i++) {
        RIG *r = rig_new(counts[i]);
        cw_rule *rule = add_rule(r, CW_ACTION_STUCK);
        uint64_t nodes = ALL >> (64 - counts[i]);
        rule->time_begin = 2 * BIT;
        start_stepping(r);
        assert_int_equal(next_bit(r).wire, ALL);
        (void)next_bit(r);
        cw_bit_view view = next_bit(r);
        assert_int_equal(view.node_count, counts[i]);
        assert_int_equal(view.driven, ALL);
        assert_int_equal(view.wire, ~nodes);
        assert_int_equal(view.sampled, ~nodes);
        assert_int_equal(view.wire_faults, nodes);
        assert_int_equal(view.tx_faults | view.rx_faults, 0);
    }
}

/* A node that is cut off amid its frame drives nothing from that bit on. */
TEST(a_disconnected_node_is_off)
{
    RIG *r = rig_new(2);
    cw_frame frame = rig_frame(0x555, 0, 1);
    cw_rule *rule = add_rule(r, CW_ACTION_DISCONNECT);
    rule->nodes = NODE(0);
    rule->time_begin = (JOIN + 15) * BIT;
    start_stepping(r);
    rig_send(r, 0, &frame, 0);
    cw_bit_view view = bit_at(r, 0, CW_FIELD_R0, 0);
    assert_int_equal(view.driven, ALL & ~NODE(0));
    view = next_bit(r);
    assert_int_equal(view.nodes[0].phase, CW_MAC_OFF);
    assert_int_equal(view.nodes[0].place.field, CW_FIELD_NONE);
    assert_int_equal(view.driven, ALL);
    assert_int_equal(view.tx_faults, 0);
    assert_int_equal(view.nodes[1].place.field, CW_FIELD_DLC);
}

/* Cut off by its own SOF, which it has begun to send. */
TEST(a_node_may_be_disconnected_amid_a_bit)
{
    RIG *r = rig_new(2);
    cw_frame frame = rig_frame(0x555, 0, 1);
    cw_rule *rule = add_rule(r, CW_ACTION_DISCONNECT);
    rule->trigger = CW_TRIGGER_FRAME;
    rule->nodes = NODE(0);
    start_stepping(r);
    rig_send(r, 0, &frame, JOIN * BIT);
    rig_run_bits(r, JOIN);
    cw_bit_view view = next_bit(r);
    assert_int_equal(view.nodes[0].phase, CW_MAC_OFF);
    assert_int_equal(view.tx_faults, NODE(0));
    assert_int_equal(view.driven & view.wire, ALL);
    assert_int_equal(next_bit(r).tx_faults, 0);
}

/* ---- Modes, counters ------------------------------------------------------------------------- */

/* M11: its dominant ACK stays inside the listener, which still samples the bit as dominant. */
TEST(a_listener_takes_its_own_ack)
{
    RIG *r = rig_new(2);
    cw_frame frame = rig_frame(0x555, 0, 1);
    r->nodes[1].modes = CW_MODE_LISTEN_ONLY;
    start_stepping(r);
    rig_send(r, 0, &frame, 0);
    cw_bit_view view = bit_at(r, 1, CW_FIELD_ACK_SLOT, 0);
    assert_int_equal(view.driven & view.wire, ALL);
    assert_int_equal(view.sampled, ALL & ~NODE(1));
    assert_int_equal(view.tx_faults | view.wire_faults | view.rx_faults, 0);
}

/* M15. */
TEST(loopback_takes_its_own_bits)
{
    RIG *r = rig_new(2);
    cw_frame frame = rig_frame(0x555, 0, 1);
    r->nodes[0].modes = CW_MODE_LOOPBACK;
    start_stepping(r);
    rig_send(r, 0, &frame, 0);
    cw_bit_view view = bit_at(r, 0, CW_FIELD_SOF, 0);
    assert_int_equal(view.driven & view.wire, ALL);
    assert_int_equal(view.sampled, ALL & ~NODE(0));
    assert_int_equal(view.tx_faults | view.wire_faults | view.rx_faults, 0);
    assert_int_equal(view.nodes[1].phase, CW_MAC_IDLE);
}

/* R3, R9: counters and state are those after the bit. */
TEST(counters_are_those_after_the_bit)
{
    RIG *r = rig_new(2);
    cw_frame frame = rig_frame(0x555, 0, 1);
    cw_rule *rule = add_rule(r, CW_ACTION_COUNTERS);
    rule->nodes = NODE(0);
    rule->tec = 120;
    rule->rec = CW_KEEP;
    (void)rig_flip(r, "flip", CW_FIELD_DATA, 3);
    start_stepping(r);
    rig_send(r, 0, &frame, 0);
    cw_bit_view view = bit_at(r, 0, CW_FIELD_DATA, 2);
    assert_int_equal(view.nodes[0].tec, 120);
    assert_int_equal(view.nodes[0].state, CW_STATE_ERROR_WARNING);
    view = bit_at(r, 0, CW_FIELD_DATA, 3);
    assert_int_equal(view.nodes[0].tec, 128);
    assert_int_equal(view.nodes[0].state, CW_STATE_ERROR_PASSIVE);
    assert_int_equal(view.nodes[0].phase, CW_MAC_FRAME);
    view = next_bit(r);
    assert_int_equal(view.nodes[0].phase, CW_MAC_ERROR_ACTIVE);
    assert_int_equal(view.nodes[0].place.field, CW_FIELD_ERROR_FLAG);
    assert_int_equal(view.driven & NODE(0), 0);
    view = bit_at(r, 1, CW_FIELD_ERROR_FLAG, 0);
    assert_int_equal(view.nodes[1].rec, 1);
}
