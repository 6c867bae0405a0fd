/* SPDX-License-Identifier: MIT
 *
 * bench.c - what the engine costs: `make bench`.
 *
 * Wall time of this process on this machine; run it on an idle one. Each figure is the best of
 * several rounds, since noise only ever adds.
 */
#include "canwire.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define ROUNDS 5
#define BIT_TICKS 80u /* 1 Mbit/s */
#define QUEUE 16u     /* frames of a node, so that the bus is never idle */

static double now_ns(void)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec * 1e9 + (double)t.tv_nsec;
}

static cw_frame test_frame(unsigned i)
{
    cw_frame f = {.id = (i * 2654435761u) >> 21, .dlc = 8};
    for (unsigned byte = 0; byte < 8; byte++)
        f.data[byte] = (uint8_t)(i * 97 + byte * 31);
    return f;
}

static double encode_ns(void)
{
    const unsigned count = 200000;
    unsigned sum = 0;
    double start = now_ns();
    for (unsigned i = 0; i < count; i++) {
        cw_bits bits;
        const cw_frame frame = test_frame(i);
        (void)cw_bits_encode(&bits, &frame);
        sum += bits.length;
    }
    double ns = (now_ns() - start) / count;
    return sum ? ns : 0;
}

typedef struct run_result {
    double ns_per_frame;
    double ns_per_bit;
    double bus_seconds_per_second;
} run_result;

static cw_bus *new_bus(unsigned nodes, const cw_rule *rules, unsigned rule_count)
{
    cw_node_config configs[CW_NODES_MAX];
    for (unsigned i = 0; i < nodes; i++)
        configs[i] = (cw_node_config){.queue = QUEUE, .warning_limit = 96};
    const cw_bus_config config = {.bit_ticks = BIT_TICKS, .node_count = (uint8_t)nodes, .inbox = 2048,
                                  .events = 1024, .nodes = configs, .rules = rules,
                                  .rule_count = (uint16_t)rule_count};
    cw_bus *bus = cw_bus_init(malloc(cw_bus_size(&config)), &config);
    if (!bus)
        abort();
    return bus;
}

/* Every event is taken; each transmitted frame is followed by the next of the same node. */
static void keep_busy(cw_bus *bus, unsigned *sent)
{
    cw_event event;
    while (cw_bus_poll(bus, &event)) {
        if (event.kind != CW_EVENT_TX)
            continue;
        unsigned node = 0;
        while (!(event.nodes >> node & 1u))
            node++;
        const cw_frame frame = test_frame((*sent)++);
        (void)cw_node_send(bus, node, &frame, 0);
    }
}

static run_result saturate(unsigned nodes, const cw_rule *rules, unsigned rule_count)
{
    const unsigned bits = nodes > 8 ? 400000 : 2000000;
    cw_bus *bus = new_bus(nodes, rules, rule_count);
    unsigned sent = 0;
    for (; sent < nodes * QUEUE; sent++) {
        const cw_frame frame = test_frame(sent);
        (void)cw_node_send(bus, sent % nodes, &frame, 0);
    }
    double start = now_ns();
    for (uint64_t tick = 0; tick < (uint64_t)bits * BIT_TICKS; tick += 1000 * BIT_TICKS) {
        while (cw_bus_advance(bus, tick) == CW_FULL)
            keep_busy(bus, &sent);
        keep_busy(bus, &sent);
    }
    double ns = now_ns() - start;
    cw_bus_stats stats;
    cw_bus_get_stats(bus, &stats);
    free(bus);
    return (run_result){.ns_per_frame = ns / (double)stats.frames,
                        .ns_per_bit = ns / (double)stats.bits,
                        .bus_seconds_per_second = (double)stats.bits / 1e6 / (ns / 1e9)};
}

static void print_encode(void)
{
    double best = encode_ns();
    for (unsigned i = 1; i < ROUNDS; i++) {
        double ns = encode_ns();
        best = ns < best ? ns : best;
    }
    printf("encode an 8-byte frame                  %8.0f ns\n", best);
}

static void print_saturated(const char *name, unsigned nodes, const cw_rule *rules, unsigned count)
{
    run_result best = saturate(nodes, rules, count);
    for (unsigned i = 1; i < ROUNDS; i++) {
        run_result r = saturate(nodes, rules, count);
        best = r.ns_per_bit < best.ns_per_bit ? r : best;
    }
    printf("%-28s N = %2u %9.0f ns/frame %7.1f ns/bit %8.1f bus s/s\n", name, nodes,
           best.ns_per_frame, best.ns_per_bit, best.bus_seconds_per_second);
}

int main(void)
{
    static const unsigned nodes[] = {2, 4, 16, 64};
    const cw_rule flip = {.name = "one in ten", .time_end = CW_NEVER, .every = 10,
                          .probability = UINT64_MAX, .field = CW_FIELD_CRC, .index = 3, .bits = 1,
                          .at = 2};
    printf("1 Mbit/s, all nodes saturated with 8-byte frames; best of %d rounds\n", ROUNDS);
    print_encode();
    for (unsigned i = 0; i < sizeof nodes / sizeof nodes[0]; i++)
        print_saturated("clean", nodes[i], NULL, 0);
    print_saturated("every 10th frame flipped", 4, &flip, 1);
    return 0;
}
