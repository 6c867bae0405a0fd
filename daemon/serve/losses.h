/* SPDX-License-Identifier: MIT
 *
 * losses.h - says in the log what was lost since the last look, for nothing is dropped silently,
 * and who went bus-off.
 */
#ifndef CANWIRE_SERVE_LOSSES_H
#define CANWIRE_SERVE_LOSSES_H

#include "config/config.h"
#include "engine/report.h"

#define LOSS_KINDS (CW_DROP_COUNT + 8)

/* What has been logged so far; starts all zero. */
typedef struct losses {
    uint64_t logged[CW_NODES_MAX][LOSS_KINDS];
} losses;

/* The configuration has changed: nodes have other places. */
void losses_remap(losses *l, const uint8_t from[CW_NODES_MAX]);

/* One line for each node that has lost something or went bus-off since the last call. Drops that
 * the configuration asks for (one-shot, faults) and those of bus-off are no news and not logged. */
void losses_log(losses *l, const cfg *config, const cw_bus *bus, const report *beyond);

#endif
