/* SPDX-License-Identifier: MIT
 *
 * ecu_command.h - the command line of a program at a node, and its environment.
 */
#ifndef CANWIRE_CAMPAIGN_ECU_ECU_COMMAND_H
#define CANWIRE_CAMPAIGN_ECU_ECU_COMMAND_H

#include "base/arena.h"
#include "campaign/ecu/ecu_keeper.h"

typedef struct ecu_command {
    char **words;
    const char **env;
    const char *cwd; /* absolute */
} ecu_command;

/* Makes them, in memory of the arena. Returns false without memory. */
bool ecu_command_make(ecu_command *out, const ecu_task *task, size_t program, arena *memory);

#endif
