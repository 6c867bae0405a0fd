/* SPDX-License-Identifier: MIT
 *
 * test_local_time.c - local times, basic cycles, slots and global time (L2 to L7).
 */
#include "rig.h"

#include "time/local.h"

#define US 80u          /* ticks */
#define UNIT (US * CW_TICK)
#define MASTER 0
#define CYCLE 2000u     /* us */
#define CYCLE_BITS 1000u
#define REFERENCE 0x100u
#define SAMPLE (14u * 160u / 16u) /* ticks of a bit up to the sample point, as a bus has it */

static const cw_filter reference = {.value = REFERENCE, .mask = CW_FILTER_BASE_MASK};

static cw_time_trigger trigger(uint32_t at, uint32_t slot, uint32_t id)
{
    return (cw_time_trigger){.at = at, .slot = slot, .frame = {.id = id, .dlc = 1}};
}

static cw_local_time local_time(bool at_eof)
{
    return (cw_local_time){.unit = UNIT, .bits = 16, .at_eof = at_eof};
}

static void give_schedule(rig *r, unsigned node, const cw_time_trigger *triggers, unsigned count)
{
    r->nodes[node].modes = CW_MODE_TIME_TRIGGERED;
    r->nodes[node].local = local_time(false);
    r->nodes[node].schedule = (cw_schedule){.reference = reference, .cycles = 4, .cycle_byte = 0,
                                            .trigger_count = (uint16_t)count,
                                            .triggers = triggers};
}

/* Returns the n-th event of a kind at a node; -1: at any. */
static const cw_event *nth(const rig *r, cw_event_kind kind, int node, unsigned n)
{
    for (size_t i = 0; i < r->count; i++) {
        const cw_event *e = &r->events[i];
        if (e->kind == kind && (node < 0 || (e->nodes & NODE(node))) && n-- == 0)
            return e;
    }
    return NULL;
}

static cw_node_time time_of(const rig *r, unsigned node)
{
    cw_node_time t;
    assert_int_equal(cw_node_get_time(r->bus, node, &t), CW_OK);
    return t;
}

static cw_trigger_stats slots_of(const rig *r, unsigned node, unsigned number)
{
    cw_trigger_stats s;
    assert_int_equal(cw_node_get_trigger_stats(r->bus, node, number, &s), CW_OK);
    return s;
}

/* Returns the tick of the SOF of a frame that ends at an event of its transmitter. */
static uint64_t begin_of(const cw_event *tx)
{
    return tx->tick - (uint64_t)cw_frame_wire_bits(&tx->frame) * BIT;
}

/* ---- The counter ----------------------------------------------------------------------------- */

TEST(a_counter_counts_whole_units)
{
    const cw_local_clock c = cw_local_begin(UNIT, CW_TICK, 7);
    assert_int_equal(cw_local_at(&c, (cw_instant){.tick = US - 1, .fraction = UINT32_MAX}), 7);
    assert_int_equal(cw_local_at(&c, (cw_instant){.tick = US}), 8);
    assert_int_equal(cw_local_at(&c, (cw_instant){.tick = UINT64_C(1) << 60}),
                     7 + (UINT64_C(1) << 60) / US);
    assert_int_equal(cw_local_tick(&c, 7), 0);
    assert_int_equal(cw_local_tick(&c, 8), US);
    assert_int_equal(cw_local_tick(&c, 7 + (UINT64_C(1) << 50)), (UINT64_C(1) << 50) * US);
    assert_true(cw_local_tick(&c, UINT64_MAX) == CW_NEVER);
}

