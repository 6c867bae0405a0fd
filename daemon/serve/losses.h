/* SPDX-License-Identifier: MIT
 *
 * losses.h - logs losses since the last call, since no loss is silent, and nodes that went bus-off.
 */
#ifndef CANWIRE_SERVE_LOSSES_H
#define CANWIRE_SERVE_LOSSES_H

#include "config/config.h"
#include "engine/report.h"

/* First the reasons of cw_drop for frames on their way onto the bus, then the same for frames on
 * their way to the host. */
typedef enum loss_kind {
    LOSS_RECEIVED = CW_DROP_COUNT,
    LOSS_NOT_TAKEN = 2 * CW_DROP_COUNT,
    LOSS_KERNEL,
    LOSS_ERROR_FRAMES,
    LOSS_MALFORMED,
    LOSS_REFUSED,
    LOSS_BUS_OFF,
    LOSS_RESTARTS,
    LOSS_LOOPLESS,
    LOSS_CLIENTS,
    LOSS_MISSING,
    LOSS_STRANGERS,
    LOSS_GAVE_WAY,
    LOSS_KINDS
} loss_kind;

/* The losses that have been logged; starts all zero. */
typedef struct losses {
    uint64_t logged[CW_NODES_MAX][LOSS_KINDS];
} losses;

/* Adapts to a changed configuration, in which nodes have other places. */
void losses_remap(losses *l, const uint8_t from[CW_NODES_MAX]);

/* Returns the text behind the number of a loss, or of going bus-off or restarting. */
const char *losses_text(loss_kind kind);

/* Logs a line for each node with losses, a bus-off or a restart since the last call. */
void losses_log(losses *l, const cfg *config, const cw_bus *bus, const report *beyond);

#endif
