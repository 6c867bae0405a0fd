/* SPDX-License-Identifier: MIT
 *
 * test_rates.c - FD frames at two rates on the bus (D10 to D13). It looks at the lengths of bits,
 * at delays and rates that do not fit, at changes while the bus runs, and at statistics.
 */
#include "rig.h"
#include "rules.h"

#define NS_TICKS(ns) ((ns) * 2u / 25u)

/* 500 kbit/s and 2 Mbit/s, both sampled at 80 %, with 40 quanta and 10. */
static const cw_bit_timing nominal = {.quantum = 4 * CW_TICK, .prop_seg = 23, .phase_seg1 = 8,
                                      .phase_seg2 = 8, .sjw = 8};
static const cw_data_timing fast = {.brp = 4, .data_brp = 4,
                                    .bit = {.prop_seg = 5, .phase_seg1 = 2, .phase_seg2 = 2,
                                            .sjw = 2}};

/* 5 Mbit/s with 16 quanta of a clock, sampled at 75 %, so 150 ns after the begin. */
static const cw_data_timing faster = {.brp = 4, .data_brp = 1,
                                      .bit = {.prop_seg = 5, .phase_seg1 = 6, .phase_seg2 = 4,
                                              .sjw = 4}};

static rig *rig_of(unsigned nodes, const cw_data_timing *data)
{
    rig *r = rig_new(nodes);
    r->config.bit_ticks = 160;
    for (unsigned i = 0; i < nodes; i++) {
        r->nodes[i].protocol = CW_FD;
        r->nodes[i].timing.bit = nominal;
        r->nodes[i].timing.data = *data;
    }
    return r;
}

static void go_on(rig *r, unsigned bits)
{
    rig_run(r, cw_bus_now(r->bus) + bits * 160u);
}

static cw_frame frame_of(unsigned bytes)
{
    cw_frame f = rig_frame(0x123, CW_FRAME_FD | CW_FRAME_BRS, cw_fd_dlc(bytes));
    for (unsigned i = 0; i < bytes; i++)
        f.data[i] = (uint8_t)(i * 37u + 11u);
    return f;
}

static cw_data_stats data_stats(const rig *r, unsigned node)
{
    cw_data_stats s;
    assert_int_equal(cw_node_get_data_stats(r->bus, node, &s), CW_OK);
    return s;
}

/* ---- How long bits last ---------------------------------------------------------------------- */

/* Returns the ticks of a bit of the wire, by its place. */
static uint64_t expected_ticks(cw_place place, bool in_data_phase)
{
    if (place.field == CW_FIELD_BRS)
        return NS_TICKS(1700);
    if (place.field == CW_FIELD_CRC_DELIMITER)
        return NS_TICKS(800);
    return in_data_phase ? NS_TICKS(500) : NS_TICKS(2000);
}

TEST(bits_are_nominal_fast_or_mixed)
{
    RIG *r = rig_of(3, &fast);
    const cw_frame f = frame_of(64);
    unsigned seen[CW_FIELD_COUNT] = {0};
    cw_bit_view view;
    rig_start(r);
    cw_bus_set_watching(r->bus, true);
    rig_send(r, 0, &f, 0);
    for (uint64_t end = 0, bits = 0; bits < 700; bits++) {
        assert_int_equal(cw_bus_advance(r->bus, cw_bus_tick_after(r->bus, 1)), CW_OK);
        assert_int_equal(cw_bus_get_bit(r->bus, &view), CW_OK);
        assert_int_equal(view.start, end);
        assert_true(view.fast == 0 || view.fast == 7);
        assert_int_equal(view.end - view.start,
                         expected_ticks(view.nodes[0].place, view.fast != 0));
        seen[view.nodes[0].place.field] += view.nodes[0].place.stuff ? 0 : 1;
        end = view.end;
    }
    assert_int_equal(seen[CW_FIELD_BRS], 1);
    assert_int_equal(seen[CW_FIELD_DATA], 512);
    assert_int_equal(seen[CW_FIELD_CRC], 21);
}

/* The closed formula: nominal bits outside, data bits inside, and one of each in the two mixed
 * ones. */
static uint64_t ticks_of(const cw_frame *f)
{
    cw_bits bits;
    unsigned inside = 0;
    assert_int_equal(cw_bits_encode(&bits, f), CW_OK);
    for (unsigned n = 0; n < bits.length; n++)
        inside += cw_bits_is_fast(&bits, n);
    return (bits.length - inside - 1) * 160 + (inside + 1) * 40;
}

