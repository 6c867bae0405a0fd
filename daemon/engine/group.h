/* SPDX-License-Identifier: MIT
 *
 * group.h - the buses of a rig in real time: an engine each, with one clock and one timer.
 *
 * Each engine is used as if its bus were alone. A wake-up is one moment of the clock for all buses,
 * and they meet (meeting.h) where a gateway may get a frame. A bus without anything to do stays
 * behind, which costs nothing.
 */
#ifndef CANWIRE_ENGINE_GROUP_H
#define CANWIRE_ENGINE_GROUP_H

#include "engine/engine.h"
#include "run/gateways.h"

typedef struct engine_group engine_group;

/* Opens the ports of all buses and starts them at bus time 0. The configurations, in the order of
 * the rig, must live longer, as the rig does. Returns NULL after logging the reason. */
engine_group *engine_group_start(struct ev_loop *loop, const rig *config, live *const *lives);

/* Frees the engines, too. NULL is allowed. */
void engine_group_free(engine_group *g);

engine *engine_group_bus(const engine_group *g, size_t bus);
const gateways *engine_group_gateways(const engine_group *g);

#endif
