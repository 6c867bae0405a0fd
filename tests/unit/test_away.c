/* SPDX-License-Identifier: MIT
 *
 * test_away.c - nodes that leave a bus with two rates and come back. Their hosts detach them, put
 * them to sleep or change their modes, in the middle of bits and frames. A bus that takes short
 * cuts and one that goes bit by bit have the same events and statistics.
 *
 * The place of such a node in its bit shows when it is back. It is away for long enough that the
 * bus rests meanwhile, or takes a frame at once.
 */
#include "rig.h"

#include <inttypes.h>

#define NODES 4u
#define ROUNDS 6u
#define SEEDS 500u

/* The clocks of the nodes. */
typedef enum clocks {
    DIFFERENT,
    RINGING, /* ... and the wire swings */
    COMMON,
    COMMON_AND_OWN, /* they agree, but both buses go by them */
    CLOCKS_COUNT,
} clocks;

static uint64_t drawn;

static uint64_t below(uint64_t n)
{
    drawn ^= drawn << 13;
    drawn ^= drawn >> 7;
    drawn ^= drawn << 17;
    return (drawn >> 11) % n;
}

/* The same seed draws the same numbers for both buses. */
static void begin_draws(uint64_t seed)
{
    drawn = seed * UINT64_C(0x9E3779B97F4A7C15) + 1;
    for (unsigned i = 0; i < 8; i++)
        (void)below(2);
}

static void draw_node(cw_node_config *node, clocks c)
{
    static const uint8_t modes[] = {CW_MODE_LISTEN_ONLY, CW_MODE_RESTRICTED, CW_MODE_LOOPBACK};
    cw_node_timing *t = &node->timing;
    node->protocol = CW_FD;
    t->bit = (cw_bit_timing){
        .quantum = 4 * CW_TICK, .prop_seg = 15, .phase_seg1 = 12, .phase_seg2 = 12, .sjw = 8};
    t->data = (cw_data_timing){.brp = 4, .data_brp = 4, .bit = {
        .prop_seg = 3, .phase_seg1 = 3, .phase_seg2 = 3, .sjw = 2}};
    if (c == DIFFERENT || c == RINGING)
        t->bit.quantum += (cw_span)below(4 * CW_TICK / 1000);
    if (c == RINGING && below(2))
        t->ringing = (cw_span)below(12) * CW_TICK;
    if (below(5) == 0)
        node->restart_ticks = BIT * (1 + below(300));
    if (below(3) == 0)
        node->modes = modes[below(3)];
}

static void send(rig *r, uint64_t tick)
{
    const unsigned node = (unsigned)below(NODES);
    const unsigned flags = below(4) ? CW_FRAME_FD | CW_FRAME_BRS : 0;
    const unsigned id = (unsigned)below(0x800);
    const cw_frame frame = rig_frame(id, flags, (unsigned)(flags ? 8 + below(8) : below(9)));
    (void)cw_node_send(r->bus, node, &frame, tick); /* some are refused */
}

/* Takes a node off the bus, or brings it back. */
static void move(rig *r, unsigned node, unsigned how, bool away)
{
    cw_settings s = {.which = CW_SET_SLEEP, .sleeps = away};
    if (how < 3)
        (void)cw_node_attach(r->bus, node, !away);
    else if (how > 3)
        s = (cw_settings){.which = CW_SET_MODES, .modes_mask = 0x7F, .modes = away
                          ? how == 4 ? CW_MODE_LISTEN_ONLY : CW_MODE_LOOPBACK : 0};
    if (how >= 3)
        (void)cw_node_set(r->bus, node, &s);
}

static void run_on(rig *r, uint64_t *tick, uint64_t least_bits, uint64_t most_bits)
{
    *tick += BIT * least_bits + below(BIT * (most_bits - least_bits));
    rig_run(r, *tick);
}

static rig *run(uint64_t seed, clocks c, bool steps)
{
    rig *r = rig_new(NODES);
    uint64_t tick = 0;
    begin_draws(seed);
    for (unsigned i = 0; i < NODES; i++)
        draw_node(&r->nodes[i], c);
    rig_start(r);
    cw_bus_set_stepping(r->bus, steps);
    cw_bus_set_own_clocks(r->bus, c == COMMON_AND_OWN);
    run_on(r, &tick, 20, 21);
    for (unsigned i = 0; i < ROUNDS; i++) {
        const unsigned node = (unsigned)below(NODES), how = (unsigned)below(6);
        send(r, tick);
        run_on(r, &tick, 30, 90);
        move(r, node, how, true);
        run_on(r, &tick, 100, 500);
        if (below(2)) {
            send(r, tick);
            run_on(r, &tick, 0, 300);
        }
        move(r, node, how, false);
        run_on(r, &tick, 0, 40);
    }
    run_on(r, &tick, 2000, 2001);
    return r;
}

static void assert_same(const rig *a, const rig *b, uint64_t seed, clocks c)
{
    char line[RIG_LINE_MAX], other[RIG_LINE_MAX];
    for (size_t i = 0; i < a->count && i < b->count; i++) {
        rig_line(line, &a->events[i]);
        rig_line(other, &b->events[i]);
        if (strcmp(line, other) != 0)
            fail_msg("seed %" PRIu64 ", clocks %d: %s, by steps %s", seed, (int)c, line, other);
    }
    const cw_bus_stats of_a = rig_bus_stats(a), of_b = rig_bus_stats(b);
    if (a->count != b->count || memcmp(&of_a, &of_b, sizeof of_a) != 0)
        fail_msg("seed %" PRIu64 ", clocks %d: statistics of the bus", seed, (int)c);
    for (unsigned i = 0; i < NODES; i++) {
        const cw_node_stats n = rig_stats(a, i), m = rig_stats(b, i);
        if (memcmp(&n, &m, sizeof n) != 0)
            fail_msg("seed %" PRIu64 ", clocks %d: statistics of node %u", seed, (int)c, i);
    }
}

TEST(nodes_that_were_away_are_where_single_bits_leave_them)
{
    uint64_t work = 0, work_of_steps = 0;
    for (unsigned c = 0; c < CLOCKS_COUNT; c++)
        for (uint64_t seed = 1; seed <= SEEDS; seed++) {
            RIG *fast = run(seed, (clocks)c, false), *steps = run(seed, (clocks)c, true);
            assert_same(fast, steps, seed, (clocks)c);
            work += cw_bus_work(fast->bus);
            work_of_steps += cw_bus_work(steps->bus);
        }
    assert_true(work < work_of_steps / 2); /* there are short cuts to be compared */
}
