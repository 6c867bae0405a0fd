/* SPDX-License-Identifier: MIT
 *
 * sim_progress.h - one line on a terminal that tells how far a long run has come.
 *
 * Some times a second of wall time, from the second second on; wiped at the end and before other
 * messages. On a narrow terminal it tells less, and nothing where the bus time alone does not fit.
 * What goes elsewhere than to a terminal gets nothing of it.
 */
#ifndef CANWIRE_CLI_SIM_SIM_PROGRESS_H
#define CANWIRE_CLI_SIM_SIM_PROGRESS_H

#include "canwire.h"

#include <signal.h>

typedef struct sim_progress {
    bool on;
    int64_t start_ns; /* wall time */
    int64_t next_ns;
    uint64_t looked; /* tick at which the clock was last looked at */
    unsigned width;  /* characters that are on the terminal now */
    struct sigaction before; /* they came; what SIGINT did */
    const char *awaited; /* NULL: nothing; not owned */
} sim_progress;

/* Begins to count. It is on when standard error is a terminal and nothing else writes to one. The
 * line tells what the run waits for, if that is not NULL. */
void sim_progress_start(sim_progress *p, bool wanted, const char *awaited);

/* Whether a new line is due. Cheap; to be asked often. */
bool sim_progress_is_due(sim_progress *p, uint64_t now);

/* Writes the line; the end of the run is expected at that tick, CW_NEVER: unknown. */
void sim_progress_write(sim_progress *p, const cw_bus *bus, uint64_t end);

/* Takes the line away, if there is one. */
void sim_progress_wipe(sim_progress *p);

#endif
