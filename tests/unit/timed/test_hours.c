/* SPDX-License-Identifier: MIT
 *
 * test_hours.c - hours of bus time, for each feature that remembers moments. A moment of long
 * ago stays long ago. Sanitizer builds find one that goes out of its range, and the same traffic
 * has the same outcome at any time.
 *
 * Idle time is skipped at 500 kbit/s, in few steps. Rules that always act on levels keep the bus
 * from that. There bits last 0.1 s, so that hours have few of them.
 */
#include "rig.h"

#define SECOND UINT64_C(80000000) /* ticks */
#define PERIOD (1800 * SECOND)
#define PERIODS 6u
#define WORK_MOST 100000u /* of a period: bits of 0.1 s; at 500 kbit/s it has 900 million bits */
#define NODES 4u
#define FRAMES 3u
#define SLOW_BIT (SECOND / 10)
#define SLOWEST_BIT (SECOND * 3 / 2)

typedef struct feature {
    const char *name;
    void (*set)(rig *r);
    uint64_t bit_ticks;
    uint64_t least_rx; /* events of a period, of the first two frames */
} feature;

/* ---- Features -------------------------------------------------------------------------------- */

static void plain(rig *r)
{
    (void)r;
}

/* Each node has a clock of its own, some ppm from the others. */
static void own_clocks(rig *r)
{
    const cw_span quantum = (cw_span)r->config.bit_ticks * CW_TICK / 16;
    for (unsigned i = 0; i < NODES; i++)
        r->nodes[i].timing.bit = (cw_bit_timing){
            .quantum = quantum + quantum / 1000000 * (cw_span)i, .prop_seg = 7, .phase_seg1 = 4,
            .phase_seg2 = 4, .sjw = 3};
}

/* A quantum has its longest length, too. */
static void many_quanta(rig *r)
{
    own_clocks(r);
    for (unsigned i = 0; i < NODES; i++)
        r->nodes[i].timing.bit = (cw_bit_timing){
            .quantum = r->nodes[i].timing.bit.quantum / 4, .prop_seg = 31, .phase_seg1 = 16,
            .phase_seg2 = 16, .sjw = 12};
}

static void rates_and_compensation(rig *r)
{
    own_clocks(r);
    for (unsigned i = 0; i < NODES; i++) {
        r->nodes[i].protocol = CW_FD;
        r->nodes[i].timing.data = (cw_data_timing){
            .bit = {.prop_seg = 7, .phase_seg1 = 4, .phase_seg2 = 4, .sjw = 3},
            .brp = 4, .data_brp = 1, .tdc = {.mode = CW_TDC_AUTO, .tdco = 12}};
    }
}

/* The same, where bits are common to all nodes. */
static void common_rates(rig *r)
{
    rates_and_compensation(r);
    for (unsigned i = 0; i < NODES; i++)
        r->nodes[i].timing.bit.quantum = (cw_span)r->config.bit_ticks * CW_TICK / 16;
}

static void delays_and_ringing(rig *r)
{
    own_clocks(r);
    for (unsigned i = 0; i < NODES; i++) {
        r->nodes[i].timing.tx_delay[CW_DOMINANT] = 8 * CW_TICK;
        r->nodes[i].timing.place = 4 * CW_TICK * (cw_span)i;
        r->nodes[i].timing.ringing = 3 * CW_TICK;
    }
}

static cw_rule *add_rule(rig *r, cw_action action)
{
    cw_rule *rule = &r->rules[r->config.rule_count++];
    *rule = (cw_rule){.name = "r", .trigger = CW_TRIGGER_TIME, .time_begin = SECOND,
                      .time_end = CW_NEVER, .probability = UINT64_MAX, .action = action,
                      .for_ticks = CW_NEVER};
    return rule;
}

static void cut_wires(rig *r)
{
    own_clocks(r);
    cw_rule *rule = add_rule(r, CW_ACTION_PARTITION);
    rule->group[3] = 1;
}

static void levels_held(rig *r)
{
    own_clocks(r);
    cw_rule *rule = add_rule(r, CW_ACTION_STUCK);
    rule->line = CW_LINE_RX;
    rule->node = 3;
    rule->level = CW_RECESSIVE;
}

static void edges_late(rig *r)
{
    own_clocks(r);
    cw_rule *rule = add_rule(r, CW_ACTION_JITTER);
    rule->nodes = NODE(3);
    rule->jitter = CW_TICK;
}

static void pulses(rig *r)
{
    own_clocks(r);
    cw_rule *rule = add_rule(r, CW_ACTION_PULSE);
    rule->trigger = CW_TRIGGER_FRAME;
    rule->time_begin = 0;
    rule->field = CW_FIELD_EOF;
    rule->level = CW_RECESSIVE;
    rule->pulse_length = CW_TICK;
}

static void sleepers(rig *r)
{
    own_clocks(r);
    r->nodes[3].sleeps = true;
    r->nodes[3].sleep = (cw_sleep_settings){.filter_ticks = 40,
                                            .wake_ticks = 100};
}

/* Nodes that cannot begin a frame. The last one sends none of those of the test. */
static void silent(rig *r)
{
    rates_and_compensation(r);
    r->nodes[2].modes = CW_MODE_RESTRICTED;
    r->nodes[3].modes = CW_MODE_LISTEN_ONLY;
}

static void swinging_rates(rig *r)
{
    rates_and_compensation(r);
    for (unsigned i = 0; i < NODES; i++)
        r->nodes[i].timing.ringing = 3 * CW_TICK;
}

