/* SPDX-License-Identifier: MIT
 *
 * meeting.h - advances the buses of a rig together, so that gateways hand over frames in time.
 *
 * Each bus goes on in strides, as far as no gateway can give it a frame. For that, each bus tells
 * when a gateway may get a frame of it. That frame comes to the other bus after the delay of its
 * rule. So buses that no gateway can concern for a while do not wait for each other.
 */
#ifndef CANWIRE_RUN_MEETING_H
#define CANWIRE_RUN_MEETING_H

#include "run/gateways.h"
#include "run/release.h"

/* The frames that gateways may expect of a bus. */
typedef struct meeting_outlook {
    uint64_t next; /* a bit to come, before which the bus tells of no frame that they carry, when no
                      frame is put in */
    uint64_t early; /* ticks by which such a frame may have come before the end of that bit */
    uint64_t reaction; /* ticks in which they get none because of one that is put in; CW_NEVER: they
                          get none at all by that */
} meeting_outlook;

typedef struct meeting_calls {
    /* Advances a bus to a tick, with its events, which are noted for the gateways. Returns false
     * when it does not get there now. */
    bool (*go)(void *user, size_t bus, uint64_t tick);
    /* Returns meeting_find() of a bus. */
    meeting_outlook (*look)(void *user, size_t bus);
} meeting_calls;

typedef struct meeting {
    gateways *gateways;
    const meeting_calls *calls;
    void *user;
    size_t bus_count;
    meeting_outlook outlook[RIG_BUSES_MAX];
    uint64_t limit[RIG_BUSES_MAX]; /* before this tick no gateway gives it a frame */
} meeting;

/* Returns a tick after now before which nobody on a bus receives a frame, when no frame is put
 * in. */
uint64_t meeting_next(const cw_bus *bus, const release_plan *plan, const cfg *config);

/* Returns the outlook of a bus. */
meeting_outlook meeting_find(const gateways_bus *place, const cw_bus *bus, release_plan *plan,
                             const cfg *config);

/* Looks at a bus again, after a change by others. */
void meeting_look(meeting *m, size_t bus);

/* Finds, with these looks, the ticks before which gateways give the buses no further frame. */
void meeting_find_limits(meeting *m);

/* Advances to a tick: a set of buses, and others as far as gateways get frames of them. Returns
 * false when one of them does not get there. */
bool meeting_run(meeting *m, uint64_t end, uint32_t buses);

#endif
