/* SPDX-License-Identifier: MIT
 *
 * release.h - the periodic traffic of nodes without port: when which frame is handed in.
 *
 * The same in canwired and in `canwire sim`. Release k of a `send` is at offset + k * every, k < count.
 */
#ifndef CANWIRE_RELEASE_H
#define CANWIRE_RELEASE_H

#include "config.h"

typedef struct release_plan release_plan;

/* The releases of a configuration, which must live longer. NULL: out of memory. */
release_plan *release_plan_new(const cfg *config);

void release_plan_free(release_plan *plan);

/* Passes over all releases before a tick: for a plan that joins a running bus. */
void release_skip_before(release_plan *plan, uint64_t tick);

/* Tick of the next release, CW_NEVER when all are done. */
uint64_t release_next_tick(const release_plan *plan);

/* The frame of the next release and its node. There must be one; it is good until the next
 * release_hand_in(). */
const cw_frame *release_first(const release_plan *plan, unsigned *node);

/* Hands the next release to its node. Returns what cw_node_send() says; on CW_FULL nothing has
 * changed. There must be one. */
cw_status release_hand_in(release_plan *plan, cw_bus *bus);

#endif
