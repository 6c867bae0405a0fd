/* SPDX-License-Identifier: MIT
 *
 * generate.c - makes a scenario from a seed: a style, buses, traffic, operations.
 *
 * No two numbers are drawn in one expression, unless its order is defined: a seed is to mean the
 * same with each compiler.
 */
#include "differential.h"

#include <stdlib.h>
#include <string.h>

/* ---- Styles ---------------------------------------------------------------------------------- */

#define ACTION(name) (UINT64_C(1) << CW_ACTION_##name)
#define POSITIONS (ACTION(FLIP) | ACTION(FORCE) | ACTION(GLITCH))
#define LEVELS (ACTION(STUCK) | ACTION(NOISE) | ACTION(NO_ACK) | ACTION(RAW))
#define TOPOLOGY (ACTION(DISCONNECT) | ACTION(PARTITION))
#define CONTROL                                                                                    \
    (ACTION(WRONG_CRC) | ACTION(BUS_OFF) | ACTION(ERROR_FLAG) | ACTION(RESTART) |                  \
     ACTION(COUNTERS) | ACTION(OVERLOAD) | ACTION(SET) | ACTION(SOFTWARE_RESET) |                  \
     ACTION(HARDWARE_RESET))
#define HOST                                                                                       \
    (ACTION(DROP) | ACTION(DELAY) | ACTION(DUPLICATE) | ACTION(REORDER) | ACTION(CHANGE) |         \
     ACTION(COUNTER) | ACTION(CHECKSUM))
#define TRAFFIC                                                                                    \
    (ACTION(SEND) | ACTION(BABBLE) | ACTION(LOAD) | ACTION(REPLY) | ACTION(RAW_FRAME))
#define TIMED (ACTION(PULSE) | ACTION(JITTER) | ACTION(RAMP)) /* they leave the grid */
#define ALL_ACTIONS ((ACTION(COUNT) - 1) & ~TIMED)

#define FD 1
#define RATES 2

#define CLOCKS 1
#define NEAR 2

typedef struct style {
    const char *name;
    unsigned weight; /* scenarios in about 100 */
    unsigned bits_least;
    unsigned bits_most;
    unsigned rules_most;
    uint64_t actions;
    unsigned rarity;  /* see diff_maker */
    unsigned orderly; /* permille of scenarios in which each node has its own identifiers */
    unsigned modes;   /* permille of nodes with modes */
    unsigned ops;     /* operations in 10000 bits, besides traffic */
    unsigned checks;  /* comparisons in 10000 bits */
    bool small;       /* rings and inboxes */
    bool helps;       /* see add_plan_helper() */
    bool lines;       /* see add_line_rule() */
    uint8_t clocks;   /* nodes have clocks of their own; NEAR: which differ by little */
    uint8_t fd;       /* FD: nodes know FD frames, or not; RATES: ... and have a data rate */
} style;

static const style styles[DIFF_STYLES] = {
    {"clean", 9, 10000, 150000, 0, 0, 1, 700, 0, 0, 2, false, false, false, false, false},
    {"ordinary", 13, 10000, 150000, 3, ALL_ACTIONS, 30, 700, 30, 1, 3, false, false, false,
     false, false},
    {"clean, checked often", 6, 4000, 40000, 0, 0, 1, 500, 50, 1, 300, false, false, false,
     false, false},
    {"few faults", 12, 10000, 100000, 4, POSITIONS | ACTION(NOISE) | ACTION(WRONG_CRC), 20, 700,
     0, 6, 10, false, true, false, false, false},
    {"bits", 12, 4000, 60000, 12, POSITIONS | ACTION(NOISE) | ACTION(NO_ACK) | ACTION(OVERLOAD) |
     ACTION(COUNTERS), 3, 500, 50, 2, 40, false, true, false, false, false},
    {"controllers", 8, 4000, 50000, 12, CONTROL | ACTION(FLIP), 3, 500, 100, 10, 40, false,
     false, false, false, false},
    {"levels and wires", 8, 4000, 50000, 8, LEVELS | TOPOLOGY, 4, 500, 50, 5, 40, false, false,
     false, false, false},
    {"lines", 8, 4000, 50000, 40, ACTION(STUCK) | ACTION(FORCE) | ACTION(BABBLE) | ACTION(LOAD),
     4, 900, 20, 2, 20, false, false, true, false, false},
    {"hosts", 6, 4000, 50000, 12, HOST | TRAFFIC, 2, 500, 50, 5, 30, false, false, false, false,
     false},
    {"modes", 8, 4000, 60000, 2, ALL_ACTIONS, 10, 500, 500, 10, 30, false, false, false, false,
     false},
    {"operations", 6, 2000, 30000, 10, ALL_ACTIONS, 4, 500, 100, 100, 40, false, false, false,
     false, false},
    {"small", 6, 8000, 80000, 6, ALL_ACTIONS, 10, 500, 100, 1, 1, true, false, false, false,
     false},
    {"chaos", 6, 2000, 30000, DIFF_RULES_MAX, ALL_ACTIONS, 2, 300, 200, 60, 60, true, false,
     false, false, false},
    {"clocks", 6, 2000, 20000, 12, ALL_ACTIONS | TIMED, 10, 500, 50, 20, 20, false, false, false,
     CLOCKS, false},
    {"clean by own clocks", 6, 4000, 40000, 1, CONTROL, 30, 950, 10, 5, 20, false, false, false,
     NEAR, false},
    {"FD frames", 8, 4000, 60000, 8, ALL_ACTIONS, 10, 500, 50, 20, 40, false, true, false, false,
     FD},
    {"bits of FD frames", 8, 4000, 40000, 12, POSITIONS | ACTION(NOISE) | ACTION(COUNTERS), 3, 700,
     50, 2, 40, false, false, false, false, FD},
    {"data rates", 8, 4000, 60000, 8, ALL_ACTIONS, 10, 500, 50, 20, 40, false, true, false, false,
     RATES},
    {"bits at data rates", 8, 4000, 40000, 12, POSITIONS | ACTION(NOISE) | ACTION(COUNTERS), 3,
     700, 50, 2, 40, false, false, false, false, RATES},
    {"clean at data rates", 12, 4000, 40000, 0, 0, 1, 700, 0, 100, 10, false, false, false, false,
     RATES},
    {"clocks at data rates", 12, 4000, 40000, 3, TOPOLOGY | ACTION(BUS_OFF) | ACTION(RESTART) |
     ACTION(SET), 20, 700, 200, 100, 10, false, false, false, CLOCKS, RATES},
};

