/* SPDX-License-Identifier: MIT
 *
 * losses.h - logs losses since the last call, since no loss is silent, and nodes that went bus-off.
 */
#ifndef CANWIRE_SERVE_LOSSES_H
#define CANWIRE_SERVE_LOSSES_H

#include "config/config.h"
#include "engine/report.h"

#include <jansson.h>
#include <stdbool.h>

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

#define LOSSES_UNWANTED 4 /* kinds */

/* The losses of a node that have been logged, and the time for the next line. */
typedef struct losses_node {
    uint64_t logged[LOSS_KINDS];
    uint64_t kinds;   /* that the lines of late had */
    unsigned passed;  /* seconds since the last line */
    unsigned wait;    /* ... up to the next one with nothing but these kinds */
    uint64_t seen[LOSSES_UNWANTED];   /* a second ago */
    unsigned lately[LOSSES_UNWANTED]; /* seconds for which the last one is reported */
} losses_node;

/* The losses that have been logged; starts all zero. */
typedef struct losses {
    losses_node nodes[CW_NODES_MAX];
    uint64_t skipped_ns; /* a second ago */
    unsigned skipped_lately;
} losses;

#define LOSSES_WAIT_MAX 60u /* s between lines about what goes on and on */

#define LOSSES_LATELY_S 600u /* longer than the time between two looks of a monitor */

/* Adapts to a changed configuration, in which nodes have other places. */
void losses_remap(losses *l, const uint8_t from[CW_NODES_MAX]);

/* Notes the counters of a node, for what happened lately; called each second. */
void losses_note(losses_node *node, const uint64_t now[LOSS_KINDS]);

/* Puts `lately`: the frames that were lost in the last LOSSES_LATELY_S other than by intention, and
 * bus time that was skipped. */
void losses_put_lately(const losses *l, const cfg *config, json_t *status);

/* Returns the text behind the number of a loss, or of going bus-off or restarting. */
const char *losses_text(loss_kind kind, uint64_t count);

/* Returns true when a line about losses of these kinds is due; called each second. Losses that go
 * on have a line after 1, 2, 4 and more seconds, at last one a minute, with all of that time. A
 * kind that was not in the lines of the last minute has one at once. */
bool losses_due(losses_node *node, uint64_t kinds);

/* Logs a line for each node with losses, a bus-off or a restart since the last one, when it is due.
 * Called each second; last: nothing is waiting now. */
void losses_log(losses *l, const cfg *config, const cw_bus *bus, const report *beyond, bool last);

#endif
