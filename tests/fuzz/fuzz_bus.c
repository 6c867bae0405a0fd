/* SPDX-License-Identifier: MIT
 *
 * fuzz_bus.c - two buses with the same inputs. One advances in large steps, the other bit by bit:
 * the events must be the same, in time order, and no frame may be lost.
 *
 * Input: configuration, rules, then operations until it is used up.
 */
#include "fuzz.h"

#include <string.h>

#define NODES_MAX 6u
#define RULES_FIRST_MAX 6u
#define RULE_ROOM 6u
#define OPERATIONS_MAX 200u
#define BITS_MAX 20000u
#define NAMES 16u

typedef struct pair {
    fuzz_bus whole;
    fuzz_bus bitwise;
    cw_node_config nodes[NODES_MAX];
    cw_bus_config config;
    unsigned bits;
} pair;

static const char *const names[NAMES] = {"a", "b", "c", "d", "e", "f", "g", "h",
                                         "i", "j", "k", "l", "m", "n", "o", "p"};

/* ---- Rules ----------------------------------------------------------------------------------- */

/* Reads a time in ticks: none, some bits, or an odd number. */
static uint64_t some_ticks(fuzz_input *in, uint32_t bit_ticks)
{
    unsigned kind = fuzz_u8(in);
    if (kind < 64)
        return 0;
    if (kind < 128)
        return (uint64_t)(kind - 63) * bit_ticks;
    if (kind < 224)
        return (uint64_t)fuzz_u8(in) * 16 * bit_ticks + kind % 3;
    return kind == 255 ? CW_NEVER : fuzz_u32(in);
}

static uint64_t some_nodes(fuzz_input *in)
{
    uint64_t nodes = fuzz_u8(in);
    return nodes & 0x80 ? 0 : nodes & 0x3F;
}

static void read_when(cw_rule *r, fuzz_input *in, uint32_t bit_ticks)
{
    unsigned what = fuzz_u8(in);
    r->trigger = (cw_trigger)(what % 4);
    r->filter_count = what >> 2 & 1u;
    if (r->filter_count) {
        r->filters[0].value = fuzz_below(in, 0x800);
        r->filters[0].mask = fuzz_below(in, 0x800);
        r->filters[0].inverted = what >> 3 & 1u;
    }
    if (what >> 4 & 1u) {
        r->has_after = true;
        r->after = (uint16_t)fuzz_below(in, RULES_FIRST_MAX + 1);
        r->after_delay = some_ticks(in, bit_ticks);
    }
    r->manual = what >> 5 & 1u;
    r->error_mask = UINT32_MAX;
    r->from = some_nodes(in);
    if (what >> 6 & 1u) {
        r->state_nodes = some_nodes(in);
        r->state_mask = fuzz_u8(in) & 0xFu;
    }
    if (what >> 7) {
        r->skip = fuzz_below(in, 4);
        r->every = fuzz_below(in, 4);
        r->count = fuzz_below(in, 8);
        r->probability = fuzz_bool(in) ? UINT64_MAX : UINT64_MAX / 3;
        r->hold_off = some_ticks(in, bit_ticks);
        r->time_begin = some_ticks(in, bit_ticks);
        r->time_end = r->time_begin + some_ticks(in, bit_ticks);
        if (r->trigger == CW_TRIGGER_TIME)
            r->again_ticks = some_ticks(in, bit_ticks);
    }
}

static void read_settings(cw_settings *s, fuzz_input *in, uint32_t bit_ticks)
{
    s->which = fuzz_u8(in) & 0x1Fu;
    s->modes_mask = fuzz_u8(in) & 0x1Fu;
    s->modes = fuzz_u8(in);
    s->order = fuzz_bool(in) ? CW_ORDER_FIFO : CW_ORDER_PRIORITY;
    s->queue = (uint16_t)fuzz_below(in, 10);
    s->warning_limit = (uint16_t)fuzz_below(in, 300);
    s->restart_ticks = some_ticks(in, bit_ticks);
}

static void read_change(cw_change *c, fuzz_input *in)
{
    unsigned what = fuzz_u8(in);
    memset(c->and_mask, 0xFF, sizeof c->and_mask);
    c->set_id = what & 1u;
    c->set_dlc = what >> 1 & 1u;
    c->id_flags = what >> 2 & 1u;
    c->id = fuzz_below(in, 0x900);
    c->dlc = fuzz_u8(in) & 0x1Fu;
    c->xor_mask[0] = fuzz_u8(in);
    c->set_mask[7] = fuzz_u8(in);
}

