/* SPDX-License-Identifier: MIT
 *
 * sim_run.h - a bus in virtual time: releases handed in, time advanced, events and bits passed on.
 */
#ifndef CANWIRE_CLI_SIM_SIM_RUN_H
#define CANWIRE_CLI_SIM_SIM_RUN_H

#include "cli/sim/sim_progress.h"
#include "config/config.h"
#include "run/release.h"

#define SIM_SINKS_MAX 16

/* Something that looks on. Both functions may be NULL; neither may change the bus. */
typedef struct sim_sink {
    void *user;
    void (*event)(void *user, const cw_event *event); /* each event, in order */
    uint32_t kinds; /* of events it needs, as bits 1u << cw_event_kind; 0: all. It may get others */
    void (*bit)(void *user, const cw_bus *bus); /* at the end of each bit; after its events */
    uint64_t bits_from; /* ticks: only bits that end after this */
    uint64_t bits_to;   /* ... and start before this; 0: no end. Others are not stepped for it */
    bool changes; /* bits need not be shown in which everything is as in the one before */
} sim_sink;

typedef struct sim_run {
    const cfg *config; /* not owned */
    void *memory; /* of the bus; NULL: not owned */
    cw_bus *bus;
    release_plan *plan;
    uint64_t until;         /* tick, or CW_NEVER: to the end of the traffic */
    uint64_t last_activity; /* tick of the last tx or release */
    bool step;              /* every bit is simulated, whether somebody looks at it or not */
    bool stopped;           /* see sim_stop() */
    bool quiet;             /* another run says on standard error what there is to say */
    uint64_t careful_from;  /* see sim_be_careful() */
    bool watching;          /* what the bus was told last */
    unsigned calm_bits;     /* that have been shown since the last event */
    sim_progress progress;  /* started by the caller, if it is wanted */
    unsigned sink_count;
    uint32_t bit_sinks; /* those with a `bit`, as a set */
    sim_sink sinks[SIM_SINKS_MAX];
} sim_run;

/* Makes the bus of a configuration, at time 0; the configuration must live longer. A quiet one says
 * nothing on standard error, of the files that it opens neither. False when memory is short or the
 * bus cannot be made. To be closed in either case. */
bool sim_open(sim_run *s, const cfg *config, bool quiet);

void sim_close(sim_run *s);

/* Adds a sink, at most SIM_SINKS_MAX; a copy is kept. */
void sim_add_sink(sim_run *s, const sim_sink *sink);

/* Runs to the end: `until`, else until all traffic is done and 11 recessive bits have passed, or
 * after 10 s of bus time without a tx or a release, which is said on standard error. False when a
 * file that is replayed cannot be read; the run has ended there. */
bool sim_go(sim_run *s);

/* ---- A run that somebody else drives --------------------------------------------------------- */

/* With a bus that is there and lives longer, and without releases. To be closed in either case. */
bool sim_open_bus(sim_run *s, const cfg *config, cw_bus *bus);

/* Before and after. */
void sim_begin(sim_run *s);
void sim_end(sim_run *s);

/* Advances to a tick, which is the end of a bit. False: the run is over. */
bool sim_advance(sim_run *s, uint64_t tick);

/* Passes on all events of the bus, and then one of another origin, if it is not NULL. */
void sim_pass_on(sim_run *s, const cw_event *event);

/* Goes on with another bus that has taken over. */
void sim_change(sim_run *s, const cfg *config, cw_bus *bus);

/* ---- Stopping -------------------------------------------------------------------------------- */

/* To be called before sim_go() when a sink may stop the run at a tick or later, and all has to end
 * there: from then on the bus never runs ahead of the events, which costs speed. At first it runs
 * ahead of them to the end (CW_NEVER). */
void sim_be_careful(sim_run *s, uint64_t from);

/* For sinks: the run ends with the event that is being passed on, at its tick; the other events of
 * that tick are still passed on. The bus ends with the bit of it where it is careful. */
void sim_stop(sim_run *s, uint64_t tick);

#endif