static void sleepers_at_rates(rig *r)
{
    sleepers(r);
    rates_and_compensation(r);
}

static void disconnected(rig *r)
{
    rates_and_compensation(r);
    add_rule(r, CW_ACTION_DISCONNECT)->nodes = NODE(3);
}

static void bus_off(rig *r)
{
    rates_and_compensation(r);
    add_rule(r, CW_ACTION_BUS_OFF)->nodes = NODE(3);
}

/* One node after the other leaves in each period, and comes back after a third of it. */
static void mixture(rig *r)
{
    static const cw_action actions[] = {CW_ACTION_PARTITION, CW_ACTION_DISCONNECT,
                                        CW_ACTION_BUS_OFF};
    rates_and_compensation(r);
    for (unsigned n = 0; n < PERIODS; n++) {
        cw_rule *rule = add_rule(r, actions[n % 3]);
        rule->time_begin = n * PERIOD + 100 * SECOND;
        rule->for_ticks = n % 3 < 2 ? PERIOD / 3 : 0;
        rule->nodes = n % 3 ? NODE(3) : 0;
        rule->group[3] = n % 3 == 0;
    }
    r->nodes[2].modes = CW_MODE_RESTRICTED;
    r->nodes[3].restart_ticks = PERIOD / 3;
}

static void local_times(rig *r)
{
    own_clocks(r);
    for (unsigned i = 0; i < NODES; i++)
        r->nodes[i].local = (cw_local_time){.unit = CW_TICK * 160, .bits = 16, .at_eof = i % 2};
}

static const feature features[] = {
    {"plain", plain, BIT, 6},
    {"own clocks", own_clocks, BIT, 6},
    {"rates and compensation", rates_and_compensation, BIT, 9},
    {"rates in common", common_rates, BIT, 9},
    {"delays and ringing", delays_and_ringing, BIT, 6},
    {"wires that are cut", cut_wires, BIT, 4},
    {"nodes that never begin a frame", silent, BIT, 6},
    {"ringing at two rates", swinging_rates, BIT, 9},
    {"nodes that sleep at two rates", sleepers_at_rates, BIT, 6},
    {"a node that is disconnected", disconnected, BIT, 6},
    {"a node that is bus-off", bus_off, BIT, 6},
    {"nodes that leave and come back", mixture, BIT, 6},
    {"levels that are held", levels_held, SLOW_BIT, 0},
    {"edges that are late", edges_late, SLOW_BIT, 6},
    {"pulses", pulses, BIT, 6},
    {"nodes that sleep", sleepers, BIT, 5},
    {"local times", local_times, BIT, 6},
    {"bits of a second and a half", many_quanta, SLOWEST_BIT, 6},
};
#define FEATURE_COUNT (sizeof features / sizeof features[0])

/* ---- Periods --------------------------------------------------------------------------------- */

/* A node that can sleep does so until the first of the frames. */
static void send_all(rig *r, uint64_t tick)
{
    const cw_settings sleep = {.which = CW_SET_SLEEP, .sleeps = true};
    if (r->nodes[3].sleeps)
        assert_int_equal(cw_node_set(r->bus, 3, &sleep), CW_OK);
    rig_send(r, 0, &(cw_frame){.id = 0x123, .dlc = 1, .data = {0x55}}, tick);
    rig_send(r, 1, &(cw_frame){.id = 0x124}, tick);
    if (r->nodes[0].protocol == CW_FD)
        rig_send(r, 2, &(cw_frame){.id = 0x125, .flags = CW_FRAME_FD | CW_FRAME_BRS, .dlc = 9},
                 tick);
}

/* Returns the receivers of events from a place on. */
static uint64_t receptions(const rig *r, size_t from)
{
    uint64_t count = 0;
    for (size_t i = from; i < r->count; i++)
        for (uint64_t rest = r->events[i].nodes; rest; rest &= rest - 1)
            count += r->events[i].kind == CW_EVENT_RX;
    return count;
}

/* Runs to the end of a period. Fails as soon as that takes too many steps. */
static void run_to(rig *r, const feature *f, uint64_t tick)
{
    cw_status status;
    while ((status = cw_bus_advance_some(r->bus, tick, WORK_MOST)) == CW_FULL)
        rig_poll(r);
    if (status != CW_OK)
        fail_msg("%s: the bus has not rested", f->name);
    rig_poll(r);
}

/* counts: synchronisations, so that frames go bit by bit where clocks differ. */
static void run_periods(const feature *f, bool counts)
{
    static cw_sync_record records[NODES];
    RIG *r = rig_new(NODES);
    uint64_t first = 0;
    r->config.bit_ticks = (uint32_t)f->bit_ticks;
    f->set(r);
    rig_start(r);
    cw_bus_set_sync_records(r->bus, counts ? records : NULL);
    for (unsigned n = 0; n < PERIODS; n++) {
        const size_t before = r->count;
        send_all(r, n * PERIOD + 2 * SECOND + 20 * f->bit_ticks);
        run_to(r, f, (n + 1) * PERIOD);
        const uint64_t now = receptions(r, before);
        first = n == 0 ? now : first;
        if (now != first || now < f->least_rx)
            fail_msg("%s: %u received in period %u, %u in the first", f->name, (unsigned)now, n,
                     (unsigned)first);
    }
}

TEST(a_feature_does_the_same_after_hours)
{
    for (unsigned i = 0; i < FEATURE_COUNT; i++)
        for (unsigned counts = 0; counts < 2; counts++)
            run_periods(&features[i], counts);
}
