/* SPDX-License-Identifier: MIT
 *
 * losses.h - logs losses since the last call, since no loss is silent, and nodes that went bus-off.
 */
#ifndef CANWIRE_SERVE_LOSSES_H
#define CANWIRE_SERVE_LOSSES_H

#include "config/config.h"
#include "engine/report.h"

#define LOSS_KINDS (CW_DROP_COUNT + 12)

/* The losses that have been logged; starts all zero. */
typedef struct losses {
    uint64_t logged[CW_NODES_MAX][LOSS_KINDS];
} losses;

/* Adapts to a changed configuration, in which nodes have other places. */
void losses_remap(losses *l, const uint8_t from[CW_NODES_MAX]);

/* Logs a line for each node with losses or a bus-off since the last call. Drops that the
 * configuration asks for (one-shot, faults) and those of bus-off are expected and not logged. */
void losses_log(losses *l, const cfg *config, const cw_bus *bus, const report *beyond);

#endif
