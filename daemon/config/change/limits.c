/* SPDX-License-Identifier: MIT
 *
 * limits.c - what the library does not take of a configuration, told at its place.
 */
#include "config/parts.h"

#include "base/text/decimal.h"
#include "config/values.h"

#define PS_PER_NS 1000u

/* Returns the first of these keys that a node has, or the node. */
static const yaml_node_t *limits_place_of(schema *self, const yaml_node_t *node,
                                          const char *const names[])
{
    const yaml_node_t *value = NULL;

    for (size_t i = 0; names[i] && !value; i++)
        value = schema_find(self, node, names[i]);
    return value ? value : node;
}

/* Returns nanoseconds, to the picosecond. */
static const char *ns(schema *self, cw_span span)
{
    return schema_print(self, "%s ns", decimal((uint64_t)text_span_ps(span), 3).text);
}

/* Complains about a bit that is too long or too short beside those of the bus. */
static void complain_of_bit(schema *self, const yaml_node_t *node, const cw_bus_finding *f)
{
    static const char *const names[] = {"brp", "clock", "ppm", NULL};
    static const char *const fast[] = {"dbrp", "dsample-point", "ppm", "clock", NULL};

    schema_complain(self, limits_place_of(self, node, f->fast ? fast : names),
                    "a bit of a node%s lasts between 1/64 and 64 bits of the bus: it lasts %s, "
                    "expected at %s %s",
                    f->fast ? " in the data phase" : "", ns(self, f->is),
                    f->limit == CW_LIMIT_BIT_MOST ? "most" : "least", ns(self, f->allowed));
}

/* Complains about an edge that is under way for longer than the library keeps edges. */
static void complain_of_way(schema *self, const yaml_node_t *node, const cw_bus_finding *f)
{
    static const char *const names[] = {"position", "stub", "rx-delay", "tx-delay", NULL};

    schema_complain(self, limits_place_of(self, node, names),
                    "no edge is under way for longer than %d of the shortest bits, but those from "
                    "'%s' are: %s, expected at most %s",
                    CW_DELAY_BITS_MAX, cfg_of(self)->nodes[f->node].name, ns(self, f->is),
                    ns(self, f->allowed));
}

/* Complains about what the library finds wrong in a bus, at the key of the node that is to
 * blame. */
static void limits_complain(schema *self, yaml_node_t *nodes, const cw_bus_finding *f)
{
    static const char *const none[] = {NULL};
    static const char *const ways[] = {"position", "stub", "tx-delay", "rx-delay", "ringing", NULL};
    const bool of_way = f->limit == CW_LIMIT_DELAY;
    yaml_node_t *node = cfg_node_map(self, nodes, of_way ? f->other : f->node);

    switch (f->limit) {
    case CW_LIMIT_BIT_MOST:
    case CW_LIMIT_BIT_LEAST:
        complain_of_bit(self, node, f);
        return;
    case CW_LIMIT_DELAY:
        complain_of_way(self, node, f);
        return;
    case CW_LIMIT_WAY:
        schema_complain(self, limits_place_of(self, node, ways),
                        "no delay and no way is longer than 10 ms");
        return;
    case CW_LIMIT_LONG_BITS:
        schema_complain(self, node, "with bits over 1.7 s no node has a clock or a delay");
        return;
    case CW_LIMIT_RULES:
        schema_complain(self, nodes, "at most %d rules and replies", CW_RULES_MAX);
        return;
    case CW_LIMIT_TIMING:
    case CW_LIMIT_NODE:
    case CW_LIMIT_BUS:
    case CW_LIMIT_PROTECTION:
    case CW_LIMIT_NONE:
        break;
    }
    schema_complain(
        self, limits_place_of(self, node, none), "the bus does not take this node: its %s",
        f->limit == CW_LIMIT_TIMING ? "bit timing is out of range" : "settings are out of range");
}

/* Each node has its message about its own values. It has none of them when the others are looked
 * at. */
void cfg_check_limits(schema *self, yaml_node_t *nodes, bool early)
{
    cw_node_config of_nodes[CW_NODES_MAX];
    cw_bus_config bus;
    bool more = true;

    cfg_bus_config(&bus, of_nodes, cfg_of(self));
    for (size_t i = 0; i <= bus.node_count && more; i++) {
        const cw_bus_finding found = cw_bus_check(&bus);
        const bool late = found.limit == CW_LIMIT_BUS || found.limit > CW_LIMIT_DELAY;
        if (found.limit == CW_LIMIT_NONE || (early && late))
            return;
        limits_complain(self, nodes, &found);
        more = !late && found.limit != CW_LIMIT_DELAY;
        of_nodes[found.node].timing = (cw_node_timing){.place = 0};
    }
}
