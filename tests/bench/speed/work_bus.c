/* SPDX-License-Identifier: MIT
 *
 * work_bus.c - a bus at 100 % load: clean, with faults, with rules, bit by bit, with clocks that
 * differ; also at less load.
 */
#include "works.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define QUEUE 16u         /* frames of a node: more than are sent in a slice: it never runs dry */
#define SLICE_BITS 1000u  /* between two looks at the events */
#define EVENTS 4096u
#define JOIN_BITS 11u
#define FRAME_BITS 125u   /* about as many as a frame of 8 bytes has */
#define ALL_BUT_LOST (CW_EVENTS_USUAL & ~(1u << CW_EVENT_ARBITRATION_LOST))

typedef struct saturation {
    bench_bus_options options;
    cw_bus *bus;
    cw_frame frames[CW_NODES_MAX][BENCH_FRAMES / CW_NODES_MAX];
    uint64_t handed_in;
    uint64_t sent;
    uint64_t renewed; /* frames */
} saturation;

/* ---- Rules ----------------------------------------------------------------------------------- */

static cw_rule flip_every(const char *name, unsigned every)
{
    return (cw_rule){.name = name, .time_end = CW_NEVER, .every = every,
                     .probability = UINT64_MAX, .field = CW_FIELD_CRC, .index = 3, .bits = 1};
}

/* Makes a rule for this identifier, or with a wildcard for its neighbour, too. */
static cw_rule flip_id(const char *name, unsigned number, bool wild)
{
    cw_rule r = flip_every(name, 1);
    r.filter_count = 1;
    r.filters[0] =
        (cw_filter){.value = bench_foreign_id(number) & ~(uint32_t)wild,
                    .mask = CW_FILTER_EXTENDED | (0x7FFu & ~(uint32_t)wild)};
    return r;
}

/* Returns a rule with noise that never comes, for each attempt, so that it needs the senders of
 * every bit. */
static cw_rule no_noise(void)
{
    return (cw_rule){.name = "noise", .action = CW_ACTION_NOISE, .time_end = CW_NEVER,
                     .every = 1, .probability = UINT64_MAX};
}

/* Returns a rule that acts in every bit. Its node, the last one, must not send and acknowledges in
 * vain. */
static cw_rule mute(unsigned node)
{
    return (cw_rule){.name = "mute", .trigger = CW_TRIGGER_TIME, .action = CW_ACTION_STUCK,
                     .line = CW_LINE_TX, .node = (uint8_t)node, .level = CW_RECESSIVE,
                     .time_end = CW_NEVER, .every = 1, .probability = UINT64_MAX};
}

static unsigned make_rules(cw_rule *rules, const bench_bus_options *o)
{
    static char names[CW_RULES_MAX][8];
    unsigned count = 0;
    if (o->every)
        rules[count++] = flip_every("flip", o->every);
    if (o->lockstep)
        rules[count++] = no_noise();
    if (o->bit_by_bit)
        rules[count++] = mute(o->nodes - 1);
    for (unsigned i = 0; i < o->rules; i++) {
        (void)snprintf(names[i], sizeof names[i], "id %u", i % CW_RULES_MAX);
        rules[count++] = flip_id(names[i], i, i < o->wild);
    }
    return count;
}

/* ---- Clocks and delays ----------------------------------------------------------------------- */

#define QUANTUM_CLOCK_HZ 16000000u /* 16 quanta a bit */
#define PPM_STEPS 64               /* different clocks */

/* Gives a node a clock of its own, and a place on a line of 25 m. The steps are spread by a
 * multiplier that shares no factor with their number. */
static cw_node_timing timing_of(unsigned node, int32_t ppm)
{
    const int32_t step = (int32_t)(node * 37u % PPM_STEPS);
    const int32_t own = ppm * (2 * step - PPM_STEPS + 1) / (PPM_STEPS - 1);
    return (cw_node_timing){
        .bit = {.quantum = cw_quantum(QUANTUM_CLOCK_HZ, 1, own),
                .prop_seg = 7, .phase_seg1 = 4, .phase_seg2 = 4, .sjw = 4},
        .place = (cw_span)(node * 29u % PPM_STEPS) * CW_TICK * 2 / 13, /* 2 ns */
        .tx_delay = {2 * CW_TICK, 2 * CW_TICK}, .rx_delay = {4 * CW_TICK, 4 * CW_TICK}};
}