/* A clock that gets faster by a half in the middle of a unit has done half of it by then. */
TEST(a_counter_changes_its_rate_in_the_middle_of_a_unit)
{
    cw_local_clock c = cw_local_begin(UNIT, 6 * CW_TICK, 0);
    cw_local_retime(&c, 3 * CW_TICK, (cw_instant){.tick = 10 * US + US / 2});
    assert_int_equal(cw_local_tick(&c, 11), 10 * US + US / 2 + US / 4);
    assert_int_equal(cw_local_tick(&c, 13), 10 * US + US / 2 + US / 4 + US);
    assert_int_equal(cw_local_at(&c, (cw_instant){.tick = 12 * US}), 13);
    cw_local_retime(&c, 6 * CW_TICK, (cw_instant){.tick = 12 * US});
    assert_int_equal(cw_local_tick(&c, 14), 12 * US + US / 2);
    cw_local_give_unit(&c, 2 * UNIT, 6 * CW_TICK); /* as many clocks make two units now */
    cw_local_retime(&c, 6 * CW_TICK, (cw_instant){.tick = 12 * US + US / 2});
    assert_int_equal(cw_local_tick(&c, 15), 14 * US + US / 2);
}

/* A clock of 100 ppm is a unit ahead after 10001 of them; nothing is lost on the way. */
TEST(an_inexact_clock_keeps_its_error)
{
    cw_local_clock c = cw_local_begin(UNIT, cw_quantum(10000000, 1, 0), 0);
    cw_local_retime(&c, cw_quantum(10000000, 1, 100), (cw_instant){.tick = 0});
    assert_int_equal(cw_local_at(&c, (cw_instant){.tick = UINT64_C(10000) * US}), 10001 - 1);
    assert_int_equal(cw_local_at(&c, (cw_instant){.tick = UINT64_C(10000) * US + 1}), 10001);
    assert_int_equal(cw_local_at(&c, (cw_instant){.tick = UINT64_C(1000000000) * US + US / 2}),
                     UINT64_C(1000100000));
}

/* ---- Global time ----------------------------------------------------------------------------- */

TEST(global_time_follows_from_two_captures)
{
    static const cw_time_pair known[2] = {{.a = 10000, .b = 10501}, {.a = 60000, .b = 60506}};
    static const cw_time_pair wide[2] = {{.a = UINT64_MAX - 9, .b = 0},
                                         {.a = UINT64_MAX / 2, .b = UINT64_MAX / 2 + 10}};
    uint64_t a;
    assert_true(cw_global_time(known, 16, 16, 14972, &a));
    assert_int_equal(a, 14464);
    assert_true(cw_global_time(known, 16, 16, 60506, &a));
    assert_int_equal(a, 60000);
    assert_true(cw_global_time(known, 32, 17, 14972 + 65536, &a));
    assert_int_equal(a, 80000);
    assert_true(cw_global_time(wide, 64, 64, UINT64_MAX / 2 + 110, &a)); /* products of 128 bits */
    assert_int_equal(a, UINT64_MAX / 2 + 100);
    const cw_time_pair same[2] = {{.a = 1, .b = 5}, {.a = 3, .b = 5}};
    assert_false(cw_global_time(same, 16, 16, 7, &a));
}

/* ---- Captures -------------------------------------------------------------------------------- */

/* The first SOF is bit 11: it is sampled at 11 bits and 14 of 16 quanta. */
TEST(frames_are_captured_at_sof_or_in_the_last_bit_of_eof)
{
    const cw_frame f = {.id = 0x123};
    const uint64_t length = cw_frame_wire_bits(&f);
    RIG *r = rig_new(3);
    for (unsigned i = 0; i < 3; i++) {
        r->nodes[i].local = local_time(i == 1);
        r->nodes[i].local.start = 65530;
    }
    rig_start(r);
    cw_bus_set_events(r->bus, CW_EVENTS_USUAL | 1u << CW_EVENT_CAPTURE);
    rig_send(r, 0, &f, 0);
    rig_run_bits(r, 100);
    const uint64_t sof = (11 * BIT + SAMPLE) / US, eof = ((10 + length) * BIT + SAMPLE) / US;
    assert_int_equal(time_of(r, 0).captured, (65530 + sof) & 65535);
    assert_int_equal(time_of(r, 1).captured, (65530 + eof) & 65535);
    assert_int_equal(time_of(r, 2).captured, (65530 + sof) & 65535);
    for (int i = 0; i < 3; i++) {
        const cw_event *e = nth(r, CW_EVENT_CAPTURE, i, 0);
        assert_int_equal(e->tick, (11 + length) * BIT); /* the end of the frame */
        assert_int_equal(e->local_time, time_of(r, (unsigned)i).captured);
        assert_true(cw_frame_equal(&e->frame, &f));
        assert_int_equal(e->from, NODE(0));
    }
    assert_int_equal(time_of(r, 2).local, (65530 + 100 * BIT / US) & 65535);
    assert_false(time_of(r, 2).has_global);
}

