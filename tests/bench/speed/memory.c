/* SPDX-License-Identifier: MIT
 *
 * memory.c - what a node takes of the bus's memory.
 */
#include "works.h"

/* Returns the size of a bus. Its ring is large enough for any number of nodes, so that it is the
 * same for all. */
static size_t bus_bytes(unsigned node_count, unsigned queue)
{
    cw_node_config nodes[CW_NODES_MAX];
    const cw_bus_config config = {.bit_ticks = BENCH_BIT_TICKS, .node_count = (uint8_t)node_count,
                                  .inbox = 64, .events = UINT16_MAX, .keeps_setup = true,
                                  .nodes = nodes};
    for (unsigned i = 0; i < node_count; i++)
        nodes[i] = (cw_node_config){.queue = (uint16_t)queue, .warning_limit = 96};
    return cw_bus_size(&config);
}

size_t bench_bytes_per_node(void)
{
    const unsigned more_nodes = CW_NODES_MAX - 2, queue = 256; /* else the ring grows, too */
    size_t per_node = (bus_bytes(CW_NODES_MAX, queue) - bus_bytes(2, queue)) / more_nodes;
    size_t queued = (bus_bytes(2, 2 * queue) - bus_bytes(2, queue)) / 2;
    return per_node - queued - sizeof(cw_node_stats);
}