/* ---- FD -------------------------------------------------------------------------------------- */

#define FD_QUANTUM_TICKS 2 /* at both rates; a bit has 40 quanta, or 10 */

static void make_fd_node(cw_node_config *node)
{
    _Static_assert(BENCH_BIT_TICKS == 40 * FD_QUANTUM_TICKS, "40 quanta");
    node->protocol = CW_FD;
    node->timing.bit = (cw_bit_timing){.quantum = FD_QUANTUM_TICKS * CW_TICK, .prop_seg = 23,
                                       .phase_seg1 = 8, .phase_seg2 = 8, .sjw = 8};
    node->timing.data = (cw_data_timing){.brp = FD_QUANTUM_TICKS, .data_brp = FD_QUANTUM_TICKS,
                                         .bit = {.prop_seg = 5, .phase_seg1 = 2,
                                                 .phase_seg2 = 2, .sjw = 2}};
}

static void make_fd_frame(cw_frame *frame, unsigned bytes)
{
    frame->flags |= CW_FRAME_FD | CW_FRAME_BRS;
    frame->dlc = (uint8_t)cw_fd_dlc(bytes);
    for (unsigned i = 8; i < bytes; i++)
        frame->data[i] = (uint8_t)(frame->data[i % 8] + 29u * i);
}

/* ---- The bus --------------------------------------------------------------------------------- */

static cw_bus *make_bus(const bench_bus_options *o)
{
    cw_node_config nodes[CW_NODES_MAX];
    cw_rule *rules = bench_alloc(CW_RULES_MAX * sizeof *rules);
    cw_bus_config config = {.bit_ticks = BENCH_BIT_TICKS, .node_count = (uint8_t)o->nodes,
                            .inbox = 64, .events = EVENTS, .nodes = nodes, .rules = rules};
    config.rule_count = (uint16_t)make_rules(rules, o);
    for (unsigned i = 0; i < o->nodes; i++) {
        nodes[i] = (cw_node_config){.queue = QUEUE, .warning_limit = 96};
        if (o->ppm)
            nodes[i].timing = timing_of(i, o->ppm);
        if (o->fd)
            make_fd_node(&nodes[i]);
    }
    cw_bus *bus = cw_bus_init(bench_alloc(cw_bus_size(&config)), &config);
    if (!bus)
        bench_fail("the bus cannot be made");
    free(rules);
    cw_bus_set_stepping(bus, o->stepping);
    cw_bus_set_events(bus, o->lost ? CW_EVENTS_USUAL : ALL_BUT_LOST);
    return bus;
}

static void hand_in(saturation *s, unsigned node, uint64_t tick)
{
    const cw_frame *f = &s->frames[node][s->handed_in++ % (BENCH_FRAMES / CW_NODES_MAX)];
    if (cw_node_send(s->bus, node, f, tick) == CW_FULL)
        bench_fail("the inbox is full");
}

/* Gives the frames of all senders data that no frame had before. */
static void renew_frames(saturation *s)
{
    for (unsigned node = 0; node < s->options.senders; node++)
        for (unsigned i = 0; i < BENCH_FRAMES / CW_NODES_MAX; i++, s->renewed++)
            memcpy(s->frames[node][i].data, &s->renewed, sizeof s->renewed);
}

/* Takes every event and hands in the next frame of a node for each transmitted one. */
static void keep_busy(saturation *s)
{
    cw_event_row events;
    while (events = cw_bus_peek(s->bus), events.count > 0) {
        for (unsigned i = 0; i < events.count; i++) {
            const cw_event *event = cw_event_at(&events, i);
            if (event->kind != CW_EVENT_TX)
                continue;
            s->sent++;
            if (!s->options.load)
                hand_in(s, (unsigned)__builtin_ctzll(event->nodes), 0);
        }
        cw_bus_take(s->bus, events.count);
    }
}