/* ---- Cycles and slots ------------------------------------------------------------------------ */

static const cw_time_trigger of_master[] = {
    {.at = 500, .slot = 100, .frame = {.id = 0x200, .dlc = 1}},
    {.at = CYCLE, .slot = 100, .frame = {.id = REFERENCE, .dlc = 1}}};

static rig *new_matrix(const cw_time_trigger *of_slave, unsigned count)
{
    rig *r = rig_new(3);
    give_schedule(r, MASTER, of_master, 2);
    give_schedule(r, 1, of_slave, count);
    rig_start(r);
    return r;
}

/* The clock of the slave is fast by 1000 ppm. The bus has not begun. */
static rig *rig_with_fast_slave(const cw_time_trigger *of_slave)
{
    rig *r = rig_new(3);
    give_schedule(r, MASTER, of_master, 2);
    give_schedule(r, 1, of_slave, 1);
    r->nodes[1].timing.bit = (cw_bit_timing){.quantum = cw_quantum(8000000, 1, 1000),
                                             .prop_seg = 7, .phase_seg1 = 4, .phase_seg2 = 4,
                                             .sjw = 4};
    return r;
}

/* The SOF of each frame is the first bit that begins at its trigger or after it. */
TEST(frames_go_in_their_slots)
{
    const cw_time_trigger of_slave[] = {trigger(1000, 50, 0x300)};
    RIG *r = new_matrix(of_slave, 1);
    rig_run_bits(r, 5 * CYCLE_BITS);
    const cw_event *first = nth(r, CW_EVENT_TX, MASTER, 0);
    const uint64_t sof = begin_of(first);
    assert_int_equal(first->frame.id, REFERENCE);
    assert_int_equal(sof, CYCLE * US); /* at local time CYCLE: nobody begins a cycle before */
    const uint64_t base = (sof + SAMPLE) / US;
    const cw_event *own = nth(r, CW_EVENT_TX, MASTER, 1), *slave = nth(r, CW_EVENT_TX, 1, 0);
    assert_int_equal(begin_of(own), ((base + 500) * US + BIT - 1) / BIT * BIT);
    assert_int_equal(begin_of(slave), ((base + 1000) * US + BIT - 1) / BIT * BIT);
    assert_int_equal(slave->late, begin_of(slave) - (base + 1000) * US);
    assert_int_equal(slave->trigger, 1);
    assert_int_equal(time_of(r, 1).references, 4);
    assert_int_equal(time_of(r, 1).cycle, 3);
    assert_int_equal(nth(r, CW_EVENT_TX, MASTER, 6)->frame.data[0], 3); /* numbers of cycles */
    assert_int_equal(slots_of(r, 1, 0).sent, 4);
    assert_int_equal(slots_of(r, 1, 0).missed, 0);
}

/* Cycle 1 of each two, and cycle 2 of all four. */
TEST(the_matrix_says_in_which_cycles_a_trigger_acts)
{
    cw_time_trigger of_slave[] = {trigger(600, 50, 0x301), trigger(1000, 50, 0x302)};
    of_slave[0].repeat = 2;
    of_slave[0].cycle = 1;
    of_slave[1].repeat = 4;
    of_slave[1].cycle = 2;
    RIG *r = new_matrix(of_slave, 2);
    rig_run_bits(r, 9 * CYCLE_BITS + CYCLE_BITS / 2); /* eight basic cycles, and the ninth begun */
    assert_int_equal(time_of(r, 1).references, 9);
    assert_int_equal(slots_of(r, 1, 0).sent, 4);
    assert_int_equal(slots_of(r, 1, 1).sent, 2);
    assert_int_equal(nth(r, CW_EVENT_TX, 1, 0)->frame.id, 0x301); /* in cycle 1 */
    assert_int_equal(nth(r, CW_EVENT_TX, 1, 1)->frame.id, 0x302); /* in cycle 2 */
}

