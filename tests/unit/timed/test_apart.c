/* SPDX-License-Identifier: MIT
 *
 * test_apart.c - what comes out on a bus whose nodes have clocks, sample points and places of their
 * own (T2 to T11). Each expectation follows from the bit timing alone.
 */
#include "rig.h"

#define NS (CW_TICK * 2 / 25)
#define METRE (5 * NS)
#define FRAMES 50u
#define MILLION 1000000

/* Returns a bit timing with a quantum of so many nanoseconds. */
static cw_bit_timing timing_of(unsigned ns, unsigned prop, unsigned seg1, unsigned seg2,
                               unsigned sjw)
{
    return (cw_bit_timing){.quantum = ns * NS, .prop_seg = (uint16_t)prop,
                           .phase_seg1 = (uint16_t)seg1, .phase_seg2 = (uint16_t)seg2,
                           .sjw = (uint16_t)sjw};
}

static rig *rig_apart(unsigned nodes, const cw_bit_timing *timing)
{
    rig *r = rig_new(nodes);
    const cw_span bit = timing->quantum * cw_bit_timing_quanta(timing);
    r->config.bit_ticks = (uint32_t)((bit + CW_TICK / 2) / CW_TICK);
    for (unsigned i = 0; i < nodes; i++) {
        r->nodes[i].timing.bit = *timing;
        r->nodes[i].queue = FRAMES;
    }
    return r;
}

/* Hands frames to a node. Each second one has edges ten bits apart, the most that there can be. */
static void send_frames(rig *r, unsigned node, unsigned count, unsigned id)
{
    for (unsigned k = 0; k < count; k++) {
        cw_frame f = rig_frame(id + (uint32_t)cw_random(k, "id", 0) % 64, 0, 8);
        for (unsigned i = 0; i < 8; i++)
            f.data[i] = (uint8_t)(k % 2 ? cw_random(k, "data", i) : 0x0F0Fu >> (k / 2) % 8);
        rig_send(r, node, &f, 0);
    }
}

static void run_bits(rig *r, uint64_t bits)
{
    rig_run(r, bits * r->config.bit_ticks);
}

/* ---- Two clocks (T10, T11) ------------------------------------------------------------------- */

/* Returns true when all frames come over although the receiver's quantum is longer by so many
 * millionths. They begin with an identifier. */
static bool stands_with(const cw_bit_timing *timing, int64_t millionths, unsigned id)
{
    rig *r = rig_apart(2, timing);
    r->nodes[1].timing.bit.quantum += timing->quantum / MILLION * millionths;
    rig_start(r);
    send_frames(r, 0, FRAMES, id);
    run_bits(r, FRAMES * 150u);
    const bool all = rig_count(r, CW_EVENT_RX, 1) == FRAMES;
    const bool clean = rig_count(r, CW_EVENT_ERROR, -1) == 0;
    rig_free(r);
    return all && clean;
}

static bool stands(const cw_bit_timing *timing, int64_t millionths)
{
    for (unsigned id = 0x100; id < 0x700; id += 0x111)
        if (!stands_with(timing, millionths, id))
            return false;
    return true;
}

static const struct {
    const char *name;
    unsigned ns, prop, seg1, seg2, sjw;
    double slow, fast; /* percent: the first difference that fails */
} pairs[] = {
    {"1M 6-1-2/1", 100, 6, 1, 2, 1, 1.15, 1.15},
    {"500k 4-5-6/4", 125, 4, 5, 6, 4, 2.75, 2.83},
    {"125k 11-2-2/2", 500, 11, 2, 2, 2, 1.27, 0.73},
    {"50k 11-4-4/4", 1000, 11, 4, 4, 4, 2.05, 1.71},
    {"100k 1-4-4/4", 1000, 1, 4, 4, 4, 4.17, 3.39},
};

#define STEP 300 /* millionths */

