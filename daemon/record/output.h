/* SPDX-License-Identifier: MIT
 *
 * output.h - writes the events of a bus as JSON lines and candump logs, and its statistics.
 *
 * No function reports failures; the caller checks ferror(out) at the end.
 */
#ifndef CANWIRE_RECORD_OUTPUT_H
#define CANWIRE_RECORD_OUTPUT_H

#include "canwire.h"
#include "config/config.h"

#include <jansson.h>
#include <stdio.h>

/* Writes one JSON object per line for each node concerned, nodes in the order of the configuration.
 * CW_EVENT_TOLERATED writes nothing. */
void output_event(FILE *out, const cfg *config, const cw_event *event);

/* Writes the same lines with the bus, for a reader of several buses. */
void output_event_of_bus(FILE *out, const cfg *config, const cw_event *event);

/* Writes a line of candump -L for each tx event; the interface is the node's port, otherwise the
 * node's name. Other events write nothing. */
void output_log(FILE *out, const cfg *config, const cw_event *event);

/* Writes the same line with another time, such as nanoseconds since 1970. */
void output_log_at(FILE *out, const cfg *config, const cw_event *event, uint64_t time_ns);

/* Writes all statistics of the bus, its nodes and rules as one indented JSON object. Times are
 * integers in nanoseconds. The nodes of the bus and its rules are those of config. */
void output_stats(FILE *out, const cfg *config, const cw_bus *bus);

/* Returns the same object, to be released by the caller. */
json_t *output_all_stats(const cfg *config, const cw_bus *bus);

/* Return the parts of these statistics, to be released by the caller: of the bus, of a node, of a
 * rule. */
json_t *output_bus_stats(const cfg *config, const cw_bus *bus);
json_t *output_node_stats(const cfg_node *node, const cw_node_stats *stats);
json_t *output_rule_stats(const cfg *config, const cw_bus *bus, unsigned rule);

/* Puts the counters of a table that are shown there, with the values of such statistics. */
void output_put_counters(json_t *object, const cw_stat *counters, cw_stat_shown shown,
                         const void *stats);

/* Returns the value of a counter of a bus that is worked out of others (DERIVED). */
uint64_t output_derived(const cw_stat *counter, const cw_bus_stats *stats);

/* Returns true when there is anything to tell about CAN FD: some node knows it, or there were such
 * frames before a reload. */
bool output_has_fd(const cfg *config, const cw_bus *bus);

/* Puts what only some buses have. These are the errors of a node at the data rate by type, and what
 * its filters and receive buffers have kept from its host. */
void output_put_more(json_t *object, const cw_bus *bus, unsigned node);

/* Finds out how the clock of a node keeps up with the bus. Returns false where nothing has been
 * counted on a bus whose clocks are all the same, or by a bus that does not count. */
bool output_sync_stats(cw_sync_stats *stats, const cfg *config, const cw_bus *bus, unsigned node);

/* Returns the same as JSON, to be released by the caller; null for false. */
json_t *output_synchronisation(const cfg *config, const cw_bus *bus, unsigned node);

#endif
