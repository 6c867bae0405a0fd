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

/* Makes the gateways of a rig, which must live longer. Returns NULL without memory. */
gateways *gateways_new(const rig *config);

/* NULL is allowed. */
void gateways_free(gateways *self);

/* Takes an event of a bus, and passes a frame on that a gateway has received. No bus of
 * `buses`, which are in the order of the rig, may be behind the event. */
void gateways_event(gateways *self, cw_bus *const *buses, size_t bus, const cw_event *event);

/* Returns the statistics of all rules as JSON, to be released by the caller. */
json_t *gateways_stats(const gateways *self);

#endif
