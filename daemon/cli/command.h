/* SPDX-License-Identifier: MIT
 *
 * command.h - the command line of the subcommands that talk to a bus.
 */
#ifndef CANWIRE_CLI_COMMAND_H
#define CANWIRE_CLI_COMMAND_H

#include "base/options.h"
#include "cli/cli.h"

#include <stdbool.h>

#define COMMAND_FLAGS_MAX 7

typedef struct command {
    const char *usage;  /* "canwire NAME ARGUMENTS" */
    const char *help;   /* its purpose, and its options */
    int words_min;      /* arguments that are not options */
    int words_max;      /* -1: any number */
    bool options_first; /* the options end at the first word, whatever follows */
    bool is_program;    /* the words are a program and its arguments, and no bus */
    option_row options[COMMAND_FLAGS_MAX + 1];
} command;

/* Reads a command line. Returns -1 to go on with argv[*first] to argv[argc - 1], otherwise the exit
 * status. */
int command_parse(const command *c, int *first, int argc, char **argv);

#endif