/* Reads members that belong to some kinds of actions only. */
static void read_details(cw_rule *r, fuzz_input *in, uint32_t bit_ticks)
{
    if (r->action == CW_ACTION_SET)
        read_settings(&r->settings, in, bit_ticks);
    if (r->action == CW_ACTION_CHANGE)
        read_change(&r->change, in);
    if (r->action == CW_ACTION_PARTITION)
        for (unsigned i = 0; i < NODES_MAX; i++)
            r->group[i] = fuzz_u8(in);
    if (r->action == CW_ACTION_COUNTERS) {
        r->tec = (uint16_t)fuzz_below(in, 280);
        r->rec = fuzz_bool(in) ? CW_KEEP : (uint16_t)fuzz_below(in, 280);
    }
    if (r->action >= CW_ACTION_SEND)
        r->frame = fuzz_frame(in);
    if (r->action == CW_ACTION_GLITCH) {
        r->pattern_level = fuzz_u32(in);
        r->pattern_mask = fuzz_u32(in);
    }
    if (r->action == CW_ACTION_RAW_FRAME)
        r->deviations = fuzz_u8(in) & 7u;
    for (unsigned i = 0; r->action == CW_ACTION_RAW && i < 2; i++)
        r->raw[i] = (uint64_t)fuzz_u32(in) << 32 | fuzz_u32(in);
    r->raw_when_idle = r->level;
    if (r->action == CW_ACTION_NOISE)
        r->error_rate = (uint64_t)fuzz_u8(in) << 52;
}

static void read_do(cw_rule *r, fuzz_input *in, uint32_t bit_ticks)
{
    unsigned what = fuzz_u8(in);
    r->action = (cw_action)fuzz_below(in, CW_ACTION_COUNT);
    r->field = (cw_field)fuzz_below(in, CW_FIELD_COUNT);
    r->index = fuzz_u8(in);
    r->bits = (uint16_t)fuzz_below(in, 70);
    r->level = what & 1u;
    r->line = (cw_line)((what >> 1 & 3u) % 3);
    r->side = what >> 3 & 1u ? CW_SIDE_RX : CW_SIDE_TX;
    r->for_ticks = what >> 4 & 1u ? some_ticks(in, bit_ticks) : 0;
    r->dominant_timeout = what >> 5 & 1u ? some_ticks(in, bit_ticks) : 0;
    r->period_ticks = what >> 6 & 1u ? some_ticks(in, bit_ticks) : 0;
    r->at = some_nodes(in);
    r->nodes = some_nodes(in);
    r->node = (uint8_t)fuzz_below(in, NODES_MAX);
    r->number = fuzz_below(in, 6);
    r->load_permille = (uint16_t)fuzz_below(in, 1200);
    read_details(r, in, bit_ticks);
}

static cw_rule read_rule(fuzz_input *in, uint32_t bit_ticks)
{
    cw_rule rule = {
        .name = names[fuzz_below(in, NAMES)], .probability = UINT64_MAX, .time_end = CW_NEVER};
    read_when(&rule, in, bit_ticks);
    read_do(&rule, in, bit_ticks);
    return rule;
}

/* ---- Set-up ---------------------------------------------------------------------------------- */

static void read_nodes(pair *p, fuzz_input *in)
{
    p->config.node_count = (uint8_t)(1 + fuzz_below(in, NODES_MAX));
    for (unsigned i = 0; i < p->config.node_count; i++) {
        unsigned what = fuzz_u8(in);
        p->nodes[i] = (cw_node_config){
            .modes = what & 0x80 ? what & 0x1Fu : 0,
            .order = what >> 5 & 1u ? CW_ORDER_FIFO : CW_ORDER_PRIORITY,
        };
        p->nodes[i].queue = (uint16_t)(1 + fuzz_below(in, 8));
        p->nodes[i].queue_room = 8;
        p->nodes[i].warning_limit = (uint16_t)(1 + fuzz_below(in, 255));
        if (what >> 6 & 1u)
            p->nodes[i].restart_ticks = some_ticks(in, p->config.bit_ticks);
    }
}