const char *diff_style_name(unsigned number)
{
    return styles[number].name;
}

static unsigned random_style(diff_random *r)
{
    unsigned all = 0;
    for (unsigned i = 0; i < DIFF_STYLES; i++)
        all += styles[i].weight;
    unsigned drawn = (unsigned)diff_below(r, all);
    unsigned i = 0;
    for (; drawn >= styles[i].weight; i++)
        drawn -= styles[i].weight;
    return i;
}

/* ---- The bus --------------------------------------------------------------------------------- */

typedef struct generator {
    diff_maker maker;
    diff_scenario *scenario;
    const style *style;
    bool pure;        /* all nodes know FD frames, so that most of these are clean */
    bool old;         /* some nodes are of CAN 2.0A or 2.0B passive */
    bool hosts;       /* some nodes have filters, or slow hosts */
    bool variants;    /* some nodes are not as RULES.md says */
    bool times;       /* some nodes have local time, or schedules */
    unsigned names;   /* of rules, used so far */
    diff_op *moments; /* of the frames handed in, by the tick at which they come up */
    size_t moment_count;
    size_t next_moment;
} generator;

static unsigned random_node_count(diff_random *r)
{
    unsigned drawn = (unsigned)diff_below(r, 100);
    if (diff_chance(r, 10))
        return 1;
    if (drawn < 30)
        return (unsigned)diff_between(r, 2, 3);
    if (drawn < 75)
        return (unsigned)diff_between(r, 4, 8);
    if (drawn < 88)
        return (unsigned)diff_between(r, 9, 20);
    return drawn < 92 ? (unsigned)diff_between(r, 21, 63) : CW_NODES_MAX;
}

static uint32_t random_bit_ticks(diff_random *r)
{
    static const uint32_t rare[] = {CW_CLOCK_HZ, UINT32_MAX};
    static const uint16_t usual[] = {80, 100, 160, 320, 640, 1600};
    static const uint16_t odd[] = {1, 2, 3, 7, 97, 8000};
    if (diff_chance(r, 10))
        return rare[diff_below(r, 2)];
    return diff_chance(r, 850) ? usual[diff_below(r, 6)] : odd[diff_below(r, 6)];
}

/* NON_ISO is that of the whole bus. */
static uint8_t random_protocol(diff_random *r)
{
    unsigned protocol = diff_chance(r, 800) ? CW_FD : (unsigned)diff_below(r, 2);
    if (diff_chance(r, 200))
        protocol |= CW_PROTOCOL_NO_EXCEPTION;
    return (uint8_t)protocol;
}

const cw_filter diff_filters[DIFF_FILTERS] = {
    {.value = 0x100, .mask = 0x700},
    {.value = 0x001, .mask = CW_FILTER_BASE_MASK, .inverted = true},
    {.value = CW_FILTER_EXTENDED, .mask = CW_FILTER_EXTENDED | 1}};

#define BASE(number) {.value = 0x100 + (number), .mask = CW_FILTER_BASE_MASK}
#define EXTENDED(number) \
    {.value = CW_FILTER_EXTENDED | (0x100 + (number)), .mask = CW_FILTER_EXTENDED_MASK}

const cw_mailbox diff_mailboxes[DIFF_MAILBOXES] = {
    {.use = CW_MAILBOX_TRANSMIT},
    {.use = CW_MAILBOX_REPLY, .filter = BASE(0), .filled = true, .frame = {.id = 0x100, .dlc = 2}},
    {.use = CW_MAILBOX_RECEIVE, .filter = {.value = 0x100, .mask = 0x700}},
    {.use = CW_MAILBOX_REPLY, .filter = BASE(1)},
    {.use = CW_MAILBOX_TRANSMIT, .filter = {.value = 0, .mask = 1}},
    {.use = CW_MAILBOX_RECEIVE},
    {.use = CW_MAILBOX_REPLY, .filter = EXTENDED(0)},
    {.use = CW_MAILBOX_TRANSMIT, .filter = {.value = 0x101, .mask = CW_FILTER_BASE_MASK,
                                            .inverted = true}},
    {.use = CW_MAILBOX_RECEIVE, .filter = BASE(1)},
    {.use = CW_MAILBOX_RECEIVE, .filter = {.value = CW_FILTER_REMOTE, .mask = CW_FILTER_REMOTE}},
    {.use = CW_MAILBOX_TRANSMIT},
    {.use = CW_MAILBOX_REPLY, .filter = BASE(2)},
    {.use = CW_MAILBOX_RECEIVE},
    {.use = CW_MAILBOX_TRANSMIT, .filter = {.value = 0x100, .mask = 0x700}},
    {.use = CW_MAILBOX_RECEIVE},
    {.use = CW_MAILBOX_TRANSMIT}};

/* Some of the mailboxes, in a row. */
static void random_mailboxes(diff_random *r, cw_host_config *host)
{
    const unsigned first = (unsigned)diff_below(r, DIFF_MAILBOXES);
    host->mailboxes = diff_mailboxes + first;
    host->mailbox_count = (uint8_t)diff_between(r, 1, DIFF_MAILBOXES - first);
    host->receive_fifo = diff_chance(r, 300);
    host->transmit = (cw_transmit)diff_below(r, CW_TRANSMIT_COUNT);
}

/* Gives some frames of the traffic the identifiers of mailboxes with replies. */
static void use_mailboxes(diff_maker *m)
{
    for (unsigned i = 0; i < m->frame_count; i++) {
        cw_frame *frame = &m->frames[i];
        if (!diff_chance(&m->random, 600))
            continue;
        frame->id = 0x100 + (uint32_t)diff_below(&m->random, 3);
        if (!(frame->flags & CW_FRAME_FD) && diff_chance(&m->random, 400))
            frame->flags |= CW_FRAME_REMOTE;
    }
}