TEST(a_frame_lasts_as_long_as_its_bits)
{
    RIG *r = rig_of(2, &fast);
    rig_random random = {.state = 7};
    uint64_t data_ticks = 0;
    rig_start(r);
    go_on(r, 20);
    for (unsigned k = 0; k < 200; k++) {
        cw_frame f = frame_of(rig_below(&random, 65));
        f.flags |= k % 2 ? CW_FRAME_EXTENDED : 0;
        f.id = rig_next(&random) & (k % 2 ? CW_EXTENDED_ID_MAX : CW_BASE_ID_MAX);
        for (unsigned i = 0; i < 64; i++)
            f.data[i] = (uint8_t)(k % 3 ? rig_next(&random) : 0);
        const uint64_t begin = cw_bus_now(r->bus);
        rig_send(r, k % 2, &f, begin);
        rig_run(r, begin + ticks_of(&f) + 10 * 160);
        assert_int_equal(rig_count(r, CW_EVENT_TX, -1), k + 1);
        assert_int_equal(rig_nth(r, CW_EVENT_TX, k)->tick, begin + ticks_of(&f));
        const cw_bus_stats s = rig_bus_stats(r);
        assert_true(s.data_ticks > data_ticks);
        assert_int_equal(s.busy_ticks, s.busy_bits * 160 - s.data_bits * 120);
        data_ticks = s.data_ticks;
    }
    assert_int_equal(rig_bus_stats(r).fd_frames, 200);
}

/* ---- Delays ---------------------------------------------------------------------------------- */

/* Returns a rig whose loop has a delay of 200 ns: longer than up to the data sample point. */
static rig *rig_delayed(const cw_tdc *tdc)
{
    cw_data_timing data = faster;
    data.tdc = *tdc;
    rig *r = rig_of(2, &data);
    for (unsigned i = 0; i < 2; i++)
        for (unsigned level = 0; level < 2; level++) {
            r->nodes[i].timing.tx_delay[level] = NS_TICKS(100) * CW_TICK;
            r->nodes[i].timing.rx_delay[level] = NS_TICKS(100) * CW_TICK;
        }
    rig_start(r);
    return r;
}

TEST(a_loop_longer_than_the_sample_point_needs_compensation)
{
    const cw_tdc off = {.mode = CW_TDC_OFF}, automatic = {.mode = CW_TDC_AUTO, .tdco = 12};
    const cw_frame f = frame_of(16);
    RIG *r = rig_delayed(&off);
    rig_send(r, 0, &f, 0);
    go_on(r, 200);
    const cw_event *e = rig_nth(r, CW_EVENT_ERROR, 0);
    assert_int_equal(e->error.type, CW_ERROR_BIT);
    assert_int_equal(e->error.role, CW_ROLE_TRANSMITTER);
    assert_int_equal(e->error.place.field, CW_FIELD_ESI);
    assert_true(e->fast);
    assert_true(data_stats(r, 0).errors[CW_ERROR_BIT] > 0);
    assert_int_equal(data_stats(r, 0).errors[CW_ERROR_BIT], rig_stats(r, 0).errors[CW_ERROR_BIT]);
    rig_free(r);

    r = rig_delayed(&automatic);
    for (unsigned k = 0; k < 16; k++) { /* some end with a dominant CRC bit */
        cw_frame other = f;
        other.data[3] = (uint8_t)k;
        rig_send(r, 0, &other, 0);
    }
    go_on(r, 1600);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 16);
    assert_int_equal(data_stats(r, 0).tdcv, NS_TICKS(200));
}

/* D13: tdcv is whole clocks before the one in which the edge is seen. It is 0 without delay, and a
 * look at 0 is taken after one clock (T12). With no offset it finds the own level in any case. */
