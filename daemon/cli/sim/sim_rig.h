/* SPDX-License-Identifier: MIT
 *
 * sim_rig.h - runs the buses of a rig in one virtual time, with the gateways between them.
 */
#ifndef CANWIRE_CLI_SIM_SIM_RIG_H
#define CANWIRE_CLI_SIM_SIM_RIG_H

#include "cli/sim/sim_judge.h"
#include "config/rig.h"
#include "sim/sim_run.h"

/* The options of the command line for a rig. */
typedef struct sim_rig_options {
    const char *file;    /* of the rig, or */
    const char *journal; /* of canwired --journal for one; the other is NULL */
    bool has_until;
    cfg_time until; /* without bits */
    const char *until_event; /* of any bus; NULL: none */
    bool has_seed;
    uint64_t seed;
    const char *events; /* names of outputs, or NULL */
    const char *log;
    const char *pcapng; /* not with a journal */
    const char *stats;
    const char *junit;
    bool step;
    bool sync;     /* --events has synchronisations */
    bool captures; /* ... and captures */
} sim_rig_options;

/* Runs to the end. Returns the exit status. */
int sim_rig_main(const sim_rig_options *options);

#endif