/* Filters, mailboxes, and a host that is slow or very slow. */
static cw_host_config random_host(diff_maker *m)
{
    diff_random *r = &m->random;
    cw_host_config host = {.filters = diff_filters};
    if (diff_chance(r, 400))
        host.filter_count = (uint16_t)diff_between(r, 1, DIFF_FILTERS);
    if (diff_chance(r, 600)) {
        host.receive_buffers = (uint16_t)diff_magnitude(r, 1, CW_RECEIVE_BUFFERS_MAX);
        host.service_ticks = diff_random_ticks(m, 1, 1000);
        host.overload_when_full = diff_chance(r, 300);
        host.receive_bytes = diff_chance(r, 200) ? (uint16_t)diff_between(r, 16, 64) : 0;
    }
    if (m->mailboxes && diff_chance(r, 600))
        random_mailboxes(r, &host);
    return host;
}

#define TRIGGER(at_, slot_, cycle_, repeat_, id_)                                                  \
    {                                                                                              \
        .at = at_, .slot = slot_, .cycle = cycle_, .repeat = repeat_,                              \
        .frame = {.id = id_, .dlc = 2}                                                             \
    }

const cw_time_trigger diff_master[DIFF_TRIGGERS] = {
    TRIGGER(0, 30, 0, 0, 0x111),   TRIGGER(150, 1, 1, 2, 0x112), TRIGGER(151, 60, 0, 0, 0x300),
    TRIGGER(300, 200, 0, 3, 0x007), TRIGGER(301, 9, 2, 4, 0x055), TRIGGER(650, 40, 0, 0, 0x010)};

const cw_time_trigger diff_slave[DIFF_TRIGGERS] = {
    TRIGGER(2, 70, 0, 0, 0x113),    TRIGGER(90, 60, 0, 2, 0x555), TRIGGER(150, 3, 1, 2, 0x10F),
    TRIGGER(300, 200, 0, 0, 0x006), TRIGGER(500, 1, 0, 0, 0x200), TRIGGER(640, 90, 0, 0, 0x400)};

/* A clock with a few units in each bit, or a few bits in each unit. The reference message is that
 * of the master, or any other one, too. */
static void random_time(generator *g, cw_node_config *node)
{
    diff_maker *m = &g->maker;
    diff_random *r = &m->random;
    const uint64_t bit = m->bit * (uint64_t)CW_TICK, parts = diff_magnitude(r, 1, 40);
    cw_schedule *s = &node->schedule;
    const uint64_t unit = diff_chance(r, 700) ? bit / parts : bit * parts / 8;
    if (unit < (uint64_t)CW_TICK || unit > (uint64_t)CW_LOCAL_UNIT_MAX)
        return;
    node->local = (cw_local_time){.unit = (cw_span)unit, .at_eof = diff_chance(r, 500)};
    node->local.bits = (uint8_t)diff_between(r, CW_LOCAL_BITS_MIN, CW_LOCAL_BITS_MAX);
    node->local.start = (uint32_t)diff_below(r, UINT64_C(1) << node->local.bits);
    if (diff_chance(r, 200))
        return;
    if (diff_chance(r, 800))
        node->modes |= CW_MODE_TIME_TRIGGERED;
    s->reference = (cw_filter){.value = 0x010, .mask = diff_chance(r, 800) ? 0x7FF : 0x01F};
    s->cycles = (uint8_t)diff_magnitude(r, 1, 8);
    s->cycle_byte = (uint8_t)diff_below(r, 9);
    const bool master = diff_chance(r, 400);
    s->trigger_count = (uint16_t)(master ? DIFF_TRIGGERS : diff_below(r, DIFF_TRIGGERS + 1));
    s->triggers = master ? diff_master : diff_slave;
}

static cw_node_config random_node(generator *g)
{
    diff_maker *m = &g->maker;
    diff_random *r = &m->random;
    cw_node_config node = {.order = CW_ORDER_PRIORITY, .queue = 16, .warning_limit = 96};
    if (diff_chance(r, g->style->modes))
        node.modes = (uint8_t)diff_random_modes(m);
    if (diff_chance(r, 300))
        node.order = CW_ORDER_FIFO;
    if (diff_chance(r, 500))
        node.queue = (uint16_t)diff_magnitude(r, 1, 32);
    if (diff_chance(r, 200))
        node.warning_limit = (uint16_t)diff_magnitude(r, 1, 255);
    if (diff_chance(r, 600))
        node.restart_ticks = diff_random_ticks(m, 1, 3000);
    if (m->rates)
        node.timing = m->common;
    if (m->clocks && m->bit <= DIFF_TIMED_BIT_MAX)
        diff_random_timing(m, &node.timing);
    if (m->rates && diff_chance(r, 10)) /* it does not go together with the others */
        diff_random_rates(m, &node.timing);
    if (g->hosts && diff_chance(r, 500))
        node.host = random_host(m);
    if (m->sleeps) {
        node.sleeps = diff_chance(r, 200);
        node.sleep = diff_random_sleep(m);
    }
    if (g->times && diff_chance(r, 600))
        random_time(g, &node);
    if (m->fd)
        node.protocol = g->pure ? CW_FD : random_protocol(r);
    if (g->old && (node.protocol & CW_PROTOCOL_MASK) == CW_CLASSICAL && diff_chance(r, 300))
        node.protocol |= diff_chance(r, 500) ? CW_PROTOCOL_2_0A : CW_PROTOCOL_2_0B_PASSIVE;
    if (g->variants && diff_chance(r, 300))
        node.variants = (uint8_t)diff_between(r, 1, 15);
    return node;
}

static void add_plan_rule(generator *g, diff_plan *plan)
{
    plan->rules[plan->config.rule_count++] =
        (diff_rule){.rule = diff_random_rule(&g->maker), .name = g->names++ % DIFF_NAMES};
}

