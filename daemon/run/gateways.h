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

/* Hands a frame to a node of a bus, as cw_node_send() does. When there is no room, the bus may go
 * on to the tick at which the gateway has received the frame. */
typedef cw_status gateways_send(void *user, size_t bus, unsigned node, const cw_frame *frame,
                                uint64_t received, uint64_t at_tick);

/* Two buses, of which gateways carry frames from one to the other. */
typedef struct gateways_way {
    size_t from;
    size_t to;
    uint64_t delay; /* ticks: the least one of all rules */
} gateways_way;

/* Makes the gateways of a rig, which must live longer. Returns NULL without memory. */
gateways *gateways_new(const rig *config, gateways_send *send, void *user);

/* NULL is allowed. */
void gateways_free(gateways *self);

/* Returns the nodes of gateways on a bus, as a set. */
uint64_t gateways_nodes(const gateways *self, size_t bus);

/* Adapts to nodes of a bus in other places; `from` has the old node for each new one. */
void gateways_remap(gateways *self, size_t bus, const uint8_t from[CW_NODES_MAX]);

/* Returns the ways between buses, *count of them. */
const gateways_way *gateways_ways(const gateways *self, size_t *count);

/* Returns the buses at which ways begin, as a set. */
uint32_t gateways_feeds(const gateways *self);

/* A bus of a rig, as the user of gateways_want(). */
typedef struct gateways_bus {
    gateways *gateways;
    size_t bus;
} gateways_bus;

/* Returns true when a gateway carries a frame that a node of a bus sends; a cw_frame_test. */
bool gateways_want(const void *bus, unsigned node, const cw_frame *frame);

/* Sets the nodes of gateways on a bus that get what they send. */
void gateways_hear_own(gateways *self, size_t bus, uint64_t nodes);

/* Sets whether any frame on a bus may make other nodes send. */
void gateways_answer(gateways *self, size_t bus, bool answers);

/* Takes an event of a bus. A frame is kept until gateways_meet(). Returns false without memory. */
bool gateways_note(gateways *self, size_t bus, const cw_event *event);

/* Passes on, in the order of time, the frames that gateways have received before a tick. No bus may
 * be beyond the tick at which it gets one, and none may tell about an earlier reception later.
 * given[BUS], if there is an array: when a bus gets its first frame that others carry on or answer;
 * CW_NEVER: there is none. */
void gateways_meet(gateways *self, uint64_t before, uint64_t given[RIG_BUSES_MAX]);

/* Returns, for each bus, the tick of its first frame that has not been passed on, or CW_NEVER. */
const uint64_t *gateways_first(const gateways *self);

/* Returns true when such a frame was received before a tick. */
bool gateways_wait(const gateways *self, uint64_t before);

#define GATEWAYS_ALL SIZE_MAX

/* Returns the statistics of the gateways of a bus, or of all, as JSON, to be released by the
 * caller. */
json_t *gateways_stats(const gateways *self, size_t bus);

/* Returns the frames that had no room in the queues of a gateway; end: the one that received
 * them. */
uint64_t gateways_lost(const gateways *self, size_t gateway, unsigned end);

#endif
