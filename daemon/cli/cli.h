/* SPDX-License-Identifier: MIT
 *
 * cli.h - the subcommands of the canwire tool, one file each.
 *
 * argv[0] is the subcommand's name. Each prints its own usage for --help and returns the exit
 * status of the tool.
 */
#ifndef CANWIRE_CLI_CLI_H
#define CANWIRE_CLI_CLI_H

enum cli_exit {
    CLI_OK = 0,
    CLI_BAD_INPUT = 1, /* a bad value or file, or a refusal of the bus */
    CLI_USAGE = 2,     /* a command line that does not match the usage line */
    CLI_EXPECTATION = 3, /* sim, campaign: an expectation of the configuration failed */
};

int cli_check(int argc, char **argv);
int cli_bits(int argc, char **argv);
int cli_timing(int argc, char **argv);
int cli_vcan(int argc, char **argv);
int cli_sim(int argc, char **argv);
int cli_campaign(int argc, char **argv);
int cli_analyse(int argc, char **argv);
int cli_top(int argc, char **argv);
int cli_record(int argc, char **argv);
int cli_extcap(int argc, char **argv);
int cli_status(int argc, char **argv);
int cli_faults(int argc, char **argv);
int cli_inject(int argc, char **argv);
int cli_clear(int argc, char **argv);
int cli_fire(int argc, char **argv);
int cli_restart(int argc, char **argv);
int cli_set(int argc, char **argv);
int cli_watch(int argc, char **argv);
int cli_reload(int argc, char **argv);
int cli_run(int argc, char **argv);

#endif
