/* SPDX-License-Identifier: MIT
 *
 * gateways.h - carries frames between the buses of a rig.
 *
 * It never looks at data. It sees the events of all buses in the order of time. It hands frames to
 * the nodes on the other side, for the tick at which their delay has passed.
 */
#ifndef CANWIRE_RUN_GATEWAYS_H
#define CANWIRE_RUN_GATEWAYS_H

#include "config/rig.h"

#include <jansson.h>

typedef struct gateways gateways;

/* Hands a frame to a node of a bus, as cw_node_send() does. */
typedef cw_status gateways_send(void *user, size_t bus, unsigned node, const cw_frame *frame,
                                uint64_t at_tick);

/* Makes the gateways of a rig, which must live longer. Returns NULL without memory. */
gateways *gateways_new(const rig *config, gateways_send *send, void *user);

/* NULL is allowed. */
void gateways_free(gateways *self);

/* Returns the nodes of gateways on a bus, as a set. */
uint64_t gateways_nodes(const gateways *self, size_t bus);

/* Adapts to nodes of a bus in other places; `from` has the old node for each new one. */
void gateways_remap(gateways *self, size_t bus, const uint8_t from[CW_NODES_MAX]);

/* Takes an event of a bus. It is kept until the next meeting, if it concerns a gateway. Returns
 * false without memory. */
bool gateways_note(gateways *self, size_t bus, const cw_event *event);

/* Passes on, in the order of time, all frames that gateways have received since the last call. No
 * bus may be beyond one of these events. Returns the set of buses that have been given frames. */
uint32_t gateways_meet(gateways *self);

#define GATEWAYS_ALL SIZE_MAX

/* Returns the statistics of the gateways of a bus, or of all, as JSON, to be released by the
 * caller. */
json_t *gateways_stats(const gateways *self, size_t bus);

/* Returns the frames that had no room in the queues of a gateway; end: the one that received
 * them. */
uint64_t gateways_lost(const gateways *self, size_t gateway, unsigned end);

#endif
