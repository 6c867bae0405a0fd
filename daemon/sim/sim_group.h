/* SPDX-License-Identifier: MIT
 *
 * sim_group.h - runs one bus, or the buses of a rig, in one virtual time.
 *
 * The buses of a rig go from meeting to meeting (meeting.h), with the gateways between them.
 */
#ifndef CANWIRE_SIM_SIM_GROUP_H
#define CANWIRE_SIM_SIM_GROUP_H

#include "run/meeting.h"
#include "sim/sim_run.h"

typedef struct sim_group {
    size_t count;
    sim_run *runs[RIG_BUSES_MAX]; /* not owned */
    meeting meeting;              /* without gateways for one bus */
    uint64_t rest_from;  /* a meeting since which all buses rest; CW_NEVER: there is none */
    uint64_t rest_until; /* ... and how far they surely do */
    bool step;      /* the buses of a rig meet at each bit; this is the reference */
    bool no_memory; /* a gateway has lost a frame */
    FILE *messages; /* or NULL */
    void *user;
    void (*reached)(void *user); /* called when all buses have reached another tick; or NULL */
} sim_group;

/* Makes the gateways of a rig, which must live longer. NULL: there is one bus. The caller then
 * adds the runs. Returns false without memory. */
bool sim_group_open(sim_group *g, const rig *config);

void sim_group_close(sim_group *g);

/* Takes each CW_EVENT_RX and CW_EVENT_DROP of a bus that has gateways. */
void sim_group_note(sim_group *g, size_t bus, const cw_event *event);

/* Returns true when gateways want these events of a bus. */
bool sim_group_wants(const sim_group *g, size_t bus);

/* Begins all runs. */
void sim_group_begin(sim_group *g);

/* Puts all buses back to time 0, and forgets frames in gateways. Returns false without memory. */
bool sim_group_restart(sim_group *g, const rig *config);

/* Runs to the end: `until` of the runs, which is the same for all, otherwise when all traffic is
 * done; see sim_go(). A run may lower its `until` meanwhile. */
void sim_group_simulate(sim_group *g);

/* Advances all buses to a tick, with all releases up to there. */
void sim_group_go_to(sim_group *g, uint64_t tick);

/* Does what is due where the buses are, such as to drop a frame; the tick is in their next bits. */
void sim_group_do_due(sim_group *g, uint64_t tick);

/* Ends bits that have begun at a tick, where they may have events up to there: on each bus its
 * own. */
void sim_group_settle(sim_group *g, uint64_t tick);

/* Returns the tick that all buses have reached. */
uint64_t sim_group_now(const sim_group *g);

/* Returns a tick after that before which nobody receives a frame, when none is put in. */
uint64_t sim_group_next(const sim_group *g);

/* Returns the last tick up to a given one, to which all buses have gone, of which all is known. */
uint64_t sim_group_known(const sim_group *g, uint64_t tick);

/* Returns the end of the bit that ends first, of the next ones of all buses. */
uint64_t sim_group_bit(const sim_group *g);

/* Returns true when no traffic is to come, or when no bus has had any for 10 s. */
bool sim_group_is_over(const sim_group *g);

/* Returns true when a file of traffic could not be read, or memory was short. */
bool sim_group_failed(const sim_group *g);

#endif
