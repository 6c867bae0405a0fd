/* SPDX-License-Identifier: MIT
 *
 * test_timed_mac.c - the timed test-bench interface against quanta.h, which is written from the
 * rules of bit timing. The same levels go in; the same levels and reports come out.
 */
#include "cases.h"
#include "quanta.h"

#define RUNS 200u
#define QUANTA_OF_RUN 10000u
#define QUANTUM 1000 /* of the controller under test */

enum { UNDER_TEST, PARTNER, NOISE };

static uint64_t state_of_random;

static unsigned draw(unsigned below)
{
    state_of_random = state_of_random * 6364136223846793005u + 1442695040888963407u;
    return (unsigned)((state_of_random >> 33) % below);
}

static unsigned least_of(unsigned a, unsigned b)
{
    return a < b ? a : b;
}

/* Every fourth timing is one that only newer controllers allow. */
static quanta_timing draw_timing(void)
{
    const unsigned most = draw(4) == 0 ? 24 : 8;
    quanta_timing t = {.quantum = QUANTUM, .triple = draw(4) == 0};
    t.prop = 1 + draw(most);
    t.seg1 = 2 + draw(most - 1);
    t.seg2 = 2 + draw(most - 1);
    t.sjw = 1 + draw(least_of(most / 2, least_of(t.seg1, t.seg2)));
    return t;
}

static bool partner_sends(cw_frame *frame, unsigned node, unsigned number)
{
    (void)number;
    if (node != PARTNER || draw(20) != 0)
        return false;
    *frame = (cw_frame){.id = draw(CW_BASE_ID_MAX + 1), .dlc = (uint8_t)draw(9)};
    for (unsigned i = 0; i < 8; i++)
        frame->data[i] = (uint8_t)draw(256);
    return true;
}

/* Begins or ends a pulse now and then. A run has few pulses or many, short ones or long ones. */
static void make_noise(quanta *q, unsigned seldom, unsigned longest)
{
    quanta_node *n = &q->nodes[NOISE];
    const bool dominant = n->edges % 2;
    if (draw(dominant ? longest : seldom) == 0)
        n->edge_at[n->edges++ % QUANTA_EDGES] = q->nodes[UNDER_TEST].now + draw(QUANTUM);
}

static void start(quanta *q, cw_timed_mac *c, uint32_t brp)
{
    const quanta_timing t = draw_timing();
    quanta_timing other = t;
    const cw_bit_timing timing = {
        .quantum = CW_TICK, .prop_seg = (uint16_t)t.prop, .phase_seg1 = (uint16_t)t.seg1,
        .phase_seg2 = (uint16_t)t.seg2, .sjw = (uint16_t)t.sjw, .triple_sampling = t.triple};
    other.quantum += (int)draw(21) - 10;
    other.triple = false;
    *q = (quanta){.next_frame = partner_sends};
    quanta_add(q, &t, 0);
    quanta_add(q, &other, draw(QUANTUM));
    (void)quanta_add_script(q);
    assert_int_equal(cw_timed_mac_init(c, &timing, brp, 0, 96), CW_OK);
}

/* Offers a frame to both. */
static void offer(quanta *q, cw_timed_mac *c)
{
    const cw_frame frame = {.id = draw(CW_BASE_ID_MAX + 1), .dlc = 1};
    assert_int_equal(cw_mac_offer(&c->mac, &frame),
                     cw_mac_offer(&q->nodes[UNDER_TEST].mac, &frame));
}

/* Gives the controller the level that its double has just seen. Returns what it says. */
static unsigned end_quantum(cw_timed_mac *c, bool level, cw_mac_report *report)
{
    for (unsigned clock = 1; clock < c->brp; clock++)
        assert_int_equal(cw_timed_mac_clock(c, !level, report), 0);
    return c->brp == 1 ? cw_timed_mac_quantum(c, level, report)
                       : cw_timed_mac_clock(c, level, report);
}

