/* SPDX-License-Identifier: MIT
 *
 * sim_judge.h - judges a run of `canwire sim` by its expectations, and reports.
 */
#ifndef CANWIRE_CLI_SIM_SIM_JUDGE_H
#define CANWIRE_CLI_SIM_SIM_JUDGE_H

#include "cli/outfile.h"
#include "sim/expect.h"
#include "sim/sim_run.h"

/* All zeros judges nothing. */
typedef struct sim_judge {
    outfile *junit;    /* output for JUnit XML, if it is open; not owned */
    bool to_stderr;    /* the report as text goes there, not to standard output */
    expect *judge;     /* NULL: there are no expectations */
    bool no_memory;
    expect_report report;
} sim_judge;

/* Begins to observe. changes: the run may change to other configurations. Returns false, with a
 * message, without memory. */
bool sim_judge_start(sim_judge *j, sim_run *run, bool changes);

/* Handle a change of the configuration: the run leaves the one by which it has been judged so far,
 * and has another one. */
void sim_judge_leave(sim_judge *j, const sim_run *run);
void sim_judge_enter(sim_judge *j, const sim_run *run);

/* Reports. Returns false, with a message, without memory. */
bool sim_judge_finish(sim_judge *j, const sim_run *run);

void sim_judge_close(sim_judge *j);

#endif
