/* SPDX-License-Identifier: MIT
 *
 * sim_scout.h - runs a bus a first time, without output, to find the tick of an awaited event.
 *
 * A bus that must not run ahead of its events is many times slower. So two runs at full speed take
 * less time than one careful run.
 */
#ifndef CANWIRE_CLI_SIM_SIM_SCOUT_H
#define CANWIRE_CLI_SIM_SIM_SCOUT_H

#include "sim/sim_run.h"
#include "sim/sim_until.h"

typedef struct sim_scout {
    const char *journal; /* that drives the run; NULL: its configuration does */
    sim_run *run;        /* ready to start */
    bool progress;       /* show the progress */
} sim_scout;

/* Makes the run careful only at the event, if that comes. The run does not change when the search
 * is impossible: the journal is a pipe, or memory is short. */
void sim_scout_go(const sim_scout *s, sim_until *awaited);

#endif