/* Returns the first difference that fails, in millionths, from one on that must not fail. */
static int64_t first_that_fails(const cw_bit_timing *timing, int sign, int64_t millionths)
{
    assert_true(stands(timing, sign * millionths));
    while (stands(timing, sign * millionths))
        millionths += STEP;
    return millionths;
}

/* Checks that the first difference that fails is about the one that is expected. */
static void check_pair(unsigned i, double percent, int sign)
{
    const cw_bit_timing t = timing_of(pairs[i].ns, pairs[i].prop, pairs[i].seg1, pairs[i].seg2,
                                      pairs[i].sjw);
    const int64_t from = (int64_t)(percent * 0.8 * MILLION / 100);
    const double found = (double)first_that_fails(&t, sign, from) * 100 / MILLION;
    if (found < percent * 0.9 || found > percent * 1.07)
        fail_msg("%s: %+.2f %% fails first, not about %+.2f %%", pairs[i].name, sign * found,
                 sign * percent);
}

TEST(two_clocks_fail_where_the_phase_error_says)
{
    for (unsigned i = 0; i < sizeof pairs / sizeof pairs[0]; i++) {
        check_pair(i, pairs[i].slow, 1);
        check_pair(i, pairs[i].fast, -1);
    }
}

/* ---- Places (T2, T10) ------------------------------------------------------------------------ */

/* Runs two nodes at the ends of a line. Transceivers and controllers take 100 ns. */
static rig *rig_on_line(const cw_bit_timing *timing, unsigned metres)
{
    rig *r = rig_apart(2, timing);
    for (unsigned i = 0; i < 2; i++)
        for (unsigned level = 0; level < 2; level++)
            r->nodes[i].timing.tx_delay[level] = r->nodes[i].timing.rx_delay[level] = 50 * NS;
    r->nodes[1].timing.place = metres * METRE;
    return r;
}

/* The acknowledgement must be back before the sample point. The receiver leads by up to a quantum.
 * 1 Mbit/s reaches 40 m, 125 kbit/s 500 m, 50 kbit/s 1000 m. */
TEST(a_line_too_long_breaks_the_acknowledgement)
{
    static const struct {
        unsigned quarter_ns, prop, seg1, seg2, sjw, metres;
    } lines[] = {{250, 10, 2, 3, 2, 40}, {2000, 11, 2, 2, 2, 500}, {4000, 11, 4, 4, 4, 1000}};
    for (unsigned i = 0; i < sizeof lines / sizeof lines[0]; i++) {
        cw_bit_timing t = timing_of(1, lines[i].prop, lines[i].seg1, lines[i].seg2, lines[i].sjw);
        t.quantum = lines[i].quarter_ns * NS / 4;
        const cw_span to_sample = t.quantum * cw_bit_timing_sample_at(&t);
        const unsigned ends = (unsigned)((to_sample / 2 - 100 * NS) / METRE);
        const unsigned quantum = (unsigned)(t.quantum / 2 / METRE);
        const unsigned metres[] = {lines[i].metres, ends - 1, ends + quantum + 2};
        for (unsigned k = 0; k < 3; k++) {
            RIG *r = rig_on_line(&t, metres[k]);
            rig_start(r);
            send_frames(r, 0, 4, 0x200);
            run_bits(r, 900);
            if (k < 2) {
                assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
                assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 4);
            } else {
                assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 0);
                assert_int_equal(rig_nth(r, CW_EVENT_ERROR, 0)->error.type, CW_ERROR_ACK);
            }
        }
    }
}

/* Two contenders are at the ends of a line. The dominant bit of the far one comes after the sample
 * point of the near one, which finds an error, or loses too late. */
