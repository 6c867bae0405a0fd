/* SPDX-License-Identifier: MIT
 *
 * meeting.h - advances the buses of a rig together, so that gateways hand over frames in time.
 *
 * Buses meet at each tick at which a node may receive a frame. There the gateways get the events of
 * all of them, and no frame comes to a bus that is already beyond it. Between such ticks, a bus
 * without anything to do may stay behind.
 */
#ifndef CANWIRE_RUN_MEETING_H
#define CANWIRE_RUN_MEETING_H

#include "run/gateways.h"
#include "run/release.h"

typedef struct meeting_calls {
    /* Advances a bus to a tick, with its events, which are noted for the gateways. Returns false
     * when it does not get there now. */
    bool (*go)(void *user, size_t bus, uint64_t tick);
    /* Returns meeting_next() of a bus. */
    uint64_t (*next)(const void *user, size_t bus);
} meeting_calls;

typedef struct meeting {
    gateways *gateways;
    const meeting_calls *calls;
    void *user;
    size_t bus_count;
    uint64_t next[RIG_BUSES_MAX]; /* of buses with gateways; CW_NEVER for others */
} meeting;

/* Returns a tick after now before which nobody on a bus receives a frame, when no frame is put
 * in. */
uint64_t meeting_next(const cw_bus *bus, const release_plan *plan, const cfg *config);

/* Looks at a bus again, after a change by others. */
void meeting_look(meeting *m, size_t bus);

/* Returns the tick of the next meeting; CW_NEVER: no gateway will get a frame. */
uint64_t meeting_tick(const meeting *m);

/* Holds a meeting at a tick, not after meeting_tick(). The buses of a set get there in any case.
 * Returns false when one of the buses does not. */
bool meeting_hold(meeting *m, uint64_t tick, uint32_t buses);

#endif