/* Another frame is on the bus during the whole slot. */
TEST(a_frame_that_cannot_begin_in_its_slot_is_given_up)
{
    const cw_time_trigger of_slave[] = {trigger(1000, 20, 0x300)};
    const cw_frame other = {.id = 0x123, .dlc = 8};
    RIG *r = new_matrix(of_slave, 1);
    const uint64_t base = (CYCLE * US + SAMPLE) / US;
    rig_send(r, 2, &other, (base + 990) * US);
    rig_run_bits(r, 2 * CYCLE_BITS);
    const cw_event *drop = nth(r, CW_EVENT_DROP, 1, 0);
    assert_int_equal(drop->why, CW_DROP_SLOT_MISSED);
    assert_int_equal(drop->tick, ((base + 1020) * US + BIT - 1) / BIT * BIT);
    assert_int_equal(drop->trigger, 1);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 1), 0);
    assert_int_equal(slots_of(r, 1, 0).missed, 1);
    const cw_node_stats s = rig_stats(r, 1);
    assert_int_equal(s.dropped[CW_DROP_SLOT_MISSED], 1);
    assert_true(cw_node_stats_balance(&s));
}

/* ... at the end of a bit of its own. A node with nothing to do there would go ahead to its next
 * sample point. */
TEST(a_slot_ends_at_one_tick_whoever_asks_for_synchronisations)
{
    const cw_time_trigger of_slave[] = {trigger(1000, 20, 0x300)};
    const cw_frame other = {.id = 0x123, .dlc = 8};
    uint64_t ticks[2];
    for (unsigned asks = 0; asks < 2; asks++) {
        RIG *r = rig_with_fast_slave(of_slave);
        rig_start(r);
        cw_bus_set_events(r->bus, CW_EVENTS_USUAL | (asks ? 1u << CW_EVENT_SYNC : 0));
        rig_send(r, 2, &other, ((CYCLE * US + SAMPLE) / US + 990) * US);
        rig_run_bits(r, 2 * CYCLE_BITS);
        ticks[asks] = nth(r, CW_EVENT_DROP, 1, 0)->tick;
    }
    assert_int_equal(ticks[0], ticks[1]);
    assert_int_not_equal(ticks[0] % BIT, 0);
}

/* Two nodes share a window: one loses arbitration, and does not try again (L1). */
TEST(a_frame_that_loses_in_its_slot_is_given_up)
{
    const cw_time_trigger of_slave[] = {trigger(500, 100, 0x201)};
    RIG *r = new_matrix(of_slave, 1);
    rig_run_bits(r, 2 * CYCLE_BITS);
    assert_int_equal(slots_of(r, MASTER, 0).sent, 1);
    assert_int_equal(slots_of(r, 1, 0).lost, 1);
    assert_int_equal(slots_of(r, 1, 0).failed, 1);
    assert_int_equal(nth(r, CW_EVENT_ARBITRATION_LOST, 1, 0)->trigger, 1);
    assert_int_equal(nth(r, CW_EVENT_DROP, 1, 0)->why, CW_DROP_ONE_SHOT);
}

/* Nobody acknowledges the first reference messages. The master tries again, a cycle later each
 * time, and sends nothing else before. */