/* Lets nodes know FD frames, at two rates where a bit has ticks enough. */
static void add_fd(pair *p)
{
    static const cw_data_timing data = {.brp = 2, .data_brp = 2,
                                        .bit = {.prop_seg = 3, .phase_seg1 = 4, .phase_seg2 = 2,
                                                .sjw = 2}};
    const unsigned quanta = p->config.bit_ticks / 2;
    for (unsigned i = 0; i < p->config.node_count; i++) {
        p->nodes[i].protocol = i == 5 ? CW_FD_TOLERANT : CW_FD;
        if (p->config.bit_ticks < 80 || p->config.bit_ticks > 160)
            continue;
        p->nodes[i].timing.bit = (cw_bit_timing){.quantum = 2 * CW_TICK, .phase_seg1 = 8,
                                                 .phase_seg2 = 8, .sjw = 4,
                                                 .prop_seg = (uint16_t)(quanta - 17)};
        p->nodes[i].timing.data = data;
        p->nodes[i].timing.data.tdc.mode = (cw_tdc_mode)(i % 2);
        p->nodes[i].timing.data.tdc.tdco = 16;
    }
}

/* Reads a configuration without rules, which come later: one that the bus refuses makes the whole
 * configuration invalid. */
static void read_config(pair *p, fuzz_input *in)
{
    static const uint32_t bit_ticks[] = {160, 80, 1, 7, 8000};
    p->config = (cw_bus_config){.rule_room = RULES_FIRST_MAX + RULE_ROOM, .nodes = p->nodes};
    p->config.bit_ticks = bit_ticks[fuzz_below(in, 5)];
    p->config.seed = fuzz_u8(in);
    p->config.inbox = (uint16_t)(1 + fuzz_below(in, 32));
    p->config.events = (uint16_t)fuzz_below(in, 512);
    read_nodes(p, in);
    if (p->config.seed >= 0xC0)
        add_fd(p);
}

/* ---- Both ------------------------------------------------------------------------------------ */

static void same(const pair *p)
{
    cw_bus_stats a;
    cw_bus_stats b;
    cw_bus_get_stats(p->whole.bus, &a);
    cw_bus_get_stats(p->bitwise.bus, &b);
    REQUIRE(a.ticks == b.ticks && a.bits == b.bits && a.busy_bits == b.busy_bits);
    REQUIRE(a.busy_ticks == b.busy_ticks && a.data_ticks == b.data_ticks);
    REQUIRE(a.data_bits == b.data_bits && a.fd_frames == b.fd_frames);
    REQUIRE(a.frames == b.frames && a.frame_bits == b.frame_bits && a.faults == b.faults);
    REQUIRE(a.error_frames == b.error_frames && a.overload_frames == b.overload_frames);
    REQUIRE(a.pending == b.pending && a.load_permille == b.load_permille);
    REQUIRE(p->whole.events == p->bitwise.events);
    REQUIRE(p->whole.hash == p->bitwise.hash);
    REQUIRE(cw_bus_recessive_bits(p->whole.bus) == cw_bus_recessive_bits(p->bitwise.bus));
}

/* Takes drops that settings and similar calls have caused. */
static void poll(pair *p)
{
    fuzz_bus_poll(&p->whole);
    fuzz_bus_poll(&p->bitwise);
}

static void advance(pair *p, uint64_t bits)
{
    if (p->bits + bits > BITS_MAX)
        bits = BITS_MAX - p->bits;
    p->bits += (unsigned)bits;
    uint64_t end = cw_bus_now(p->whole.bus) + bits * p->config.bit_ticks;
    poll(p);
    bool rests = cw_bus_next(p->whole.bus) == CW_NEVER;
    uint64_t events = p->whole.events;
    fuzz_bus_advance(&p->whole, end);
    REQUIRE(!rests || p->whole.events == events); /* as cw_bus_next() said */
    fuzz_bus_advance(&p->bitwise, cw_bus_now(p->bitwise.bus));
    while (cw_bus_now(p->bitwise.bus) < end)
        fuzz_bus_advance(&p->bitwise, cw_bus_now(p->bitwise.bus) + p->config.bit_ticks);
    same(p);
}

static void add_rule(pair *p, fuzz_input *in)
{
    unsigned a;
    unsigned b;
    const cw_rule rule = read_rule(in, p->config.bit_ticks);
    cw_status status = cw_bus_add_rule(p->whole.bus, &a, &rule);
    REQUIRE(status == cw_bus_add_rule(p->bitwise.bus, &b, &rule));
    REQUIRE(status != CW_OK || a == b);
}

static void send(pair *p, fuzz_input *in)
{
    unsigned node = fuzz_below(in, NODES_MAX + 1);
    unsigned count = 1 + fuzz_below(in, 4);
    uint64_t tick = cw_bus_now(p->whole.bus) + fuzz_below(in, 64) * (p->config.bit_ticks / 2);
    const cw_frame frame = fuzz_frame(in);
    for (unsigned i = 0; i < count; i++) {
        cw_status status = cw_node_send(p->whole.bus, node, &frame, tick);
        REQUIRE(status == cw_node_send(p->bitwise.bus, node, &frame, tick));
        REQUIRE((status == CW_INVALID) == (node >= p->whole.nodes));
    }
}