TEST(the_measured_delay_is_in_whole_clocks)
{
    static const struct {
        cw_span way; /* from the controller to itself */
        unsigned clocks;
    } cases[] = {{0, 0},
                 {1, 0},
                 {CW_TICK - 1, 0},
                 {CW_TICK, 1}, /* it is seen behind the moment of the edge */
                 {CW_TICK + 1, 1},
                 {10 * CW_TICK - 1, 9},
                 {10 * CW_TICK + CW_TICK / 2, 10}};
    for (unsigned i = 0; i < 2 * sizeof cases / sizeof cases[0]; i++) {
        const unsigned clocks = cases[i / 2].clocks;
        cw_data_timing data = faster;
        data.tdc = i & 1 ? (cw_tdc){.mode = CW_TDC_MANUAL, .tdcv = clocks, .tdco = clocks > 0}
                         : (cw_tdc){.mode = CW_TDC_AUTO, .tdco = clocks > 0};
        const cw_frame f = frame_of(16);
        RIG *r = rig_of(2, &data);
        r->nodes[0].timing.rx_delay[0] = r->nodes[0].timing.rx_delay[1] = cases[i / 2].way;
        rig_start(r);
        cw_bus_set_own_clocks(r->bus, true);
        rig_send(r, 0, &f, 0);
        go_on(r, 400);
        assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
        assert_int_equal(data_stats(r, 0).tdcv, clocks);
    }
}

TEST(without_brs_the_delay_does_not_matter)
{
    const cw_tdc off = {.mode = CW_TDC_OFF};
    RIG *r = rig_delayed(&off);
    cw_frame f = frame_of(16);
    f.flags &= (uint8_t)~CW_FRAME_BRS;
    rig_send(r, 0, &f, 0);
    go_on(r, 400);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
    assert_int_equal(rig_bus_stats(r).data_bits, 0);
}

/* ---- Rates that differ, and changes ---------------------------------------------------------- */

TEST(a_node_at_another_data_rate_destroys_what_it_reads)
{
    RIG *r = rig_of(3, &fast);
    r->nodes[2].timing.data.bit.phase_seg2 = 4; /* 12 quanta */
    const cw_frame f = frame_of(32);
    cw_frame slow = f;
    slow.flags &= (uint8_t)~CW_FRAME_BRS;
    rig_start(r);
    rig_send(r, 0, &slow, 0);
    go_on(r, 600);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
    rig_send(r, 0, &f, cw_bus_now(r->bus));
    go_on(r, 400);
    const cw_event *e = rig_nth(r, CW_EVENT_ERROR, 0);
    assert_int_equal(e->nodes, 4);
    assert_true(e->fast);
}

TEST(the_data_phase_changes_while_the_bus_runs)
{
    RIG *r = rig_of(2, &fast);
    const cw_frame f = frame_of(8);
    cw_settings s = {.which = CW_SET_DATA, .data = fast}, now;
    rig_start(r);
    rig_send(r, 0, &f, 0);
    go_on(r, 200);
    s.data.data_brp = 2;
    s.data.bit = (cw_bit_timing){.prop_seg = 6, .phase_seg1 = 9, .phase_seg2 = 4, .sjw = 2};
    for (unsigned i = 0; i < 2; i++) /* the same bits as before, by other quanta */
        assert_int_equal(cw_node_set(r->bus, i, &s), CW_OK);
    assert_int_equal(cw_node_get_settings(r->bus, 0, &now), CW_OK);
    assert_true(now.which & CW_SET_DATA);
    assert_int_equal(now.data.data_brp, 2);
    rig_send(r, 1, &f, cw_bus_now(r->bus));
    go_on(r, 200);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 2);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
    assert_true(cw_bus_config_takes(&r->config, 0, &s));
    s.data.brp = 0;
    assert_false(cw_bus_config_takes(&r->config, 0, &s));
    assert_int_equal(cw_node_set(r->bus, 0, &s), CW_INVALID);
}

/* Returns the tick at which the first node that misses an acknowledgement says so. The other one
 * comes onto the bus at a tick, in the data phase, and synchronises to what it sees there. */
static uint64_t second_error(uint64_t tick, bool stepping, uint64_t *end)
{
    RIG *r = rig_of(2, &fast);
    const cw_frame f = frame_of(3);
    rig_start(r);
    cw_bus_set_stepping(r->bus, stepping);
    assert_int_equal(cw_node_attach(r->bus, 1, false), CW_OK);
    rig_send(r, 0, &f, 20 * 160);
    rig_run(r, tick);
    assert_int_equal(cw_node_attach(r->bus, 1, true), CW_OK);
    rig_run(r, 130 * 160);
    *end = cw_bus_now(r->bus);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, 0), 2);
    const uint64_t second = rig_nth(r, CW_EVENT_ERROR, 1)->tick;
    return second;
}