/* Adds rules that cause the rare fields: suspend, overload frames. */
static void add_plan_helper(generator *g, diff_plan *plan, unsigned first)
{
    static const cw_rule helpers[] = {
        {.action = CW_ACTION_OVERLOAD, .trigger = CW_TRIGGER_ARMED, .number = 1, .manual = true},
        {.action = CW_ACTION_FLIP, .field = CW_FIELD_OVERLOAD_FLAG, .bits = 1},
        {.action = CW_ACTION_DUPLICATE, .trigger = CW_TRIGGER_FRAME}, /* so that others follow */
        {.action = CW_ACTION_STUCK, .trigger = CW_TRIGGER_ARMED, .level = CW_RECESSIVE,
         .has_after = true}, /* at once, perhaps in the middle of a frame */
        {.action = CW_ACTION_OVERLOAD, .trigger = CW_TRIGGER_ARMED, .number = 1, .has_after = true},
        {.action = CW_ACTION_COUNTERS, .trigger = CW_TRIGGER_TIME, .tec = 200, .rec = CW_KEEP},
        {.action = CW_ACTION_OVERLOAD, .trigger = CW_TRIGGER_FRAME, .number = 1},
        {.action = CW_ACTION_NOISE, .trigger = CW_TRIGGER_TIME},
        {.action = CW_ACTION_ERROR_FLAG, .trigger = CW_TRIGGER_ARMED, .has_after = true}};
    diff_random *r = &g->maker.random;
    unsigned place = plan->config.rule_count - 1u;
    cw_rule *rule = &plan->rules[place].rule;
    *rule = helpers[(first + place) % (sizeof helpers / sizeof helpers[0])];
    rule->nodes = diff_random_nodes(&g->maker);
    rule->time_end = CW_NEVER;
    rule->probability = UINT64_MAX;
    rule->every = (uint32_t)diff_between(r, 1, g->maker.rarity);
    rule->index = (uint16_t)diff_below(r, 6);
    rule->error_rate = UINT64_MAX / diff_magnitude(r, 50, 100000);
    if (rule->action == CW_ACTION_NOISE && diff_chance(r, 300))
        rule->burst_most = rule->burst_least = (uint16_t)diff_between(r, 2, CW_BURST_MAX);
    if (rule->action == CW_ACTION_NOISE && diff_chance(r, 500))
        rule->at = diff_random_nodes(&g->maker);
    if (rule->has_after) {
        rule->after =
            (uint16_t)(diff_chance(r, 500) && place > 0 ? place - 1u : diff_below(r, place + 1u));
        rule->after_delay = diff_random_ticks(&g->maker, 1, 200);
    }
    if (rule->action == CW_ACTION_STUCK) {
        rule->for_ticks = diff_random_ticks(&g->maker, 1, 30);
        rule->after_delay = 0;
    }
}

/* Makes a line stuck for a while, mostly so that the other nodes can go on without it. Or it forces
 * levels from one frame on for so long that the next ones have begun. */
static void add_line_rule(generator *g, diff_plan *plan)
{
    diff_maker *m = &g->maker;
    diff_random *r = &m->random;
    cw_rule *rule = &plan->rules[plan->config.rule_count - 1u].rule;
    bool forced = diff_chance(r, 300);
    *rule = (cw_rule){.action = forced ? CW_ACTION_FORCE : CW_ACTION_STUCK,
                      .trigger = forced ? CW_TRIGGER_FRAME : CW_TRIGGER_TIME,
                      .field = CW_FIELD_INTERMISSION, .bits = 1, .time_end = CW_NEVER,
                      .every = 1, .probability = UINT64_MAX};
    rule->node = (uint8_t)diff_below(r, m->nodes);
    rule->time_begin = diff_below(r, m->bits * m->bit);
    rule->level = diff_chance(r, 800);
    rule->line = diff_chance(r, 600) ? CW_LINE_TX : (cw_line)diff_below(r, 3);
    rule->for_ticks = diff_random_ticks(m, 1, forced || rule->line != CW_LINE_TX ? 60 : 20000);
    rule->dominant_timeout = diff_random_ticks(m, 1, 20);
    if (diff_chance(r, 500))
        rule->at = diff_random_nodes(m);
    if (forced) {
        const cw_frame *f = &m->frames[diff_below(r, m->frame_count)];
        rule->filter_count = 1;
        rule->filters[0] = (cw_filter){.value = f->id, .mask = 0x7FF};
    }
}

/* Makes a fault in counters or checksums, of which the bus has some. */
static void add_making_rule(generator *g, diff_plan *plan)
{
    diff_random *r = &g->maker.random;
    cw_rule *rule = &plan->rules[plan->config.rule_count - 1u].rule;
    *rule = (cw_rule){.action = diff_chance(r, 600) ? CW_ACTION_COUNTER : CW_ACTION_CHECKSUM,
                      .trigger = CW_TRIGGER_FRAME, .time_end = CW_NEVER, .every = 1,
                      .probability = UINT64_MAX};
    rule->every = (uint32_t)diff_between(r, 1, 2 * g->maker.rarity);
    rule->number = (uint32_t)diff_below(r, CW_COUNTER_FAULTS);
}

/* Returns true when the library accepts the configuration. */
static bool is_accepted(diff_plan *plan)
{
    cw_rule rules[DIFF_RULES_MAX];
    const cw_bus_config *config = diff_fill_in(plan, rules);
    size_t size = cw_bus_size(config);
    void *memory = size ? malloc(size) : NULL;
    bool accepted = memory && cw_bus_init(memory, config);
    free(memory);
    return accepted;
}

/* Makes rules without those that the library refuses, which make the whole configuration
 * invalid. */
static void random_rules(generator *g, diff_plan *plan, unsigned count)
{
    unsigned first = (unsigned)diff_below(&g->maker.random, 100);
    unsigned helped = g->style->helps && diff_chance(&g->maker.random, 300) ? 600 : 0;
    g->maker.rules = count;
    plan->config.rule_room = (uint16_t)(count + diff_below(&g->maker.random, 6));
    for (unsigned i = 0; i < count; i++) {
        add_plan_rule(g, plan);
        if (diff_chance(&g->maker.random, helped))
            add_plan_helper(g, plan, first);
        if (g->style->lines && diff_chance(&g->maker.random, 900))
            add_line_rule(g, plan);
        if (plan->config.protection_count > 0 && (g->style->actions & ACTION(COUNTER)) &&
            diff_chance(&g->maker.random, 200))
            add_making_rule(g, plan);
        plan->config.rule_room--;
        if (is_accepted(plan))
            continue;
        plan->config.rule_count--;
        plan->config.rule_room++;
    }
}

