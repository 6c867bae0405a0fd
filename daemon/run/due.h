/* SPDX-License-Identifier: MIT
 *
 * due.h - finds the tick of the next event that is visible outside of the bus.
 */
#ifndef CANWIRE_RUN_DUE_H
#define CANWIRE_RUN_DUE_H

#include "config/config.h"
#include "run/release.h"

/* Returns the tick of the next end of a frame, restart and so on. CW_NEVER: the bus rests and
 * nothing is planned.
 *
 * A release itself is not visible: it may be handed in late, at its tick, as long as the bus has
 * not passed it. So the earliest end of its frame counts. If rules may act on the frame, that end
 * is unknown, and the tick of the release counts.
 */
uint64_t due_tick(const cw_bus *bus, const release_plan *plan, const cfg *config);

#endif