static void step_both(quanta *q, cw_timed_mac *c)
{
    quanta_node *n = &q->nodes[UNDER_TEST];
    cw_mac_report report = {0};
    while (quanta_first(q) != UNDER_TEST)
        quanta_step(q);
    const bool was_sampled = n->sampled;
    quanta_step(q);
    const unsigned what = end_quantum(c, n->before, &report);
    const bool bit_ended = (what & CW_QUANTUM_BIT_ENDED) != 0;
    assert_int_equal(cw_timed_mac_level(c), n->driven);
    assert_int_equal(cw_timed_mac_quanta(c), n->count);
    assert_int_equal(bit_ended, was_sampled && !n->sampled);
    assert_int_equal((what & CW_QUANTUM_SAMPLED) != 0, !was_sampled && n->sampled);
    if (what & CW_QUANTUM_SAMPLED) {
        assert_int_equal(report.what, n->report.what);
        assert_int_equal(cw_mac_get_phase(&c->mac), cw_mac_get_phase(&n->mac));
    }
}

TEST(a_controller_in_time_does_what_the_rules_say)
{
    unsigned received = 0, sent = 0, errors = 0;
    for (unsigned run = 0; run < RUNS; run++) {
        quanta q;
        cw_timed_mac c;
        state_of_random = run;
        start(&q, &c, run % 3 == 2 ? 3 : 1);
        const unsigned seldom = 1u << (4 + draw(10)), longest = 1 + draw(30);
        for (unsigned i = 0; i < QUANTA_OF_RUN; i++) {
            make_noise(&q, seldom, longest);
            if (cw_mac_can_start(&c.mac) && draw(200) == 0)
                offer(&q, &c);
            step_both(&q, &c);
        }
        received += q.nodes[UNDER_TEST].received;
        sent += q.nodes[UNDER_TEST].sent;
        errors += q.nodes[UNDER_TEST].errors;
    }
    assert_true(received > 100 && sent > 100 && errors > 1000);
}

/* ---- Limits ---------------------------------------------------------------------------------- */

#define LONGEST ((INT64_C(1) << 53) - 1)

TEST(a_bit_timing_is_valid_up_to_its_limits)
{
    const struct {
        cw_bit_timing timing;
        bool valid;
    } cases[] = {
        {{1, 0, 1, 1, 1, false}, true},
        {{0, 0, 1, 1, 1, false}, false},
        {{-1, 0, 1, 1, 1, false}, false},
        {{LONGEST, 0, 1, 1, 1, true}, true},
        {{LONGEST + 1, 0, 1, 1, 1, true}, false},
        {{1, 0, 0, 1, 1, false}, false},
        {{1, 0, 1, 0, 1, false}, false},
        {{1, 0, 1, 1, 0, false}, false},
        {{1, 8, 4, 5, 4, false}, true}, /* sjw as long as Phase_Seg1 */
        {{1, 8, 4, 5, 5, false}, false},
        {{1, 8, 5, 4, 4, false}, true}, /* ... as Phase_Seg2 */
        {{1, 8, 5, 4, 5, false}, false},
        {{1, CW_BIT_QUANTA_MAX - 3, 1, 1, 1, false}, true},
        {{1, CW_BIT_QUANTA_MAX - 2, 1, 1, 1, false}, false},
        {{1, UINT16_MAX, UINT16_MAX, UINT16_MAX, 1, false}, false},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        if (cw_bit_timing_valid(&cases[i].timing) != cases[i].valid)
            fail_msg("case %zu should be %s", i, cases[i].valid ? "valid" : "invalid");
}

TEST(a_quantum_has_limits)
{
    assert_int_equal(cw_quantum(CW_CLOCK_HZ, 1, 0), CW_TICK);
    assert_int_equal(cw_quantum(1, 1, 0), 0); /* a second is too long */
    assert_int_equal(cw_quantum(0, 1, 0), 0);
    assert_int_equal(cw_quantum(CW_CLOCK_HZ, 0, 0), 0);
    assert_int_equal(cw_quantum(CW_CLOCK_HZ, 65537, 0), 0);
    assert_int_equal(cw_quantum(CW_CLOCK_HZ, 65536, 0), CW_TICK * 65536);
    assert_int_equal(cw_quantum(CW_CLOCK_HZ, 1, 500000), (CW_TICK * 2 + 1) / 3);
    assert_int_equal(cw_quantum(CW_CLOCK_HZ, 1, -500000), CW_TICK * 2);
    assert_int_equal(cw_quantum(CW_CLOCK_HZ, 1, 500001), 0);
    assert_int_equal(cw_quantum(CW_CLOCK_HZ, 1, -500001), 0);
}
