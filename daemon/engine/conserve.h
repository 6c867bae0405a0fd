/* SPDX-License-Identifier: MIT
 *
 * conserve.h - checks that all frames between ports and bus are accounted for.
 *
 * For each node, at any time when all events of the bus have been taken:
 *
 *   read from its interface + released = handed in + still in the inbox
 *   handed in + made by rules          = transmitted + queued + held back + dropped, by reason
 *   accepted + made by rules           = received + held back + dropped, by reason
 *   received                           = written to its interface + failed to be written + unheard
 *                                        (by an ECU that was not connected, or without a port)
 *
 * The second and third are the library's own (cw_node_stats_balance()). Nodes may get other
 * interfaces while the bus runs, and interfaces other nodes. Each pair of node and interface counts
 * for the time that they belong together.
 */
#ifndef CANWIRE_ENGINE_CONSERVE_H
#define CANWIRE_ENGINE_CONSERVE_H

#include "config/config.h"
#include "port/port.h"

typedef struct conserve_node {
    uint64_t released; /* frames of its own traffic that were handed in */
    uint64_t unheard;  /* frames received by a node that has no port */
    port_stats past;   /* of its earlier ports, less the present one's counts from before (modulo
                          2^64) */
} conserve_node;

/* Starts all zero. */
typedef struct conserve {
    conserve_node nodes[CW_NODES_MAX];
} conserve;

/* Note that a node gets a port, or loses it; NULL is allowed. */
void conserve_opened(conserve *c, unsigned node, port *opened);
void conserve_closing(conserve *c, unsigned node, port *closing);

/* Counts a frame that a node received while its port was missing (has_port), or without any
 * port. */
void conserve_missed(conserve *c, unsigned node, bool has_port);

/* Adapts to a changed configuration, in which nodes have other places. */
void conserve_remap(conserve *c, const uint8_t from[CW_NODES_MAX]);

/* Returns the sum for a node and its interfaces. own_port: the present one, or NULL. */
void conserve_get_stats(port_stats *out, const conserve *c, unsigned node, port *own_port);

/* Returns true when the counts of a node balance. */
bool conserve_balances(const conserve *c, const cw_bus *bus, unsigned node, port *own_port);

/* Logs an error for each node whose counts do not balance; returns their number. */
unsigned conserve_check(const conserve *c, const cfg *config, const cw_bus *bus,
                        port *const *ports);

#endif