static unsigned random_rule_count(generator *g)
{
    diff_random *r = &g->maker.random;
    unsigned most = g->style->rules_most;
    return (unsigned)(diff_chance(r, 300) ? most : diff_between(r, most > 0, most));
}

static void random_plan(generator *g, diff_plan *plan)
{
    diff_random *r = &g->maker.random;
    *plan = (diff_plan){
        .config = {.bit_ticks = (uint32_t)g->maker.bit, .node_count = (uint8_t)g->maker.nodes}};
    plan->config.seed = diff_draw(r);
    plan->config.inbox = (uint16_t)diff_magnitude(r, 64, 4096);
    plan->config.events = (uint16_t)diff_magnitude(r, 64, 8192);
    plan->config.start_at_tick = plan->config.seed % 6 == 0;
    if (g->style->small) {
        plan->config.inbox = (uint16_t)diff_magnitude(r, 1, 64);
        plan->config.events = 0;
    }
    const bool non_iso = g->maker.fd && diff_chance(r, 100);
    for (unsigned i = 0; i < g->maker.nodes; i++) {
        plan->nodes[i] = random_node(g);
        plan->nodes[i].protocol |= non_iso ? CW_PROTOCOL_NON_ISO : 0;
    }
    if (diff_chance(r, g->style->actions & ACTION(COUNTER) ? 500 : 100))
        diff_random_protections(&g->maker, plan);
    random_rules(g, plan, random_rule_count(g));
}

/* ---- Frames ---------------------------------------------------------------------------------- */

/* Identifiers that go together for long: neighbours, base and extended with the same first bits. */
static cw_frame related_frame(diff_random *r, const cw_frame *to)
{
    cw_frame f = *to;
    bool extended = f.flags & CW_FRAME_EXTENDED;
    switch (diff_below(r, 4)) {
    case 0:
        f.id ^= 1u << diff_below(r, extended ? 29 : 11);
        break;
    case 1:
        f.flags ^= CW_FRAME_REMOTE;
        break;
    case 2:
        f.id = extended ? f.id >> 18 : (f.id << 18) | (uint32_t)(diff_draw(r) & 0x3FFFF);
        f.flags ^= CW_FRAME_EXTENDED;
        break;
    default:
        f.dlc = (uint8_t)diff_below(r, 9);
        break;
    }
    return f;
}

static cw_frame new_frame(diff_random *r)
{
    static const uint32_t ids[] = {0x000, 0x7FF, 0x123, 0x555, 0x001, 0x7F0};
    cw_frame f = {.id = ids[diff_below(r, 6)]};
    f.dlc = (uint8_t)diff_below(r, 9);
    if (diff_chance(r, 600))
        f.id = (uint32_t)diff_below(r, 0x800);
    if (diff_chance(r, 300)) {
        f.flags |= CW_FRAME_EXTENDED;
        f.id = (uint32_t)diff_below(r, 0x20000000);
    }
    if (diff_chance(r, 80))
        f.flags |= CW_FRAME_REMOTE;
    if (diff_chance(r, 30))
        f.dlc = (uint8_t)diff_between(r, 9, 15);
    return f;
}

/* Half of the frames of a bus with FD are FD frames; neighbours have the other format. */
static void choose_formats(diff_maker *m)
{
    for (unsigned i = 0; m->fd && i < m->frame_count; i++)
        if (i % 2)
            diff_change_format(m, &m->frames[i]);
}

static void random_frames(diff_maker *m)
{
    diff_random *r = &m->random;
    unsigned related = diff_chance(r, 500) ? 700 : 100;
    m->frame_count = (unsigned)diff_between(r, 1, sizeof m->frames / sizeof m->frames[0]);
    for (unsigned i = 0; i < m->frame_count; i++)
        m->frames[i] = i > 0 && diff_chance(r, related)
                           ? related_frame(r, &m->frames[diff_below(r, i)])
                           : new_frame(r);
    if (m->mailboxes)
        use_mailboxes(m);
    choose_formats(m);
}

/* ---- Traffic --------------------------------------------------------------------------------- */

static unsigned random_node_number(generator *g)
{
    return (unsigned)diff_below(&g->maker.random, g->maker.nodes);
}

/* Hands in a frame at its time, long before it, or too late. */
static void send(generator *g, unsigned node, const cw_frame *frame, uint64_t at_tick)
{
    diff_random *r = &g->maker.random;
    diff_op op = {.kind = DIFF_SEND, .tick = at_tick, .target = node, .send = {.at_tick = at_tick}};
    op.send.frame = diff_owned_frame(&g->maker, frame, node);
    uint64_t lead = diff_magnitude(r, 1, 600 * g->maker.bit);
    if (g->style->small || diff_chance(r, 500))
        op.tick = lead < at_tick ? at_tick - lead : 0;
    else if (diff_chance(r, 100))
        op.tick = at_tick + lead;
    if (diff_chance(r, 2))
        op.send.at_tick = diff_random_ticks(&g->maker, 1, 1000000);
    diff_add_op(g->scenario, &op);
}

static uint64_t random_tick(generator *g)
{
    diff_maker *m = &g->maker;
    uint64_t tick = diff_below(&m->random, m->bits) * m->bit;
    switch (diff_below(&m->random, 4)) {
    case 0:
        return tick;
    case 1:
        return tick + 1;
    case 2:
        return tick + m->bit - 1;
    default:
        return tick + diff_below(&m->random, m->bit);
    }
}