static void set(pair *p, fuzz_input *in)
{
    cw_settings settings = {.which = 0};
    unsigned node = fuzz_below(in, NODES_MAX);
    read_settings(&settings, in, p->config.bit_ticks);
    REQUIRE(cw_node_set(p->whole.bus, node, &settings) ==
            cw_node_set(p->bitwise.bus, node, &settings));
}

static void flush(pair *p, unsigned node)
{
    REQUIRE(cw_node_flush(p->whole.bus, node) == cw_node_flush(p->bitwise.bus, node));
    poll(p);
}

static void attach(pair *p, unsigned node, bool on)
{
    REQUIRE(cw_node_attach(p->whole.bus, node, on) == cw_node_attach(p->bitwise.bus, node, on));
    REQUIRE(cw_node_attached(p->whole.bus, node) == cw_node_attached(p->bitwise.bus, node));
    poll(p);
}

static void restart(pair *p, unsigned node)
{
    REQUIRE(cw_node_restart(p->whole.bus, node) == cw_node_restart(p->bitwise.bus, node));
}

static void restart_or_attach(pair *p, unsigned what)
{
    if (what < NODES_MAX)
        restart(p, what);
    else
        attach(p, what % NODES_MAX, what < 2 * NODES_MAX);
}

/* Takes over old nodes in another order, with some left out and some new. */
static void take_over(pair *p, fuzz_input *in)
{
    uint8_t from[NODES_MAX];
    uint64_t kept = 0;
    unsigned old_nodes = p->whole.nodes;
    read_nodes(p, in);
    p->config.inbox = (uint16_t)(p->config.inbox + fuzz_below(in, 3));
    for (unsigned i = 0; i < p->config.node_count; i++) {
        unsigned old = fuzz_below(in, NODES_MAX + 1);
        bool free = old < old_nodes && !(kept >> old & 1u);
        from[i] = free ? (uint8_t)old : CW_NO_NODE;
        kept |= free ? UINT64_C(1) << old : 0;
    }
    for (unsigned i = 0; i < old_nodes; i++)
        if (!(kept >> i & 1u))
            flush(p, i);
    poll(p);
    REQUIRE(fuzz_bus_take_over(&p->whole, &p->config, from) == CW_OK);
    REQUIRE(fuzz_bus_take_over(&p->bitwise, &p->config, from) == CW_OK);
}

static void operate(pair *p, fuzz_input *in)
{
    unsigned op = fuzz_u8(in) % 16;
    unsigned which = op >= 8 && op <= 11 ? fuzz_below(in, RULES_FIRST_MAX + RULE_ROOM + 1) : 0;
    if (op < 4)
        send(p, in);
    else if (op < 6)
        advance(p, fuzz_below(in, 200));
    else if (op == 6)
        advance(p, 8 * fuzz_below(in, 256));
    else if (op == 7)
        set(p, in);
    else if (op == 8)
        REQUIRE(cw_bus_clear_rule(p->whole.bus, which) == cw_bus_clear_rule(p->bitwise.bus, which));
    else if (op == 9)
        REQUIRE(cw_bus_stop_rule(p->whole.bus, which) == cw_bus_stop_rule(p->bitwise.bus, which));
    else if (op <= 11)
        REQUIRE(cw_bus_fire_rule(p->whole.bus, which) == cw_bus_fire_rule(p->bitwise.bus, which));
    else if (op == 12)
        restart_or_attach(p, fuzz_below(in, 3 * NODES_MAX));
    else if (op < 15)
        add_rule(p, in);
    else if (fuzz_bool(in))
        take_over(p, in);
    else
        flush(p, fuzz_below(in, NODES_MAX));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    pair p = {.bits = 0};
    fuzz_input in = {.data = data, .left = size};
    read_config(&p, &in);
    REQUIRE(fuzz_bus_open(&p.whole, &p.config) && fuzz_bus_open(&p.bitwise, &p.config));
    p.whole.label = 'a';
    p.bitwise.label = 'b';
    for (unsigned rules = fuzz_below(&in, RULES_FIRST_MAX); rules > 0; rules--)
        add_rule(&p, &in);
    for (unsigned i = 0; in.left > 0 && i < OPERATIONS_MAX; i++)
        operate(&p, &in);
    advance(&p, 1000);
    fuzz_bus_check(&p.whole);
    fuzz_bus_check(&p.bitwise);
    fuzz_bus_close(&p.whole);
    fuzz_bus_close(&p.bitwise);
    return 0;
}
