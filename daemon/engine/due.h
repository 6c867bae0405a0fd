/* SPDX-License-Identifier: MIT
 *
 * due.h - when the first thing comes that anybody outside of the bus can see.
 */
#ifndef CANWIRE_ENGINE_DUE_H
#define CANWIRE_ENGINE_DUE_H

#include "config/config.h"
#include "run/release.h"

/*
 * Tick of the next end of a frame, restart and so on, CW_NEVER when the bus rests and nothing is
 * planned. A release by itself is nothing that is seen: it may be handed in later, at its tick, as
 * long as the bus has not gone past it; so what counts is when its frame can be over at the
 * earliest. Where rules may act on it that is not known, and its own tick counts.
 */
uint64_t due_tick(const cw_bus *bus, const release_plan *plan, const cfg *config);

#endif
