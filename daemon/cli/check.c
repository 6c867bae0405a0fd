/* SPDX-License-Identifier: MIT
 *
 * check.c - canwire check: validates a configuration or a fault profile, or lists its ports.
 */
#include "base/text/counted.h"
#include "cli/cli.h"

#include "base/text/plain.h"
#include "cli/check_doubts.h"
#include "config/files.h"
#include "config/node/portname.h"
#include "config/profilefile.h"
#include "config/rig.h"
#include "run/journal_check.h"
#include "run/replay.h"

#include <getopt.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

static const char usage[] =
    "usage: canwire check [--ports] FILE | --journal FILE\n"
    "\n"
    "Validates a configuration, a rig or a fault profile, and reads the recordings that it\n"
    "replays to their end. Errors go to stderr, one a line, as FILE:LINE:COLUMN: message, and\n"
    "so do warnings: what is valid and still will not do what it says. An installed profile, or\n"
    "one in `profiles`, may be named.\n"
    "Exit status: 0 good, 1 bad, 2 wrong usage.\n"
    "\n"
    "  --ports     only print the interfaces that the nodes use, one a line\n"
    "  --journal   FILE is a journal of canwired: whether it is whole, and where it is not\n";

static const struct option options[] = {
    {"help", no_argument, NULL, 'h'},
    {"ports", no_argument, NULL, 'p'},
    {"journal", no_argument, NULL, 'j'},
    {NULL, 0, NULL, 0},
};

static int check_named(const char *file, bool ports);
static int check_file(const char *file, bool ports);
static int check_rig(const char *file, bool ports);

int cli_check(int argc, char **argv)
{
    bool ports = false;
    bool journal = false;
    int option;

    optind = 0; /* starts anew after earlier calls of getopt */
    while ((option = getopt_long(argc, argv, "h", options, NULL)) != -1) {
        if (option == 'h') {
            fputs(usage, stdout);
            return CLI_OK;
        }
        if (option == '?') {
            fputs(usage, stderr);
            return CLI_USAGE;
        }
        ports = ports || option == 'p';
        journal = journal || option == 'j';
    }
    if (optind != argc - 1 || (ports && journal)) {
        fputs(usage, stderr);
        return CLI_USAGE;
    }
    if (journal)
        return journal_check(argv[optind], stdout, stderr) ? CLI_OK : CLI_BAD_INPUT;
    return check_named(argv[optind], ports);
}

/* A profile may be named. Other files are there, or their readers say that they are not. */
static int check_named(const char *file, bool ports)
{
    char path[PATH_MAX], folders[PROFILEFILE_LIST_BYTES];
    const profilefile wanted = {.name = file, .beside = {""}};
    if (profilefile_find(path, &wanted))
        return rig_is_rig(path) ? check_rig(path, ports) : check_file(path, ports);
    if (profilefile_is_name(file) && profilefile_is_there(file, true)) {
        plain_print(stderr, "canwire check: %s: not a regular file; a pipe needs a path: ./%s\n",
                    file, file);
        return CLI_BAD_INPUT;
    }
    if (!profilefile_is_name(file) || strchr(file, '.'))
        return check_file(file, ports);
    profilefile_list(folders, &wanted);
    plain_print(stderr, "canwire check: there is no %s in %s\n", file, folders);
    return CLI_BAD_INPUT;
}

static void print_ports(const cfg *config)
{
    for (size_t i = 0; i < config->node_count; i++)
        if (portname_is_interface(config->nodes[i].port))
            puts(config->nodes[i].port);
}

static void print_summary(const cfg *config)
{
    printf("%s: ok (bus %s, %" PRIu32 " bit/s, ", config->file, config->bus_name,
           config->bitrate_bps);
    if (config->dbitrate_bps > 0)
        printf("data %" PRIu32 " bit/s, ", config->dbitrate_bps);
    printf("%s, %s, %s", cfg_has_fd(config) ? "CAN FD" : "classical CAN",
           counted(config->node_count, "node").text, counted(config->rule_count, "rule").text);
    if (config->expect_count > 0)
        printf(", %s for canwire sim", counted(config->expect_count, "expectation").text);
    puts(")");
}

/* Reads the file of a replay to its end, and reports the result. */
static bool check_replay(const cfg_node *node, const cfg_traffic *traffic)
{
    char note[REPLAY_NOTE_MAX];
    uint64_t frames;
    bool good = replay_check(traffic, &frames, note);
    if (!good) {
        plain_print(stderr, "%s\n", note);
        return false;
    }
    printf("%s: %s: %s to replay\n", node->name, traffic->file,
           counted(frames, "frame").text);
    if (note[0] != '\0')
        printf("%s: %s\n", node->name, note);
    return true;
}

static bool check_replays(const cfg *config)
{
    bool good = true;
    for (size_t i = 0; i < config->node_count; i++)
        for (size_t t = 0; t < config->nodes[i].traffic_count; t++)
            if (config->nodes[i].traffic[t].kind == CFG_TRAFFIC_REPLAY)
                good = check_replay(&config->nodes[i], &config->nodes[i].traffic[t]) && good;
    return good;
}

static void print_profile(const char *file, size_t rules)
{
    printf("%s: ok (fault profile, %s)\n", file, counted(rules, "rule").text);
}

/* Checks the files of a bus, and reports. */
static bool check_bus(const cfg *config, const rig *all, size_t bus, bool ports)
{
    bool good = cfg_check_files(config, NULL, "canwire check", stderr);
    if (!ports)
        fputs(config->warnings, stderr);
    if (ports)
        print_ports(config);
    else if (good)
        good = check_replays(config);
    if (!ports && good) {
        check_doubts(config, all, bus, stderr);
        print_summary(config);
    }
    return good;
}

static int check_rig(const char *file, bool ports)
{
    rig *found = rig_load(file, stderr);
    size_t rules = 0;
    bool good = true;
    if (!found)
        return CLI_BAD_INPUT;
    for (size_t i = 0; i < found->bus_count; i++)
        good = check_bus(found->buses[i], found, i, ports) && good;
    for (size_t i = 0; i < found->gateway_count; i++)
        rules += found->gateways[i].rule_count;
    if (good && !ports)
        printf("%s: ok (rig, %s, %s, %s)\n", file, counted(found->bus_count, "bus").text,
               counted(found->gateway_count, "gateway").text, counted(rules, "rule").text);
    rig_free(found);
    return good ? CLI_OK : CLI_BAD_INPUT;
}

static int check_file(const char *file, bool ports)
{
    cfg *config;
    size_t rules;
    bool good = true;

    if (!cfg_check(&config, &rules, file, stderr))
        return CLI_BAD_INPUT;
    if (config)
        good = check_bus(config, NULL, 0, ports);
    else if (!ports)
        print_profile(file, rules);
    cfg_free(config);
    return good ? CLI_OK : CLI_BAD_INPUT;
}
