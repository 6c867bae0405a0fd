/* SPDX-License-Identifier: MIT
 *
 * main.c - the canwire tool: finds the subcommand and runs it.
 */
#include "base/text/jsonput.h"
#include "base/text/nearest.h"
#include "base/text/plain.h"
#include "base/standardfds.h"
#include "base/version.h"
#include "cli/cli.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

typedef struct command {
    const char *name;
    const char *help;
    int (*run)(int argc, char **argv);
} command;

static const command commands[] = {
    {"check", "validate a configuration file", cli_check},
    {"bits", "show the wire bits of a frame, annotated by field", cli_bits},
    {"timing", "find the segments of a bit, or show those of a configuration", cli_timing},
    {"vcan", "make or remove the interfaces of a configuration", cli_vcan},
    {"sim", "run a configuration in virtual time, without sockets", cli_sim},
    {"campaign", "run a scenario many times, with many values of what varies", cli_campaign},
    {"analyse", "show what a bus can promise: response times and load", cli_analyse},
    {"status", "show a running bus and its nodes", cli_status},
    {"watch", "show what happens on a bus, live", cli_watch},
    {"top", "show buses, nodes and rules on a terminal, live", cli_top},
    {"record", "write what happens on a bus into a file, live", cli_record},
    {"extcap", "list and capture buses for Wireshark, which calls it", cli_extcap},
    {"faults", "list the fault rules on a bus", cli_faults},
    {"inject", "put fault rules onto a bus", cli_inject},
    {"clear", "take fault rules away", cli_clear},
    {"fire", "let a manual fault rule act", cli_fire},
    {"restart", "get a node out of bus-off", cli_restart},
    {"set", "change settings of a node", cli_set},
    {"run", "run a SocketCAN program at a node, without CAN in the kernel", cli_run},
    {"reload", "go over to what the configuration says now", cli_reload},
};

#define NAME_MAX_BYTES 32 /* "canwire " and the name of a command */
#define COMMAND_COUNT (sizeof commands / sizeof commands[0])

static int run_tool(int argc, char **argv);
static int cli_finish(int status);

/* Standard descriptors must be open first: a file would take the number of one that is closed. */
int main(int argc, char **argv)
{
    standardfds_hold();
    json_must_have_memory();
    plain_options(argc, argv);
    return cli_finish(run_tool(argc, argv));
}

/* Returns the exit status; output that could not be written (a full disk) is an error. */
static int cli_finish(int status)
{
    errno = 0;
    if (fflush(stdout) == 0 && !ferror(stdout)) {
        return status;
    }
    fprintf(stderr, "canwire: standard output: %s\n",
            errno != 0 ? strerror(errno) : "it is not complete"); /* an earlier write failed */
    return status == CLI_OK ? CLI_BAD_INPUT : status;
}

static void print_usage(FILE *out)
{
    fputs("usage: canwire COMMAND [ARGUMENT...]\n"
          "       canwire help COMMAND\n"
          "       canwire --version\n"
          "\n"
          "commands:\n",
          out);
    for (size_t i = 0; i < COMMAND_COUNT; i++) {
        fprintf(out, "  %-9s %s\n", commands[i].name, commands[i].help);
    }
    fputs("\n"
          "exit status: 0 success, 1 a value or a file is bad, or the bus refuses, 2 wrong usage,\n"
          "3 an expectation failed (sim, campaign)\n",
          out);
}

static const command *find_command(const char *name)
{
    for (size_t i = 0; i < COMMAND_COUNT; i++) {
        if (strcmp(commands[i].name, name) == 0) {
            return &commands[i];
        }
    }
    return NULL;
}

/* Refuses a word that is not a command, with the nearest one as a guess. */
static int refuse_command(const char *name)
{
    nearest guess = {.word = name};

    for (size_t i = 0; i < COMMAND_COUNT; i++) {
        nearest_consider(&guess, commands[i].name);
    }
    plain_print(stderr, "canwire: unknown command '%s'", name);
    if (guess.best != NULL) {
        plain_print(stderr, ", did you mean '%s'?\n", guess.best);
    } else {
        fputs(", see canwire --help\n", stderr);
    }
    return CLI_USAGE;
}

/* Runs a command; getopt begins its messages with argv[0]. */
static int run_command(const command *c, int argc, char **argv)
{
    static char name[NAME_MAX_BYTES]; /* argv outlives this call */

    (void)snprintf(name, sizeof name, "canwire %s", c->name);
    argv[0] = name;
    return c->run(argc, argv);
}

/* `canwire help COMMAND` is `canwire COMMAND --help`. */
static int help(int argc, char **argv)
{
    if (argc < 2) {
        print_usage(stdout);
        return CLI_OK;
    }
    if (argc > 2) {
        fputs("usage: canwire help [COMMAND]\n", stderr);
        return CLI_USAGE;
    }
    const command *found = find_command(argv[1]);

    if (found == NULL) {
        return refuse_command(argv[1]);
    }
    char option[] = "--help";
    char *arguments[] = {argv[1], option, NULL};

    return run_command(found, 2, arguments);
}

/* Runs a command, or answers help and version. Help that is asked for is a success; no word at all
 * is wrong usage. */
static int run_tool(int argc, char **argv)
{
    if (argc < 2) {
        print_usage(stderr);
        return CLI_USAGE;
    }
    const char *name = argv[1];

    if (strcmp(name, "help") == 0 || strcmp(name, "--help") == 0 || strcmp(name, "-h") == 0) {
        return help(argc - 1, argv + 1);
    }
    if (strcmp(name, "--version") == 0 || strcmp(name, "-V") == 0) {
        puts("canwire " CANWIRE_VERSION);
        return CLI_OK;
    }
    const command *found = find_command(name);

    return found == NULL ? refuse_command(name) : run_command(found, argc - 1, argv + 1);
}