/* Sends one frame of a node repeatedly. */
static void periodic(generator *g, uint64_t frames)
{
    diff_maker *m = &g->maker;
    diff_random *r = &m->random;
    cw_frame frame = diff_random_frame(m);
    unsigned node = random_node_number(g);
    uint64_t period = m->bits * m->bit / (frames + 1);
    uint64_t jitter = diff_chance(r, 500) ? 0 : period / 4;
    bool same = diff_chance(r, 300);
    for (uint64_t i = 0, tick = diff_below(r, period + 1); i < frames; i++, tick += period) {
        if (!same)
            frame = diff_random_frame(m);
        send(g, node, &frame, tick + diff_below(r, jitter + 1));
    }
}

/* Sends many frames of one node at a time. */
static void bursts(generator *g, uint64_t frames)
{
    diff_random *r = &g->maker.random;
    while (frames > 0) {
        unsigned node = random_node_number(g);
        uint64_t tick = random_tick(g);
        uint64_t burst = diff_between(r, 1, 20);
        for (; frames > 0 && burst > 0; frames--, burst--) {
            const cw_frame frame = diff_random_frame(&g->maker);
            send(g, node, &frame, tick);
        }
    }
}

/* Sends frames of several nodes that meet: in one bit, just before or after it, or within SOF and
 * the arbitration of each other. */
static void meetings(generator *g, uint64_t frames)
{
    diff_maker *m = &g->maker;
    diff_random *r = &m->random;
    while (frames > 0) {
        uint64_t tick = random_tick(g);
        uint64_t spread = diff_chance(r, 300) ? 1 : diff_magnitude(r, 1, 40 * m->bit);
        cw_frame frame = diff_random_frame(m);
        bool same = diff_chance(r, 250);
        uint64_t party = diff_between(r, 2, m->nodes > 2 ? m->nodes : 2);
        for (; frames > 0 && party > 0; frames--, party--) {
            if (!same)
                frame = diff_random_frame(m);
            unsigned node = random_node_number(g);
            send(g, node, &frame, tick + diff_below(r, spread));
        }
    }
}

static void scattered(generator *g, uint64_t frames)
{
    for (; frames > 0; frames--) {
        const cw_frame frame = diff_random_frame(&g->maker);
        unsigned node = random_node_number(g);
        send(g, node, &frame, random_tick(g));
    }
}

static void bad_frames(generator *g, uint64_t frames)
{
    diff_random *r = &g->maker.random;
    for (; frames > 0; frames--) {
        cw_frame frame = diff_random_frame(&g->maker);
        if (diff_chance(r, 500))
            frame.id |= 0x20000000u;
        else if (diff_chance(r, 500))
            frame.flags |= CW_FRAME_FD;
        else
            frame.dlc = (uint8_t)diff_between(r, 16, 255);
        unsigned node = (unsigned)diff_below(r, g->maker.nodes + 1);
        send(g, node, &frame, random_tick(g));
    }
}

/* Sends frames one after the other, of which few meet. Some of them are handed in together. */
static void in_turn(generator *g)
{
    diff_maker *m = &g->maker;
    diff_random *r = &m->random;
    uint64_t left = 0, handed_in = 0;
    for (uint64_t bit = 0; bit < m->bits; bit += diff_between(r, 100, 250), left--) {
        const uint64_t tick = bit * m->bit + diff_below(r, m->bit);
        const unsigned node = random_node_number(g);
        diff_op op = {.kind = DIFF_SEND, .target = node, .send = {.at_tick = tick}};
        if (left == 0) {
            left = diff_magnitude(r, 1, 50);
            handed_in = tick;
        }
        const cw_frame frame = diff_random_frame(m);
        op.tick = handed_in;
        op.send.frame = diff_owned_frame(m, &frame, node);
        diff_add_op(g->scenario, &op);
    }
}

/* Makes traffic from an almost empty bus to one that is overloaded. */
static void random_traffic(generator *g)
{
    static void (*const patterns[])(generator *, uint64_t) = {periodic, periodic, bursts, meetings,
                                                              scattered};
    diff_random *r = &g->maker.random;
    uint64_t frames = g->maker.bits / diff_magnitude(r, 60, diff_chance(r, 700) ? 240 : 4000);
    if (g->maker.near && diff_chance(r, 800)) {
        in_turn(g);
        return;
    }
    while (frames > 0) {
        uint64_t part = diff_between(r, 1, frames > 400 ? 400 : frames);
        patterns[diff_below(r, 5)](g, part);
        frames -= part;
    }
    if (g->style->ops >= 10 && diff_chance(r, 400))
        bad_frames(g, diff_between(r, 1, 6));
}

/* ---- Operations ------------------------------------------------------------------------------ */

static void add_take_over(generator *g, uint64_t tick)
{
    diff_maker *m = &g->maker;
    diff_scenario *s = g->scenario;
    diff_op op = {.kind = DIFF_TAKE_OVER, .tick = tick, .target = s->plan_count};
    unsigned before = m->nodes;
    uint64_t kept = 0;
    if (s->plan_count == DIFF_PLANS_MAX)
        return;
    if (diff_chance(&m->random, 500))
        m->nodes = random_node_count(&m->random);
    random_plan(g, &s->plans[s->plan_count++]);
    for (unsigned i = 0; i < CW_NODES_MAX; i++) {
        unsigned from = diff_chance(&m->random, 700) ? i : random_node_number(g);
        bool twice = kept >> from & 1u;
        bool free = from < before && !diff_chance(&m->random, twice ? 999 : 100);
        op.from[i] = i < m->nodes && free ? (uint8_t)from : CW_NO_NODE;
        kept |= op.from[i] == CW_NO_NODE ? 0 : UINT64_C(1) << from;
    }
    for (unsigned i = 0; i < before; i++)
        if (!(kept >> i & 1u) && diff_chance(&m->random, 900))
            diff_add_op(s, &(diff_op){.kind = DIFF_FLUSH, .tick = tick, .target = i});
    diff_add_op(s, &op);
}

static void add_rule(generator *g, uint64_t tick)
{
    diff_scenario *s = g->scenario;
    if (s->added_count == DIFF_RULES_MAX || g->style->rules_most == 0)
        return;
    diff_add_op(s, &(diff_op){.kind = DIFF_ADD_RULE, .tick = tick, .target = s->added_count});
    s->added[s->added_count++] =
        (diff_rule){.rule = diff_random_rule(&g->maker), .name = g->names++ % DIFF_NAMES};
}

