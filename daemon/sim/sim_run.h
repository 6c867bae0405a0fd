/* SPDX-License-Identifier: MIT
 *
 * sim_run.h - a bus in virtual time: hands in releases, advances time, passes events and bits on.
 */
#ifndef CANWIRE_SIM_SIM_RUN_H
#define CANWIRE_SIM_SIM_RUN_H

#include "config/config.h"
#include "run/release.h"

#include <stdio.h>

#define SIM_NOTE "canwire sim: " /* begins a note about a file; an error has its place there */

#define SIM_SINKS_MAX 16

/* An observer of a run. Both functions may be NULL; neither may change the bus. */
typedef struct sim_sink {
    void *user;
    void (*event)(void *user, const cw_event *event); /* each event, in order */
    uint32_t kinds; /* kinds of events it needs, as bits 1u << cw_event_kind; 0: CW_EVENTS_USUAL.
                       It may get others */
    void (*bit)(void *user, const cw_bus *bus); /* at the end of each bit; after its events */
    uint64_t bits_from; /* ticks: only bits that end after this */
    uint64_t bits_to;   /* ... and start before this; 0: no end. Other bits are not simulated singly
                           for it */
    bool changes; /* bits that equal the one before need not be shown */
} sim_sink;

struct sim_run;

/* Lets a program show the progress of a run. All zeros shows nothing. */
typedef struct sim_show {
    void *user;
    void (*look)(void *user, const struct sim_run *run); /* called every few milliseconds */
    void (*wipe)(void *user); /* called before a message, and at the end */
} sim_show;

typedef struct sim_run {
    const cfg *config; /* not owned */
    void *memory; /* of the bus; NULL: not owned */
    size_t room;  /* its bytes */
    void *start;  /* its state at time 0 without rules; NULL: see sim_restart() */
    cw_sync_record *syncs; /* see sim_count_syncs() */
    cw_bus *bus;
    release_plan *plan;
    uint64_t until;         /* tick, or CW_NEVER: to the end of the traffic */
    uint64_t last_activity; /* tick of the last tx or release */
    uint64_t last_rule;     /* ... and of the last time of a rule, past or to come */
    bool step;              /* every bit is simulated, even without observers */
    bool began_off_grid;    /* clocks of nodes differ, or they have delays */
    bool stopped;           /* see sim_stop() */
    bool in_steps;          /* see sim_go_in_steps() ... */
    bool paused;            /* ... and sim_pause() */
    FILE *messages;         /* or NULL */
    bool roomy;             /* there is room for more rules, and for longer queues */
    uint64_t careful_from;  /* see sim_be_careful() */
    bool watching;          /* last setting of the bus */
    unsigned calm_bits;     /* bits shown since the last event */
    sim_show show;          /* set by the caller, if wanted */
    unsigned sink_count;
    uint32_t bit_sinks; /* sinks with a `bit`, as a set */
    sim_sink sinks[SIM_SINKS_MAX];
} sim_run;

/* Makes the bus of a configuration, at time 0; the configuration must live longer. Messages, also
 * about its files, go to `messages`; NULL: nowhere. Returns false without memory or a bus. The run
 * must be closed in either case. */
bool sim_open(sim_run *s, const cfg *config, FILE *messages);

/* Does the same for a bus that gets more rules and other settings later. */
bool sim_open_roomy(sim_run *s, const cfg *config, FILE *messages);

/* Puts a bus of sim_open() back to time 0, in the same memory. The configuration has the same
 * nodes and as many rules; the sinks stay. Returns false without memory or a bus. */
bool sim_restart(sim_run *s);

/* Counts synchronisations of the bus, which must be one of sim_open(). Returns false without
 * memory. */
bool sim_count_syncs(sim_run *s);

void sim_close(sim_run *s);

/* Adds a sink, at most SIM_SINKS_MAX; a copy is kept. */
void sim_add_sink(sim_run *s, const sim_sink *sink);

/* Runs to the end: `until`, otherwise when all traffic is done and 11 recessive bits have passed.
 * After 10 s of bus time without a tx or a release the run ends with a message on standard error.
 * Returns false when the file of a replay cannot be read; the run has ended there. */
bool sim_go(sim_run *s);

/* ---- Runs with another driver ---------------------------------------------------------------- */

/* Opens a run on an existing bus, which lives longer, without releases. The run must be closed in
 * either case. */
bool sim_open_bus(sim_run *s, const cfg *config, cw_bus *bus, FILE *messages);

/* Begin and end the run. */
void sim_begin(sim_run *s);
void sim_end(sim_run *s);

/* Changes the kinds of events that a sink needs, by the order in which sinks were added. */
void sim_set_kinds(sim_run *s, unsigned sink, uint32_t kinds);

/* Advances to a tick, which is the end of a bit. Returns false when the run has ended. */
bool sim_advance(sim_run *s, uint64_t tick);

/* Passes on all events of the bus, and then one of another source, if it is not NULL. */
void sim_pass_on(sim_run *s, const cw_event *event);

/* Continues with another bus that has taken over. */
void sim_change(sim_run *s, const cfg *config, cw_bus *bus);

/* ---- Runs of several buses ------------------------------------------------------------------- */

/* Advances to a tick with all releases up to there. */
void sim_release_to(sim_run *s, uint64_t tick);

/* Does the same without the releases of that tick, before which gateways hand in frames. */
void sim_release_before(sim_run *s, uint64_t tick);

/* Lets the bus go in single steps from now on, or no more. These are single bits, rows of equal
 * bits, and the parts of a clean frame that has its end behind the tick of the advance. So the bus
 * is at its last event after each step, or in the bit of it. */
void sim_go_in_steps(sim_run *s, bool steps);

/* Ends the present advance with the step of the present event. A sink calls it; it does nothing
 * when the bus does not go in steps. The next advance goes on. */
void sim_pause(sim_run *s);

/* Returns true when nodes may end bits of their own before the bus does. */
bool sim_has_own_bits(const sim_run *run);

/* Does what is due at a tick that lies in the next bit, such as to drop a frame, and tells it. */
void sim_do_due(sim_run *run, uint64_t tick);

/* Returns true when the bit that has begun at a tick may have events up to there. */
bool sim_owes_events(const sim_run *s, uint64_t tick);

/* Goes on until all traffic is done, as sim_go() does. Returns false when the run ends before the
 * last release. */
bool sim_finish(sim_run *s);

/* Returns how far the bus surely rests behind its last release, at most to a tick. The traffic is
 * over then if it is over now. Returns the present tick when nothing is sure. */
uint64_t sim_rests_until(const sim_run *s, uint64_t tick);

/* Returns the tick of the last tx, the last release, or the last time of a rule, which may be to
 * come. A run to the end of the traffic ends 10 s after it. */
uint64_t sim_last_activity(sim_run *s);

/* Returns true when the traffic is over: no frame waits, and neither a release nor the time of a
 * rule is to come. */
bool sim_traffic_is_over(const sim_run *s);

/* Estimates the tick at which the run ends; CW_NEVER: unknown. */
uint64_t sim_guess_end(const sim_run *s);

/* ---- Stopping -------------------------------------------------------------------------------- */

/* Makes the bus stay behind its events from a tick on, which is slow. Call it before sim_go() when
 * a sink may stop the run from there on, and all must end at that point. By default (CW_NEVER) the
 * bus runs ahead of its events to the end. */
void sim_be_careful(sim_run *s, uint64_t from);

/* Ends the run with the present event, at its tick; a sink calls it. Other events of that tick are
 * still passed on. A careful bus ends with the bit of the event. */
void sim_stop(sim_run *s, uint64_t tick);

#endif
