/* SPDX-License-Identifier: MIT
 *
 * sim_scout.h - runs a bus a first time, with no output, to find where an awaited event comes.
 *
 * A bus that must not run ahead of its events costs many times as much as one that may, so that
 * twice at full speed is far less than once with care.
 */
#ifndef CANWIRE_CLI_SIM_SIM_SCOUT_H
#define CANWIRE_CLI_SIM_SIM_SCOUT_H

#include "cli/sim/sim_run.h"
#include "cli/sim/sim_until.h"

typedef struct sim_scout {
    const char *journal; /* that drives the run; NULL: its configuration does */
    sim_run *run;        /* ready to go */
    bool progress;       /* is wanted */
} sim_scout;

/* Makes the run careful only where the event comes, if it comes. Where that cannot be found out,
 * because the journal is a pipe or memory is short, all stays as it is. */
void sim_scout_go(const sim_scout *s, sim_until *awaited);

#endif
