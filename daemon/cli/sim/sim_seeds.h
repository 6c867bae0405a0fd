/* SPDX-License-Identifier: MIT
 *
 * sim_seeds.h - `canwire sim --seeds`: the same configuration with many seeds.
 */
#ifndef CANWIRE_CLI_SIM_SIM_SEEDS_H
#define CANWIRE_CLI_SIM_SIM_SEEDS_H

#include "base/text/number.h"

#include <stdbool.h>

typedef struct sim_seeds_options {
    const char *file;
    const char *until_text; /* NULL: to the end of the traffic */
    cfg_time until;
    uint64_t first; /* seeds from this one ... */
    uint64_t last;  /* ... to this one */
    unsigned jobs;  /* processes; 0: one a processor */
    bool step;
} sim_seeds_options;

/* Reads A..B, or a single seed. Returns false after a message. */
bool sim_seeds_parse(sim_seeds_options *o, const char *text);

/* Reads a number of processes. Returns false after a message that begins with `command`. */
bool sim_seeds_parse_jobs(unsigned *jobs, const char *command, const char *text);

/* Writes a line of JSON for each seed to standard output. Returns the exit status. */
int sim_seeds_main(const sim_seeds_options *o);

#endif