static void merge(diff_op *to, const diff_op *a, size_t a_count, const diff_op *b, size_t b_count)
{
    while (a_count > 0 || b_count > 0) {
        bool first = b_count == 0 || (a_count > 0 && a->tick <= b->tick);
        *to++ = first ? *a++ : *b++;
        a_count -= first;
        b_count -= !first;
    }
}

/* Sorts operations by tick; those of one tick keep their order. */
static void sort_ops(diff_op *ops, size_t count, diff_op *room)
{
    if (count < 2)
        return;
    size_t half = count / 2;
    sort_ops(ops, half, room);
    sort_ops(ops + half, count - half, room);
    merge(room, ops, half, ops + half, count - half);
    memcpy(ops, room, count * sizeof ops[0]);
}

static diff_op_kind random_op_kind(diff_random *r)
{
    static const struct {
        diff_op_kind kind;
        unsigned weight;
    } often[] = {{DIFF_RESTART, 10},  {DIFF_ADD_RULE, 24},  {DIFF_CLEAR_RULE, 8},
                 {DIFF_STOP_RULE, 6}, {DIFF_FIRE_RULE, 20}, {DIFF_SET, 20},
                 {DIFF_FLUSH, 1},     {DIFF_ATTACH, 16},    {DIFF_SET_EVENTS, 3},
                 {DIFF_STEPPING, 5},  {DIFF_WATCHING, 7},   {DIFF_TAKE_OVER, 4},
                 {DIFF_BRING_FORWARD, 4}};
    unsigned drawn = (unsigned)diff_below(r, 128);
    unsigned i = 0;
    for (; drawn >= often[i].weight; i++)
        drawn -= often[i].weight;
    return often[i].kind;
}

/* Picks a moment, mostly during the arbitration or transmission of a frame, and mostly its
 * sender. */
static uint64_t pick_moment(generator *g, unsigned *node, uint64_t from, uint64_t step)
{
    diff_random *r = &g->maker.random;
    while (g->next_moment < g->moment_count && g->moments[g->next_moment].tick < from)
        g->next_moment++;
    *node = random_node_number(g);
    if (g->next_moment == g->moment_count || diff_chance(r, 400))
        return from + diff_below(r, step);
    if (diff_chance(r, 500))
        *node = g->moments[g->next_moment].target;
    return g->moments[g->next_moment].tick +
           diff_below(r, diff_magnitude(r, 1, 150) * g->maker.bit);
}

static void find_moments(generator *g)
{
    const diff_scenario *s = g->scenario;
    g->moments = diff_allocate(NULL, 2 * s->op_count * sizeof s->ops[0]); /* half of it to sort */
    for (unsigned i = 0; i < s->op_count; i++) {
        if (s->ops[i].kind != DIFF_SEND || s->ops[i].send.at_tick >= s->end)
            continue; /* bits up to the end of time are too many */
        diff_op *moment = &g->moments[g->moment_count++];
        *moment = s->ops[i];
        moment->tick = moment->send.at_tick;
    }
    sort_ops(g->moments, g->moment_count, g->moments + s->op_count);
}

/* Picks any rule; for firing mostly one that can be fired. */
static unsigned pick_rule(generator *g, bool fired)
{
    const diff_plan *plan = &g->scenario->plans[g->scenario->plan_count - 1];
    unsigned rule = 0;
    for (unsigned tries = 0; tries < 8; tries++) {
        rule = (unsigned)diff_below(&g->maker.random, plan->config.rule_count + 3u);
        if (!fired || (rule < plan->config.rule_count && plan->rules[rule].rule.manual))
            break;
    }
    return rule;
}

/* Makes several nodes begin to send, of which one does not go on. */
static void ambush(generator *g, uint64_t tick)
{
    diff_maker *m = &g->maker;
    diff_random *r = &m->random;
    diff_op op = {.kind = DIFF_ATTACH,
                  .tick = tick + diff_below(r, diff_magnitude(r, 1, 35) * m->bit)};
    tick -= tick % m->bit;
    for (uint64_t party = diff_between(r, 2, 5); party > 0; party--) {
        op.target = random_node_number(g);
        const cw_frame frame = diff_random_frame(m);
        send(g, op.target, &frame, tick);
    }
    if (diff_chance(r, 200)) {
        op.kind = DIFF_SET;
        op.settings = diff_random_settings(m);
    }
    diff_add_op(g->scenario, &op);
    op.kind = DIFF_ATTACH;
    op.on = true;
    op.tick += diff_below(r, 2000 * m->bit);
    diff_add_op(g->scenario, &op);
}

/* Takes a node out of its frame, mostly in the data phase, and lets it join again later. */
static void leave_data_phase(generator *g, uint64_t tick)
{
    diff_maker *m = &g->maker;
    diff_random *r = &m->random;
    diff_op op = {.kind = DIFF_SET, .target = random_node_number(g)};
    op.settings.which = CW_SET_MODES;
    op.settings.modes_mask = CW_MODE_LISTEN_ONLY;
    op.settings.modes = CW_MODE_LISTEN_ONLY;
    cw_frame frame = diff_random_frame(m);
    frame.flags = (uint8_t)((frame.flags & CW_FRAME_EXTENDED) | CW_FRAME_FD | CW_FRAME_BRS);
    frame.dlc = (uint8_t)diff_between(r, 8, 15);
    send(g, op.target, &frame, tick);
    op.tick = tick + diff_below(r, diff_magnitude(r, 30, 300) * m->bit);
    diff_add_op(g->scenario, &op);
    op.settings.modes = 0;
    op.tick += diff_below(r, 500 * m->bit);
    diff_add_op(g->scenario, &op);
}