TEST(a_node_comes_onto_the_bus_in_the_data_phase)
{
    uint64_t end, reference_end;
    for (uint64_t tick = 80 * 160; tick < 115 * 160; tick += 8) {
        const uint64_t reference = second_error(tick, true, &reference_end);
        assert_int_equal(second_error(tick, false, &end), reference);
        assert_int_equal(end, reference_end);
    }
}

/* Returns the tick at which the next frame of a sender is over that is taken out of its frame at a
 * tick. It is to send the frame at the bits that it found by the error flag of the other node. */
static uint64_t next_sent(uint64_t tick, bool stepping)
{
    RIG *r = rig_of(2, &fast);
    const cw_frame f = frame_of(64);
    cw_settings s = {.which = CW_SET_MODES, .modes_mask = CW_MODE_LISTEN_ONLY,
                     .modes = CW_MODE_LISTEN_ONLY};
    rig_start(r);
    cw_bus_set_stepping(r->bus, stepping);
    rig_send(r, 0, &f, 20 * 160);
    rig_run(r, tick);
    assert_int_equal(cw_node_set(r->bus, 0, &s), CW_OK);
    rig_run(r, 230 * 160);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, 1), 1);
    s.modes = 0;
    assert_int_equal(cw_node_set(r->bus, 0, &s), CW_OK);
    rig_send(r, 0, &f, 260 * 160);
    rig_run(r, 500 * 160);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
    const uint64_t sent = rig_nth(r, CW_EVENT_TX, 0)->tick;
    return sent;
}

/* From then on edges move it (D12): it is no transmitter any more. */
TEST(a_sender_that_leaves_the_data_phase_synchronises)
{
    for (uint64_t tick = 55 * 160; tick < 110 * 160; tick += 56)
        assert_int_equal(next_sent(tick, false), next_sent(tick, true));
}

TEST(a_faster_clock_is_faster_at_both_rates)
{
    RIG *r = rig_of(2, &fast);
    cw_settings s = {.which = CW_SET_QUANTUM, .timing = nominal};
    s.timing.quantum = nominal.quantum / 1000 * 997;
    const cw_frame f = frame_of(64);
    rig_start(r);
    for (unsigned i = 0; i < 2; i++)
        assert_int_equal(cw_node_set(r->bus, i, &s), CW_OK);
    go_on(r, 50);
    rig_send(r, 0, &f, cw_bus_now(r->bus));
    go_on(r, 1000);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
    const uint64_t between = rig_nth(r, CW_EVENT_TX, 0)->tick - rig_nth(r, CW_EVENT_RX, 0)->tick;
    assert_int_equal(between, 160); /* 159.5, and the ticks are whole */
}

TEST(buses_without_a_data_rate_have_no_data_statistics)
{
    static const cw_data_timing none = {.data_brp = 0};
    RIG *r = rig_of(2, &none);
    cw_data_stats s;
    const cw_settings settings = {.which = CW_SET_DATA, .data = fast};
    rig_start(r);
    assert_int_equal(cw_node_get_data_stats(r->bus, 0, &s), CW_REFUSED);
    assert_int_equal(cw_node_get_data_stats(r->bus, 2, &s), CW_INVALID);
    assert_int_equal(cw_node_set(r->bus, 0, &settings), CW_INVALID);
    assert_false(cw_bus_config_takes(&r->config, 0, &settings));
}

TEST(wrong_values_are_refused)
{
    cw_data_timing bad[] = {fast, fast, fast, fast};
    bad[0].brp = 0;
    bad[1].data_brp = 65537;
    bad[2].bit.phase_seg2 = 0;
    bad[3].tdc = (cw_tdc){.mode = CW_TDC_MANUAL, .tdcv = 40 * CW_TDC_BITS_MAX};
    for (unsigned i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        rig *r = rig_of(2, &bad[i]);
        r->config.nodes = r->nodes;
        assert_int_equal(cw_bus_size(&r->config), 0);
        free(r);
    }
}

/* ---- Rules in the data phase ----------------------------------------------------------------- */

/* Sends a frame whose data is recessive. Returns the bits of a field, without stuff bits, that node
 * 2 takes for other ones. Bit 0 of the result is the first bit. */