TEST(a_master_without_an_answer_tries_again)
{
    RIG *r = rig_new(2);
    give_schedule(r, MASTER, of_master, 2);
    rig_start(r);
    assert_int_equal(cw_node_attach(r->bus, 1, false), CW_OK);
    rig_run_bits(r, 5 * CYCLE_BITS / 2);
    assert_int_equal(slots_of(r, MASTER, 1).failed, 2);
    assert_int_equal(slots_of(r, MASTER, 0).slots, 0);
    assert_false(time_of(r, MASTER).in_cycle);
    assert_int_equal(cw_node_attach(r->bus, 1, true), CW_OK);
    rig_run_bits(r, 4 * CYCLE_BITS);
    const cw_event *tx = nth(r, CW_EVENT_TX, MASTER, 0);
    assert_int_equal(begin_of(tx), 3 * CYCLE * US);
    assert_int_equal(tx->frame.data[0], 0);
    assert_int_equal(slots_of(r, MASTER, 0).sent, 1);
}

/* The slave's clock is fast by 1000 ppm: 1000 of its units are 999 us. It knows the time of the
 * master all the same, and its slots drift by what it counts too fast since the reference. */
TEST(a_node_with_another_clock_knows_the_time_of_the_master)
{
    const cw_time_trigger of_slave[] = {trigger(1000, 50, 0x300)};
    RIG *r = rig_with_fast_slave(of_slave);
    r->nodes[1].local.unit = cw_quantum(1000000, 1, 1000);
    r->nodes[1].local.start = 500;
    rig_start(r);
    rig_run_bits(r, 7 * CYCLE_BITS);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
    const cw_node_time a = time_of(r, MASTER), b = time_of(r, 1);
    assert_true(b.has_global && b.master == MASTER && a.has_global && a.global == a.local);
    assert_int_equal(a.local, 7 * CYCLE);
    assert_int_equal(b.local, 500 + 7 * CYCLE * 1001 / 1000);
    assert_in_range(b.global + 2, a.local, a.local + 4);
    const cw_event *reference_rx = nth(r, CW_EVENT_TX, MASTER, 0), *own = nth(r, CW_EVENT_TX, 1, 0);
    const uint64_t apart = begin_of(own) - begin_of(reference_rx);
    assert_in_range(apart, 999 * US, 1003 * US);
}

/* ---- Reload and settings --------------------------------------------------------------------- */

TEST(a_cycle_goes_on_at_a_reload)
{
    static const uint8_t from[] = {0, 1, 2};
    const cw_time_trigger of_slave[] = {trigger(1000, 50, 0x300)};
    RIG *old = new_matrix(of_slave, 1);
    RIG *r = new_matrix(of_slave, 1);
    rig_run_bits(old, CYCLE_BITS + 450); /* before the slot of the slave */
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, from), CW_OK);
    assert_int_equal(time_of(r, 1).references, 1);
    rig_run_bits(r, 2 * CYCLE_BITS);
    assert_int_equal(slots_of(r, 1, 0).sent, 1);
    const uint64_t base = (CYCLE * US + SAMPLE) / US;
    assert_int_equal(begin_of(nth(r, CW_EVENT_TX, 1, 0)),
                     ((base + 1000) * US + BIT - 1) / BIT * BIT);
}

TEST(bad_schedules_are_refused)
{
    const cw_time_trigger good[] = {trigger(10, 5, 0x1), trigger(20, 5, 0x2)};
    cw_time_trigger bad[][2] = {{good[1], good[0]}, {good[0], good[1]}, {good[0], good[1]},
                                {good[0], good[1]}};
    bad[1][1].slot = 0;
    bad[2][1].at = 65536;
    bad[3][1].repeat = bad[3][1].cycle = 2;
    RIG *r = rig_new(2);
    give_schedule(r, 0, good, 2);
    assert_true(cw_bus_size(&r->config) > 0);
    for (unsigned k = 0; k < 4; k++) {
        r->nodes[0].schedule.triggers = bad[k];
        assert_int_equal(cw_bus_size(&r->config), 0);
    }
    r->nodes[0].schedule.triggers = good;
    r->nodes[0].local.bits = 0;
    assert_int_equal(cw_bus_size(&r->config), 0);
    r->nodes[0].local.bits = 33;
    assert_int_equal(cw_bus_size(&r->config), 0);
    r->nodes[0].local.bits = 16;
    r->nodes[0].local.start = 65536;
    assert_int_equal(cw_bus_size(&r->config), 0);
}
