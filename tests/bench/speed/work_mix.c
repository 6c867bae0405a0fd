/* SPDX-License-Identifier: MIT
 *
 * work_mix.c - the periodic traffic of a car. Eight ECUs send 88 messages of 1 to 8 bytes, each 2
 * to 100 times a second; the bus carries 4096 frames a second.
 */
#include "works.h"

#include <stdlib.h>
#include <string.h>

#define NODES 8u
#define MESSAGES 88u
#define ROUND_MS 500u /* in which all periods fit */
#define RELEASES 2048u
#define SLICE_MS 10u
#define TICKS_PER_MS (CW_CLOCK_HZ / 1000u)

typedef struct release {
    uint32_t tick; /* of the round */
    uint16_t message;
} release;

typedef struct mix {
    cw_bus *bus;
    cw_frame messages[MESSAGES];
    release releases[RELEASES];
    uint64_t round_start; /* tick */
    unsigned next;        /* of the round's releases */
    uint64_t handed_in;
    uint64_t sent;
} mix;

typedef struct message_group {
    unsigned count;
    unsigned period_ms;
} message_group;

static const message_group groups[] = {{24, 10}, {24, 20}, {16, 50}, {16, 100}, {8, 500}};

static int by_tick(const void *left, const void *right)
{
    const release *a = left, *b = right;
    if (a->tick != b->tick)
        return a->tick < b->tick ? -1 : 1;
    return (int)a->message - (int)b->message;
}

/* Plans the messages. Short periods have low identifiers. The offsets are spread by a multiplier
 * that shares no factor with the modulus. */
static void plan(mix *m)
{
    unsigned message = 0, count = 0;
    for (unsigned g = 0; g < sizeof groups / sizeof groups[0]; g++)
        for (unsigned i = 0; i < groups[g].count; i++, message++) {
            uint32_t period = groups[g].period_ms * TICKS_PER_MS;
            uint32_t offset = (uint32_t)(message * UINT64_C(2654435761) % period);
            cw_frame *f = &m->messages[message];
            *f = bench_frame(message, message % NODES, false);
            f->id = 0x080 + 8 * message + message % NODES;
            f->dlc = (uint8_t)(message % 3 == 0 ? 1 + message % 8 : 8);
            for (uint32_t tick = offset; tick < ROUND_MS * TICKS_PER_MS; tick += period)
                m->releases[count++] = (release){.tick = tick, .message = (uint16_t)message};
        }
    if (message != MESSAGES || count != RELEASES)
        bench_fail("the plan has %u messages and %u releases", message, count);
    qsort(m->releases, RELEASES, sizeof m->releases[0], by_tick);
}

/* Makes the bus, so many times, in the memory of the one before. */
static void make_bus(mix *m, uint64_t times)
{
    cw_node_config nodes[NODES];
    const cw_bus_config config = {.bit_ticks = BENCH_BIT_TICKS, .node_count = NODES, .inbox = 256,
                                  .events = 1024, .nodes = nodes};
    for (unsigned i = 0; i < NODES; i++)
        nodes[i] = (cw_node_config){.queue = 16, .warning_limit = 96};
    if (!m->bus)
        m->bus = bench_alloc(cw_bus_size(&config));
    for (uint64_t i = 0; i < times; i++)
        if (!cw_bus_init(m->bus, &config))
            bench_fail("the bus cannot be made");
}

void *bench_mix_start(const void *options)
{
    (void)options;
    mix *m = bench_alloc(sizeof *m);
    make_bus(m, 1);
    plan(m);
    return m;
}

uint64_t bench_begin_run(void *state, uint64_t units)
{
    make_bus(state, units);
    return units;
}

/* Hands in frames; their contents change from release to release, as counters and signals do. */
static void hand_in_before(mix *m, uint64_t tick)
{
    for (;;) {
        const release *r = &m->releases[m->next];
        uint64_t at = m->round_start + r->tick;
        if (at >= tick)
            return;
        cw_frame *f = &m->messages[r->message];
        f->data[0]++;
        if (cw_node_send(m->bus, r->message % NODES, f, at) != CW_OK)
            bench_fail("the inbox is full");
        m->handed_in++;
        if (++m->next == RELEASES) {
            m->next = 0;
            m->round_start += ROUND_MS * TICKS_PER_MS;
        }
    }
}

static void take_events(mix *m)
{
    cw_event_row events;
    while (events = cw_bus_peek(m->bus), events.count > 0) {
        for (unsigned i = 0; i < events.count; i++)
            m->sent += cw_event_at(&events, i)->kind == CW_EVENT_TX;
        cw_bus_take(m->bus, events.count);
    }
}

uint64_t bench_mix_run(void *state, uint64_t units)
{
    mix *m = state;
    uint64_t tick = cw_bus_now(m->bus);
    tick -= tick % (SLICE_MS * TICKS_PER_MS);
    for (uint64_t slice = 0; slice < units * (1000 / SLICE_MS); slice++) {
        tick += SLICE_MS * TICKS_PER_MS;
        hand_in_before(m, tick);
        while (cw_bus_advance(m->bus, tick) == CW_FULL)
            take_events(m);
        take_events(m);
    }
    return units;
}

unsigned bench_mix_load_permille(void *state)
{
    const mix *m = state;
    cw_bus_stats stats;
    cw_bus_get_stats(m->bus, &stats);
    return (unsigned)(stats.busy_bits * 1000 / stats.bits);
}

void bench_mix_end(void *state)
{
    mix *m = state;
    cw_bus_stats stats;
    cw_bus_get_stats(m->bus, &stats);
    if (m->sent + cw_bus_pending(m->bus) != m->handed_in || stats.error_frames > 0)
        bench_fail("%llu frames were handed in, %llu sent, %llu errors",
                   (unsigned long long)m->handed_in, (unsigned long long)m->sent,
                   (unsigned long long)stats.error_frames);
    free(m->bus);
    free(m);
}