static uint64_t wrong_bits(const cw_rule *rule, cw_field field, bool stepping)
{
    RIG *r = rig_of(3, &fast);
    cw_frame f = frame_of(64);
    uint64_t wrong = 0;
    memset(f.data, 0xFF, sizeof f.data);
    (void)rig_rule(r, *rule);
    rig_start(r);
    cw_bus_set_watching(r->bus, true);
    cw_bus_set_stepping(r->bus, stepping);
    rig_send(r, 0, &f, 0);
    for (cw_bit_view view; cw_bus_now(r->bus) < 220 * 160;) {
        assert_int_equal(cw_bus_advance(r->bus, cw_bus_tick_after(r->bus, 1)), CW_OK);
        assert_int_equal(cw_bus_get_bit(r->bus, &view), CW_OK);
        const cw_place place = view.nodes[0].place;
        const bool same = (view.sampled & 1u) == (view.sampled >> 2 & 1u);
        if (place.field == field && !place.stuff && !same)
            wrong |= UINT64_C(1) << place.index;
    }
    return wrong;
}

static cw_rule rule_on_data(cw_action action)
{
    cw_rule rule = new_rule("data", CW_TRIGGER_FRAME, action);
    rule.field = CW_FIELD_DATA;
    rule.level = CW_DOMINANT;
    rule.at = NODE(2);
    return rule;
}

/* A time is as long in the data phase as elsewhere: so many more bits begin in it. The second one
 * is a stuff bit, behind a DLC of 15. */
TEST(a_level_is_forced_for_a_time)
{
    static const struct {
        uint64_t ns;
        uint64_t bits;
    } cases[] = {{1, 0x1}, {1000, 0x1}, {1013, 0x3}, {2000, 0x7}, {2013, 0xF}};
    for (unsigned i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        cw_rule rule = rule_on_data(CW_ACTION_FORCE);
        rule.for_ticks = (cases[i].ns + 12) * 2 / 25;
        assert_int_equal(wrong_bits(&rule, CW_FIELD_DATA, false), cases[i].bits);
        assert_int_equal(wrong_bits(&rule, CW_FIELD_DATA, true), cases[i].bits);
    }
}

/* The CRC delimiter begins at the one rate and ends at the other. */
TEST(a_time_goes_by_both_rates)
{
    cw_rule rule = rule_on_data(CW_ACTION_FORCE);
    rule.field = CW_FIELD_CRC_DELIMITER;
    rule.level = CW_RECESSIVE;
    rule.for_ticks = NS_TICKS(800);
    assert_int_equal(wrong_bits(&rule, CW_FIELD_ACK_SLOT, false), 0);
    rule.for_ticks++;
    assert_int_equal(wrong_bits(&rule, CW_FIELD_ACK_SLOT, false), 1);
    rule.for_ticks = NS_TICKS(2000);
    assert_int_equal(wrong_bits(&rule, CW_FIELD_ACK_SLOT, false), 1);
}

/* The transmitter does not synchronise in the data phase (D12): the pulse meets its sample point at
 * 80 % of the first data bit. */
TEST(a_part_of_a_bit_is_one_of_that_bit)
{
    RIG *r = rig_of(3, &fast);
    cw_frame f = frame_of(64);
    cw_rule *rule = rig_rule(r, rule_on_data(CW_ACTION_PULSE));
    f.data[0] = 0xFF;
    rule->at = 0;
    rule->pulse_permille = 600;
    rule->pulse_length = NS_TICKS(200) * CW_TICK;
    rig_start(r);
    rig_send(r, 0, &f, 0);
    go_on(r, 300);
    const cw_error e = rig_nth(r, CW_EVENT_ERROR, 0)->error;
    assert_int_equal(e.type, CW_ERROR_BIT);
    assert_int_equal(e.place.field, CW_FIELD_DATA);
    assert_int_equal(e.place.index, 0);
}

/* The load is one of time: a frame of 64 bytes has many bits that are short. */
TEST(a_load_counts_time)
{
    RIG *r = rig_of(2, &fast);
    ADD_RULE(r, "own", TIME, SEND, .frame = frame_of(64), .period_ticks = NS_TICKS(1000000));
    ADD_RULE(r, "load", TIME, LOAD, .load_permille = 500, .node = 1);
    rig_start(r);
    go_on(r, 500000);
    const cw_bus_stats s = rig_bus_stats(r);
    assert_in_range(s.data_bits * 1000 / s.bits, 200, 1000);
    assert_in_range(s.busy_ticks * 1000 / s.ticks, 499, 501);
    assert_in_range(s.load_permille, 495, 505);
}