static void advance(saturation *s, uint64_t tick)
{
    while (cw_bus_advance(s->bus, tick) == CW_FULL)
        keep_busy(s);
    keep_busy(s);
}

/* Hands in a frame of the next node for each part of the slice that it is to load. */
static void hand_in_load(saturation *s)
{
    const uint64_t begin = cw_bus_now(s->bus);
    for (uint64_t bits = 0; bits < SLICE_BITS; bits += FRAME_BITS * 100u / s->options.load)
        hand_in(s, (unsigned)(s->handed_in % s->options.senders), begin + bits * BENCH_BIT_TICKS);
}

static void advance_slice(saturation *s)
{
    if (s->options.fresh)
        renew_frames(s);
    if (s->options.load)
        hand_in_load(s);
    advance(s, cw_bus_now(s->bus) + SLICE_BITS * BENCH_BIT_TICKS);
}

void *bench_bus_start(const void *options)
{
    saturation *s = bench_alloc(sizeof *s);
    s->options = *(const bench_bus_options *)options;
    s->bus = make_bus(&s->options);
    for (unsigned i = 0; i < BENCH_FRAMES; i++)
        s->frames[i % CW_NODES_MAX][i / CW_NODES_MAX] = bench_frame(i, i % CW_NODES_MAX, false);
    for (unsigned i = 0; s->options.fd && i < BENCH_FRAMES; i++)
        make_fd_frame(&s->frames[i % CW_NODES_MAX][i / CW_NODES_MAX], s->options.fd);
    const unsigned waiting = s->options.load ? 0 : s->options.senders * QUEUE;
    for (unsigned i = 0; i < waiting; i++) {
        hand_in(s, i % s->options.senders, 0);
        advance(s, 0); /* takes it from the inbox */
    }
    advance_slice(s);
    return s;
}

uint64_t bench_bus_run_frames(void *state, uint64_t units)
{
    saturation *s = state;
    uint64_t before = s->sent;
    while (s->sent - before < units)
        advance_slice(s);
    return s->sent - before;
}

uint64_t bench_bus_run_bits(void *state, uint64_t units)
{
    saturation *s = state;
    uint64_t before = cw_bus_now(s->bus) / BENCH_BIT_TICKS;
    for (uint64_t done = 0; done < units; done += SLICE_BITS)
        advance_slice(s);
    return cw_bus_now(s->bus) / BENCH_BIT_TICKS - before;
}

/* ---- Was it what it should be? --------------------------------------------------------------- */

/* Checks that one of `every` attempts fails. */
static void check_faults(const saturation *s, const cw_bus_stats *stats)
{
    uint64_t attempts = stats->frames + stats->error_frames;
    uint64_t expected = s->options.every ? attempts / s->options.every : 0;
    if (stats->error_frames != expected && stats->error_frames != expected + 1)
        bench_fail("%" PRIu64 " error frames, should be %" PRIu64, stats->error_frames, expected);
}

void bench_bus_end(void *state)
{
    saturation *s = state;
    cw_bus_stats stats;
    cw_bus_get_stats(s->bus, &stats);
    check_faults(s, &stats);
    const uint64_t between = s->options.ppm ? stats.bits / 50 : 0; /* a node becomes idle before
                                                                      its next bit begins */
    if (!s->options.load && stats.busy_bits + between + JOIN_BITS + 1 < stats.bits)
        bench_fail("the bus was idle for %" PRIu64 " bits", stats.bits - stats.busy_bits);
    for (unsigned i = 0; i < s->options.nodes; i++) {
        cw_node_stats node;
        (void)cw_node_get_stats(s->bus, i, &node);
        if (node.state != CW_STATE_ERROR_ACTIVE || node.dropped[CW_DROP_QUEUE_FULL] > 0)
            bench_fail("node %u is not error-active or has dropped frames", i);
    }
    free(s->bus);
    free(s);
}
