/* SPDX-License-Identifier: MIT
 *
 * sim_journal.h - a run of `canwire sim` that is driven by the journal of canwired.
 */
#ifndef CANWIRE_CLI_SIM_SIM_JOURNAL_H
#define CANWIRE_CLI_SIM_SIM_JOURNAL_H

#include "cli/sim/sim_judge.h"
#include "cli/sim/sim_trace.h"
#include "run/journal_play.h"
#include "sim/sim_run.h"
#include "sim/sim_until.h"

/* A run and its observers, which must know of other configurations. */
typedef struct sim_journal {
    journal_player *player; /* NULL: there is no journal */
    FILE *errors;           /* for messages */
    sim_run *run;
    sim_judge *judge; /* NULL: no judge, no trace, no output */
    sim_trace *trace;
    outfile *pcapng;
    sim_until *awaited;
} sim_journal;

/* Opens a journal and the run; all members but the player are set. Returns false after a
 * message. */
bool sim_journal_open(sim_journal *j, const char *file);

void sim_journal_close(sim_journal *j);

/* Runs to the end of the journal, or of the run. Returns false after a message, when the journal
 * cannot be understood or this run differs from it. */
bool sim_journal_go(sim_journal *j);

#endif
