/* SPDX-License-Identifier: MIT
 *
 * output.h - writes what happens on a bus: events as JSON lines, candump logs, statistics.
 *
 * Nothing here fails by itself; the caller looks at ferror(out) when it is done.
 */
#ifndef CANWIRE_RECORD_OUTPUT_H
#define CANWIRE_RECORD_OUTPUT_H

#include "canwire.h"
#include "config/config.h"

#include <jansson.h>
#include <stdio.h>

/* One JSON object per line and node concerned, nodes in the order of the configuration.
 * CW_EVENT_TOLERATED writes nothing. */
void output_event(FILE *out, const cfg *config, const cw_event *event);

/* A line as candump -L writes it for each tx event; the interface is the node's port, else the
 * node's name. Other events write nothing. */
void output_log(FILE *out, const cfg *config, const cw_event *event);

/* The same at another time: nanoseconds since 1970, say. */
void output_log_at(FILE *out, const cfg *config, const cw_event *event, uint64_t time_ns);

/* All statistics of the bus, its nodes and rules as one indented JSON object. Times are integers
 * in nanoseconds. bus->nodes and rules are those of config. */
void output_stats(FILE *out, const cfg *config, const cw_bus *bus);

/* Its parts, to be released by the caller: of the bus, of a node, of a rule. */
json_t *output_bus_stats(const cfg *config, const cw_bus *bus);
json_t *output_node_stats(const cfg_node *node, const cw_node_stats *stats);
json_t *output_rule_stats(const cfg *config, const cw_bus *bus, unsigned rule);

#endif
