/* SPDX-License-Identifier: MIT
 *
 * sim_progress.h - shows the progress of a long run in one line on a terminal.
 *
 * The line changes a few times a second of wall time, after the first second. It is wiped at the
 * end and before other messages. A narrow terminal gets less of it, or nothing when the bus time
 * alone does not fit. Other outputs get no line.
 */
#ifndef CANWIRE_CLI_SIM_SIM_PROGRESS_H
#define CANWIRE_CLI_SIM_SIM_PROGRESS_H

#include "sim/sim_run.h"

#include <signal.h>

typedef struct sim_progress {
    bool on;
    int64_t start_ns; /* wall time */
    int64_t next_ns;
    uint64_t looked; /* tick at the last reading of the clock */
    unsigned width;  /* characters on the terminal now */
    struct sigaction before; /* the handler was set; the earlier action of SIGINT */
    const char *awaited; /* NULL: nothing; not owned */
} sim_progress;

/* Begins to count, and lets the run show it. It is on when standard error is a terminal and nothing
 * else writes to one. The line shows the awaited event, if that is not NULL. */
void sim_progress_start(sim_progress *p, sim_run *run, bool wanted, const char *awaited);

#endif