static void add_operation(generator *g, uint64_t tick, unsigned node)
{
    diff_random *r = &g->maker.random;
    diff_op op = {.kind = random_op_kind(r), .tick = tick};
    op.at_once = diff_chance(r, 100);
    bool on_rule = op.kind >= DIFF_CLEAR_RULE && op.kind <= DIFF_FIRE_RULE;
    if (op.kind == DIFF_ADD_RULE) {
        add_rule(g, tick);
        return;
    }
    if (op.kind == DIFF_TAKE_OVER) {
        add_take_over(g, tick);
        return;
    }
    op.target = on_rule ? pick_rule(g, op.kind == DIFF_FIRE_RULE) : node;
    if (op.kind == DIFF_SET)
        op.settings = diff_random_settings(&g->maker);
    if (op.kind == DIFF_STEPPING)
        op.on = diff_chance(r, 300);
    if (op.kind == DIFF_WATCHING)
        op.on = diff_chance(r, 500);
    if (op.kind == DIFF_BRING_FORWARD)
        op.ticks = diff_below(r, diff_magnitude(r, 1, 500) * g->maker.bit);
    if (op.kind == DIFF_ATTACH)
        op.on = diff_chance(r, 650);
    if (op.kind == DIFF_SET_EVENTS) /* all but a few kinds */
        op.kinds = (uint32_t)(UINT32_MAX & ~(diff_draw(r) & diff_draw(r) & diff_draw(r)));
    diff_add_op(g->scenario, &op);
}

/* Makes operations in the order of time, since take-overs change the meaning of later ones. */
static void random_operations(generator *g)
{
    uint64_t count = g->maker.bits * g->style->ops / 10000;
    uint64_t step = g->maker.bits * g->maker.bit / (count + 1);
    unsigned node;
    find_moments(g);
    for (uint64_t i = 0; i < count; i++) {
        uint64_t tick = pick_moment(g, &node, i * step, step);
        if (g->maker.rates && diff_chance(&g->maker.random, 500))
            leave_data_phase(g, tick);
        else if (diff_chance(&g->maker.random, 300))
            ambush(g, tick);
        else
            add_operation(g, tick, node);
    }
    free(g->moments);
}

/* Kinds of unwanted events let the bus leave out more. */
static void choose_events(generator *g)
{
    diff_random *r = &g->maker.random;
    diff_op op = {.kind = DIFF_SET_EVENTS,
                  .kinds = UINT32_MAX & ~(1u << CW_EVENT_ARBITRATION_LOST)};
    if (g->maker.near && diff_chance(r, 900))
        op.kinds &= ~(1u << CW_EVENT_SYNC);
    if (g->maker.near && diff_chance(r, 300))
        op.kinds &= ~(1u << CW_EVENT_RX);
    if (diff_chance(r, 200))
        op.kinds &= ~((uint32_t)diff_draw(r) & (uint32_t)diff_draw(r));
    if (diff_chance(r, g->style->lines ? 800 : 300))
        diff_add_op(g->scenario, &op);
}

static void random_checks(generator *g)
{
    for (uint64_t i = g->maker.bits * g->style->checks / 10000; i > 0; i--)
        diff_add_op(g->scenario, &(diff_op){.kind = DIFF_CHECK, .tick = random_tick(g)});
}

/* Compares after each bit for a while. A fast bus that is watched shows all of these bits. */
static void check_each_bit(generator *g)
{
    uint64_t tick = random_tick(g);
    if (diff_chance(&g->maker.random, 500))
        diff_add_op(g->scenario,
                    &(diff_op){.kind = DIFF_WATCHING, .tick = tick, .on = true});
    for (unsigned i = 0; i < 150; i++, tick += g->maker.bit)
        diff_add_op(g->scenario, &(diff_op){.kind = DIFF_CHECK, .tick = tick});
}

static void random_lengths(diff_scenario *s, diff_maker *m, const style *of)
{
    static const diff_slicing references[] = {DIFF_WHOLE, DIFF_WORK, DIFF_BITS, DIFF_MIXED};
    static const uint16_t drains[] = {1000, 700, 20, 0};
    diff_random *r = &m->random;
    m->nodes = random_node_count(r);
    m->bit = random_bit_ticks(r);
    m->bits = diff_magnitude(r, of->bits_least, of->bits_most);
    s->end = m->bits * m->bit;
    s->fast = diff_chance(r, 500) ? DIFF_WHOLE : (diff_slicing)diff_below(r, DIFF_SLICING_COUNT);
    s->reference = references[diff_below(r, 4)];
    s->drains = of->small ? 0 : drains[diff_below(r, 4)];
    s->peeks = diff_chance(r, 300);
    s->repeats = s->seed / 2 % 2 == 0;
}

void diff_generate(diff_scenario *s, uint64_t seed)
{
    generator g = {.scenario = s};
    diff_maker *m = &g.maker;
    diff_random_init(&m->random, seed);
    *s = (diff_scenario){.seed = seed, .style = random_style(&m->random), .plan_count = 1};
    g.style = &styles[s->style];
    random_lengths(s, m, g.style);
    m->actions = g.style->actions;
    m->rarity = g.style->rarity;
    m->clocks = g.style->clocks != 0;
    m->near = g.style->clocks == NEAR;
    m->fd = g.style->fd != 0;
    g.hosts = diff_chance(&m->random, 150);
    g.pure = diff_chance(&g.maker.random, 500);
    g.old = diff_chance(&m->random, 100);
    g.variants = diff_chance(&m->random, 100);
    m->sleeps = diff_chance(&m->random, 200);
    g.times = diff_chance(&m->random, 150);
    if (m->near && diff_chance(&m->random, 900)) /* the bus looks at each frame there */
        g.hosts = g.times = m->sleeps = false;
    m->rates = g.style->fd == RATES && m->bit >= 80 && m->bit <= DIFF_TIMED_BIT_MAX;
    if (m->rates)
        diff_random_rates(m, &m->common);
    m->owned = diff_chance(&m->random, g.style->orderly);
    m->mailboxes = g.hosts && diff_chance(&m->random, 600);
    random_frames(m);
    random_plan(&g, &s->plans[0]);
    choose_events(&g);
    random_traffic(&g);
    random_operations(&g);
    random_checks(&g);
    if (g.style->checks >= 10 && diff_chance(&m->random, 500))
        check_each_bit(&g);
    diff_op *room = diff_allocate(NULL, s->op_count * sizeof s->ops[0]);
    sort_ops(s->ops, s->op_count, room);
    free(room);
}
