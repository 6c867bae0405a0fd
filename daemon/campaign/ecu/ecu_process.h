/* SPDX-License-Identifier: MIT
 *
 * ecu_process.h - the programs of a row: starting them, taking their output, and ending them with
 * all that they have started.
 *
 * Their parent must be a subreaper (prctl(2)): what they leave behind becomes its child.
 */
#ifndef CANWIRE_CAMPAIGN_ECU_ECU_PROCESS_H
#define CANWIRE_CAMPAIGN_ECU_ECU_PROCESS_H

#include "campaign/ecus.h"

#include <sys/types.h>

#define ECU_LINE_MAX 4096 /* bytes of a line of output that are looked at */

/* The start of a program. */
typedef struct ecu_start {
    char *const *words;     /* NULL at the end */
    const char *const *env; /* NAME=VALUE, or NAME to take it away; NULL at the end */
    const char *cwd;        /* NULL: as here */
    int output;             /* its standard output and error */
} ecu_start;

/* Starts a program in a process group of its own. It dies with this process, and gets no signal
 * mask. Its standard input is empty. Returns its process id, or -1 with errno. A program that is
 * not found says so in its output, and exits with 127. */
pid_t ecu_process_start(const ecu_start *how);

/* The output of a program, on its way into a file. */
typedef struct ecu_output {
    int in;      /* -1: it has ended, or has not begun */
    int log;
    size_t used; /* bytes of the line */
    uint64_t written;
    char line[ECU_LINE_MAX + 1];
} ecu_output;

/* Takes what there is. Returns true when a line, ended or not, has this text in it, NULL: none. */
bool ecu_output_take(ecu_output *o, const char *text);

void ecu_output_close(ecu_output *o);

/* Kills all children of this process but one, and what becomes its child through that. 0: all. */
void ecu_process_kill_all(pid_t but);

#endif
