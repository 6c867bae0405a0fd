/* SPDX-License-Identifier: MIT
 *
 * sim_judge.h - judges a run of `canwire sim` by what its configuration expects, and reports.
 */
#ifndef CANWIRE_CLI_SIM_SIM_JUDGE_H
#define CANWIRE_CLI_SIM_SIM_JUDGE_H

#include "cli/outfile.h"
#include "cli/sim/expect.h"
#include "cli/sim/sim_run.h"

/* All zeros judges nothing. */
typedef struct sim_judge {
    outfile *junit;    /* JUnit XML goes there, if it is open; not owned */
    bool to_stderr;    /* the report as text does, not to standard output */
    expect *judge;     /* NULL: nothing is expected */
    bool no_memory;
    expect_report report;
} sim_judge;

/* Begins to look on. changes: the run may go over to other configurations. False, with a message,
 * when there is no memory. */
bool sim_judge_start(sim_judge *j, sim_run *run, bool changes);

/* The run leaves its configuration, by which it has been judged so far; has another one. */
void sim_judge_leave(sim_judge *j, const sim_run *run);
void sim_judge_enter(sim_judge *j, const sim_run *run);

/* Reports. False, with a message, when there is no memory. */
bool sim_judge_finish(sim_judge *j, const sim_run *run);

void sim_judge_close(sim_judge *j);

#endif