TEST(contenders_on_a_line_too_long_find_bit_errors)
{
    cw_bit_timing t = timing_of(1, 10, 2, 3, 2);
    t.quantum = 250 * NS / 4;
    for (unsigned k = 0; k < 2; k++) {
        RIG *r = rig_on_line(&t, k ? 140 : 40);
        rig_start(r);
        send_frames(r, 0, 3, 0x300);
        send_frames(r, 1, 3, 0x200);
        run_bits(r, 1500);
        if (k == 0) {
            assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
            assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 6);
        } else {
            assert_true(rig_count(r, CW_EVENT_ERROR, -1) > 0);
            assert_int_equal(rig_count(r, CW_EVENT_TX, -1), 0);
        }
    }
}

/* ---- Sample points --------------------------------------------------------------------------- */

static cw_rule *add_rule(rig *r, const char *name, cw_trigger trigger, cw_action action)
{
    cw_rule *rule = &r->rules[r->config.rule_count++];
    *rule = (cw_rule){.name = name, .trigger = trigger, .action = action, .every = 1,
                      .time_end = CW_NEVER, .probability = UINT64_MAX};
    return rule;
}

/* A bit that is disturbed from 80 % on is right for who samples at 75 %, and wrong for who samples
 * at 87.5 %. That node alone finds the error; its flag tells the others. */
TEST(a_late_disturbance_is_seen_by_late_sample_points)
{
    const cw_bit_timing early = timing_of(125, 6, 5, 4, 2), late = timing_of(125, 6, 7, 2, 2);
    RIG *r = rig_apart(3, &early);
    r->nodes[2].timing.bit = late;
    cw_rule *p = add_rule(r, "spike", CW_TRIGGER_FRAME, CW_ACTION_PULSE);
    p->level = CW_DOMINANT;
    p->field = CW_FIELD_CRC_DELIMITER;
    p->pulse_permille = 800;
    p->pulse_length = 160 * NS;
    p->count = 1;
    rig_start(r);
    send_frames(r, 0, 1, 0x123);
    run_bits(r, 500);
    const cw_event *first = rig_nth(r, CW_EVENT_ERROR, 0);
    assert_int_equal(first->nodes, NODE(2));
    assert_int_equal(first->error.type, CW_ERROR_FORM);
    assert_int_equal(first->error.place.field, CW_FIELD_CRC_DELIMITER);
    assert_int_equal(rig_stats(r, 0).errors[CW_ERROR_FORM], 1); /* the flag, after an ACK */
    assert_int_equal(rig_stats(r, 0).tx_frames, 1);            /* the second attempt */
    assert_int_equal(rig_stats(r, 1).rx_frames, 1);
}

/* T9: in idle a pulse is an edge, but no frame when the sample is recessive again. */
TEST(a_pulse_in_idle_is_no_frame)
{
    const cw_bit_timing t = timing_of(125, 6, 7, 2, 2);
    for (unsigned k = 0; k < 2; k++) {
        RIG *r = rig_apart(3, &t);
        cw_rule *p = add_rule(r, "spike", CW_TRIGGER_TIME, CW_ACTION_PULSE);
        p->time_begin = 100 * r->config.bit_ticks;
        p->level = CW_DOMINANT;
        p->pulse_length = (k ? 15 : 13) * t.quantum; /* the sample comes after 14 */
        rig_start(r);
        run_bits(r, 300);
        assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), k ? 3 : 0);
    }
}

/* ---- One node that is wrong ------------------------------------------------------------------ */

/* A crystal drifts from 0 to 6 %. Its node becomes bus-off. The others stay, and reach each other
 * to the end. */
