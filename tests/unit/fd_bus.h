/* SPDX-License-Identifier: MIT
 *
 * fd_bus.h - two nodes at 500 kbit/s and 2 Mbit/s, for tests of what shows CAN FD.
 *
 * Both sample at 80 % of a bit: at 1600 and 400 ns. So BRS lasts 1600 + 100 ns, and the CRC
 * delimiter behind the data phase 400 + 400 ns (D10).
 */
#ifndef CANWIRE_TESTS_FD_BUS_H
#define CANWIRE_TESTS_FD_BUS_H

#include "cases.h"
#include "config/config.h"

#define FD_BIT_TICKS 160u
#define FD_BRS_TICKS 136u
#define FD_DATA_TICKS 40u
#define FD_DELIMITER_TICKS 64u

typedef struct fd_bus {
    void *memory;
    cw_bus *bus;
    cfg_node nodes[2];
    cfg config;
} fd_bus;

/* One clock of 80 MHz for all: 160 and 40 quanta a bit. */
static inline cw_node_timing fd_bus_timing(bool has_rate)
{
    cw_node_timing t = {.bit = {.quantum = CW_TICK,
                                .prop_seg = 63,
                                .phase_seg1 = 64,
                                .phase_seg2 = 32,
                                .sjw = 32}};
    if (has_rate)
        t.data = (cw_data_timing){
            .bit = {.prop_seg = 15, .phase_seg1 = 16, .phase_seg2 = 8, .sjw = 8},
            .brp = 1,
            .data_brp = 1,
            .tdc = {.mode = CW_TDC_AUTO, .tdco = 32}};
    return t;
}

/* Sets up nodes "a" and "b" of a protocol. timing: NULL, or one for each node. rule: NULL, or the
 * only one. */
static inline void fd_bus_begin(fd_bus *r, unsigned protocol, const cw_node_timing *timing,
                                cw_rule *rule)
{
    static char names[2][2] = {"a", "b"}, bus_name[] = "mixed";
    cw_node_config each[2];

    *r = (fd_bus){.config = {.bus_name = bus_name,
                             .bitrate_bps = 500000,
                             .rate = {FD_BIT_TICKS},
                             .node_count = 2,
                             .rule_count = rule != NULL,
                             .rules = rule}};
    r->config.nodes = r->nodes;
    for (unsigned i = 0; i < 2; i++) {
        each[i] = (cw_node_config){
            .queue = 4, .warning_limit = 96, .protocol = (uint8_t)protocol};
        if (timing)
            each[i].timing = timing[i];
        r->nodes[i] = (cfg_node){.name = names[i],
                                 .time = {.used = timing != NULL,
                                          .timing = each[i].timing,
                                          .phase[0].bit = {80000000, 1, 63, 64, 32, 32}}};
    }
    const cw_bus_config wanted = {.bit_ticks = FD_BIT_TICKS,
                                  .node_count = 2,
                                  .inbox = 4,
                                  .events = 256,
                                  .marks = timing != NULL,
                                  .rule_count = rule != NULL,
                                  .rules = rule,
                                  .nodes = each};
    r->memory = malloc(cw_bus_size(&wanted));
    assert_non_null(r->memory);
    r->bus = cw_bus_init(r->memory, &wanted);
    assert_non_null(r->bus);
}

static inline void fd_bus_end(fd_bus *r)
{
    free(r->memory);
}

/* Returns the ticks of wire bit n of a frame (D10). */
static inline uint64_t fd_bus_ticks(const cw_bits *bits, unsigned n)
{
    const bool here = cw_bits_is_fast(bits, n);
    if (here)
        return FD_DATA_TICKS;
    if (n + 1 < bits->length && cw_bits_is_fast(bits, n + 1))
        return FD_BRS_TICKS;
    return n > 0 && cw_bits_is_fast(bits, n - 1) ? FD_DELIMITER_TICKS : FD_BIT_TICKS;
}

#endif
