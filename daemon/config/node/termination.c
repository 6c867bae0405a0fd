/* SPDX-License-Identifier: MIT
 *
 * termination.c - a line without its terminators: how long an edge rings.
 *
 * A model. An edge to recessive is driven by the terminators alone. At an end without one it comes
 * back, so that the level is not certain before it went along the whole line and back. Without any
 * terminator this takes three round trips. A real line also depends on its wires and on each
 * transceiver.
 */
#include "config/parts.h"

#include "config/values.h"

#define TRIPS_ONE 1
#define TRIPS_NONE 3

static cw_span distance(const cw_node_timing *a, const cw_node_timing *b)
{
    const cw_span line = a->place < b->place ? b->place - a->place : a->place - b->place;

    return line + a->stub + b->stub;
}

/* Returns the longest way between two nodes. */
static cw_span longest_way(const cfg *config)
{
    cw_span longest = 0;

    for (size_t b = 1; b < config->node_count; b++)
        for (size_t a = 0; a < b; a++) {
            const cw_span way =
                distance(&config->nodes[a].time.timing, &config->nodes[b].time.timing);
            longest = way > longest ? way : longest;
        }
    return longest;
}

void cfg_add_ringing(schema *self, yaml_node_t *nodes)
{
    cfg *config = cfg_of(self);
    const cw_span trips = config->termination == CFG_TERMINATION_ONE ? TRIPS_ONE : TRIPS_NONE;
    const cw_span way = longest_way(config);

    if (config->termination == CFG_TERMINATION_BOTH)
        return;
    if (way == 0)
        schema_warn(self, nodes, "termination: nothing rings, since no position and no stub of a "
                    "node says how long the line is");
    for (size_t i = 0; i < config->node_count; i++)
        if (!schema_find(self, cfg_node_map(self, nodes, i), "ringing"))
            config->nodes[i].time.timing.ringing += 2 * trips * way;
}