TEST(a_node_that_drifts_out_goes_and_the_others_stay)
{
    const cw_bit_timing t = timing_of(125, 4, 5, 6, 4);
    RIG *r = rig_apart(3, &t);
    cw_rule *ramp = add_rule(r, "warm", CW_TRIGGER_TIME, CW_ACTION_RAMP);
    ramp->nodes = NODE(2);
    ramp->quantum_from = t.quantum;
    ramp->quantum_to = t.quantum - t.quantum * 6 / 100;
    ramp->for_ticks = 20000 * BIT;
    cw_rule *load = add_rule(r, "load", CW_TRIGGER_TIME, CW_ACTION_SEND);
    load->node = 0;
    load->frame = rig_frame(0x100, 0, 8);
    load->period_ticks = 300 * BIT;
    cw_rule *own = add_rule(r, "own", CW_TRIGGER_TIME, CW_ACTION_SEND);
    own->node = 2;
    own->frame = rig_frame(0x080, 0, 8);
    own->period_ticks = 400 * BIT;
    rig_start(r);
    run_bits(r, 5000);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
    run_bits(r, 60000);
    assert_int_equal(rig_stats(r, 2).bus_off, 1);
    assert_int_equal(rig_stats(r, 2).error_passive, 1);
    assert_int_equal(rig_stats(r, 0).bus_off + rig_stats(r, 1).bus_off, 0);
    const uint64_t before = rig_stats(r, 1).rx_frames;
    run_bits(r, 63000);
    assert_int_equal(rig_stats(r, 1).rx_frames, before + 10);
}

/* A node with the wrong prescaler, twice the bit rate, takes three bits for six. It understands
 * nothing, and its active flags destroy the frames of the others. */
TEST(a_node_at_the_wrong_bit_rate_destroys_and_leaves)
{
    const cw_bit_timing t = timing_of(125, 6, 7, 2, 2);
    RIG *r = rig_apart(3, &t);
    r->nodes[2].timing.bit.quantum /= 2;
    rig_start(r);
    send_frames(r, 0, 20, 0x100);
    run_bits(r, 200);
    assert_true(rig_count(r, CW_EVENT_ERROR, 0) > 0);
    assert_int_equal(rig_stats(r, 1).rx_frames, 0);
    run_bits(r, 20000);
    assert_int_equal(rig_stats(r, 2).rx_frames, 0);
    assert_true(rig_stats(r, 2).state >= CW_STATE_ERROR_PASSIVE);
}

/* ---- Edges that come late -------------------------------------------------------------------- */

/* A recessive bit is shorter where its edge comes late. It is read as long as the delay ends before
 * the sample point. Without it the frame has an error at every recessive bit after a dominant. */
TEST(slow_recessive_edges_shorten_bits)
{
    const cw_bit_timing t = timing_of(125, 6, 7, 2, 2);
    for (unsigned k = 0; k < 2; k++) {
        RIG *r = rig_apart(2, &t);
        r->nodes[1].timing.rx_delay[CW_RECESSIVE] = (k ? 1900 : 1500) * NS; /* sample: 1750 ns */
        rig_start(r);
        send_frames(r, 0, 4, 0x155);
        run_bits(r, 900);
        assert_int_equal(rig_stats(r, 1).rx_frames, k ? 0 : 4);
    }
}

/* Each edge comes at another moment, but early enough: nothing is lost, and no clock agrees. */
TEST(jitter_below_the_margin_does_nothing)
{
    const cw_bit_timing t = timing_of(125, 6, 7, 2, 2);
    RIG *r = rig_apart(2, &t);
    cw_rule *j = add_rule(r, "jitter", CW_TRIGGER_TIME, CW_ACTION_JITTER);
    j->nodes = NODE(0);
    j->jitter = 120 * NS;
    rig_start(r);
    send_frames(r, 0, 40, 0x100);
    run_bits(r, 6500);
    assert_int_equal(rig_stats(r, 1).rx_frames, 40);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
}

/* The wire swings after each edge to recessive. It is read right while the swing ends before the
 * sample point. */
TEST(ringing_up_to_the_sample_point_does_no_harm)
{
    const cw_bit_timing t = timing_of(125, 6, 7, 2, 1);
    for (unsigned k = 0; k < 2; k++) {
        RIG *r = rig_apart(2, &t);
        r->nodes[1].timing.ringing = (k ? 2000 : 300) * NS;
        rig_start(r);
        send_frames(r, 0, 4, 0x155);
        run_bits(r, 900);
        assert_int_equal(rig_stats(r, 1).rx_frames, k ? 0 : 4);
    }
}
