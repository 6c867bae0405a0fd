/* SPDX-License-Identifier: MIT
 *
 * local_time.h - local times and slots of time-triggered nodes, for statistics and status.
 */
#ifndef CANWIRE_RECORD_LOCAL_TIME_H
#define CANWIRE_RECORD_LOCAL_TIME_H

#include "config/config.h"

#include <jansson.h>

/* Puts "local_time" and "schedule" of a node into an object, if it has them. */
void local_time_put(json_t *object, const cfg *config, const cw_bus *bus, unsigned node);

/* Adds the counts of all triggers of a node. */
cw_trigger_stats local_time_slots(const cw_bus *bus, unsigned node);

#endif
