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

#include "canwire.h"

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

/* Begins to count. It is on when standard error is a terminal and nothing else writes to one. The
 * line shows the awaited event, if that is not NULL. */
void sim_progress_start(sim_progress *p, bool wanted, const char *awaited);

/* Returns true when a new line is due. It is cheap, for frequent calls. */
bool sim_progress_is_due(sim_progress *p, uint64_t now);

/* Writes the line; `end` is the expected end of the run, CW_NEVER: unknown. */
void sim_progress_write(sim_progress *p, const cw_bus *bus, uint64_t end);

/* Wipes the line, if there is one. */
void sim_progress_wipe(sim_progress *p);

#endif
