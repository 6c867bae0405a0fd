/* SPDX-License-Identifier: MIT
 *
 * scenario.h - a configuration that is run many times in one process, in the same memory.
 */
#ifndef CANWIRE_CAMPAIGN_SCENARIO_H
#define CANWIRE_CAMPAIGN_SCENARIO_H

#include "base/text/memo.h"
#include "campaign/observe.h"
#include "config/rig.h"
#include "run/journal_play.h"
#include "sim/expect.h"
#include "sim/losses.h"
#include "sim/sim_group.h"

/* A bus of the scenario. */
typedef struct scenario_bus {
    struct scenario *all;
    size_t index;
    const cfg *config; /* of the scenario, its rig or its journal */
    uint64_t seed; /* of the file */
    sim_run run;
    observation seen;
    losses lost; /* of a journal none */
    expect *judge; /* NULL: there are no expectations */
} scenario_bus;

typedef struct scenario {
    cfg *alone; /* NULL: there is a rig, or a journal */
    rig *rig;
    journal_player *player; /* NULL: it is not a journal */
    sim_group group;
    size_t count; /* of buses */
    scenario_bus buses[RIG_BUSES_MAX];
    uint64_t until; /* tick up to which events are wanted; CW_NEVER: to the end of the traffic */
    bool failed;    /* a file could not be read, or memory was short */
    expect_report report; /* of the last run */
    memo told;            /* messages of the last run */
} scenario;

/* Reads a file, or a text with the name of one, and makes its buses. Warnings and errors go to
 * `messages`, NULL: nowhere. Returns NULL after errors. */
scenario *scenario_open(const cfg_file *file, FILE *messages);

/* Reads the text of a rig of which the buses are texts, too, by the names that the rig writes. */
scenario *scenario_open_rig(const cfg_file *file, const cfg_file *buses, size_t count,
                            FILE *messages);

/* Frees it; NULL is allowed. */
void scenario_close(scenario *s);

/* Sets the time up to which it runs. Returns what is wrong with it, or NULL. */
const char *scenario_set_until(scenario *s, cfg_time until);

/* Returns false when the scenario has no end. The message begins with a place in the file and ends
 * with `advice`; messages may be NULL. */
bool scenario_ends(const scenario *s, const char *advice, FILE *messages);

/* Runs it from time 0 on, with its own seeds or with another one for all buses. Returns false when
 * a file cannot be read, or without memory. */
bool scenario_run(scenario *s, const uint64_t *seed);

/* Returns the lines that the last run has said about files that it replays. They begin with
 * SIM_NOTE, errors do not. They are valid until the next run. */
const char *scenario_notes(const scenario *s);

/* Returns why the last run has failed, for its owner to free; NULL: without memory. */
char *scenario_why(scenario *s);

/* Returns the time at which the last run has ended. */
uint64_t scenario_now(const scenario *s);

/* Repeats the run of a journal of one bus, up to a time on it in nanoseconds, UINT64_MAX: to its
 * end. Messages go to `messages`, one a line. Returns NULL after a message when the journal cannot
 * be understood, or without memory. The result is for outcome_write(), not for another run. */
scenario *scenario_replay(const char *file, uint64_t until_ns, FILE *messages);

#endif
