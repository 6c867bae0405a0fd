/* SPDX-License-Identifier: MIT
 *
 * check.c - canwire check: validates a configuration or a fault profile, or lists its ports.
 */
#include "base/options.h"
#include "base/text/counted.h"
#include "base/text/plain.h"
#include "cli/cli.h"
#include "config/doubts.h"
#include "config/files.h"
#include "config/node/portname.h"
#include "config/profilefile.h"
#include "config/rig.h"
#include "run/journal_check.h"
#include "run/release.h"
#include "run/replay.h"

#include <getopt.h>
#include <inttypes.h>
#include <stdarg.h>
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

static int check_named(const char *file, bool ports);
static int check_file(const char *file, bool ports);
static int check_rig(const char *file, bool ports);

/* ---- Doubts ---------------------------------------------------------------------------------- */

#define RELEASES_MAX 20000000u /* that are looked at for gaps */
#define GAP_SPARE_MS 10u       /* a frame may end so much after its release */

static void warn(FILE *out, const char *file, cfg_place place, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

/* Prints a warning in the form of compilers, which editors know. */
static void warn(FILE *out, const char *file, cfg_place place, const char *format, ...)
{
    char text[1024];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    plain_print(out, "%s:%d:%d: warning: %s\n", file, place.line, place.column, text);
}

/* Warns of a rule that can never act. */
static void doubt_rule(const cfg *config, size_t i, uint64_t fed, FILE *out)
{
    const cw_rule *rule = &config->rules[i];
    const cfg_rule_place *place = &config->rule_places[i];
    if (doubts_never_armed(config, rule))
        warn(out, place->file, place->place,
             "rule %s is never armed: the rules that come after each other go in a circle",
             rule->name);
    else if (doubts_no_frame(config, rule, fed))
        warn(out, place->file, place->place, "rule %s: no node sends a frame that it waits for",
             rule->name);
}

/* Warns where more frames come at one moment than the queue of a node holds. */
static void doubt_queue(const cfg *config, size_t i, FILE *out)
{
    const cfg_node *node = &config->nodes[i];
    char at[TIME_TEXT_MAX];
    uint64_t tick;
    if (node->traffic_count <= node->queue)
        return;
    const unsigned count = doubts_at_once(config, i, &tick);
    if (count <= node->queue)
        return;
    text_print_span(at, tick);
    warn(out, config->file, node->traffic[0].place,
         "%s: %u frames come at %s and its queue holds %u, so others are dropped: queue: %u or "
         "offsets",
         node->name, count, at, node->queue, count);
}

/* Warns of a node that nobody acknowledges: it would send its first frame for ever. */
static void doubt_acknowledgement(const cfg *config, size_t i, FILE *out)
{
    const cfg_node *node = &config->nodes[i];
    const cfg_place line = {.line = node->line, .column = 1};
    if (doubts_no_acknowledgement(config, i))
        warn(out, config->file, node->traffic_count > 0 ? node->traffic[0].place : line,
             "%s: no other node acknowledges its frames, so it never gets one through: add a node, "
             "or presume-ack: on",
             node->name);
}

/* ---- Gaps ------------------------------------------------------------------------------------ */

static void ignore(void *user, bool failed, const char *text)
{
    (void)user;
    (void)failed;
    (void)text;
}

/* Returns true when the releases alone say when something happens. */
static bool releases_say_all(const cfg *config)
{
    bool all = !cfg_find_unending(config, NULL);
    for (size_t i = 0; i < config->rule_count; i++)
        all = all && config->rules[i].trigger == CW_TRIGGER_FRAME &&
              cw_action_kind_of(config->rules[i].action) != CW_KIND_TRAFFIC;
    for (size_t i = 0; i < config->node_count; i++)
        all = all && config->nodes[i].schedule.cycles == 0;
    return all;
}

/* Finds a time without a release after which a run without --until has ended. */
static bool find_gap(release_plan *plan, uint64_t *begin, uint64_t *end)
{
    const uint64_t most = (uint64_t)RELEASE_QUIET_S * CW_CLOCK_HZ +
                          GAP_SPARE_MS * (CW_CLOCK_HZ / 1000u);
    *begin = 0;
    for (unsigned i = 0; i < RELEASES_MAX && !release_is_fast(plan); i++) {
        *end = release_next_tick(plan);
        if (*end == CW_NEVER)
            return false;
        if (*end - *begin > most)
            return true;
        *begin = *end;
        release_pass(plan);
    }
    return false;
}

/* Warns of a pause in all traffic that `canwire sim` would take for its end. */
static void doubt_gaps(const cfg *config, FILE *out)
{
    char from[TIME_TEXT_MAX];
    char to[TIME_TEXT_MAX];
    uint64_t begin;
    uint64_t end;
    unsigned node;
    release_plan *plan = releases_say_all(config) ? release_plan_new(config, ignore, NULL) : NULL;
    if (plan && find_gap(plan, &begin, &end)) {
        (void)release_first(plan, &node);
        text_print_span(from, begin);
        text_print_span(to, end);
        warn(out, config->file, release_place(plan),
             "%s: no frame comes from %s to %s: canwire sim ends after %u s without one, with "
             "--until TIME it goes on",
             config->nodes[node].name, from, to, RELEASE_QUIET_S);
    }
    release_plan_free(plan);
}

/* Writes a line per warning, FILE:LINE:COLUMN: warning: message. all: the rig of the bus, or NULL
 * for a bus alone. */
static void check_doubts(const cfg *config, const rig *all, size_t bus, FILE *out)
{
    const uint64_t fed = doubts_fed(all, bus);
    for (size_t i = 0; i < config->node_count; i++) {
        doubt_queue(config, i, out);
        doubt_acknowledgement(config, i, out);
    }
    for (size_t i = 0; i < config->rule_count; i++)
        doubt_rule(config, i, fed, out);
    if (!all)
        doubt_gaps(config, out);
}

int cli_check(int argc, char **argv)
{
    bool ports = false;
    bool journal = false;
    const option_row rows[] = {
        {"ports", .flag = &ports}, {"journal", .flag = &journal}, {.name = NULL}};
    const option_table table = {.usage = usage, .help = "", .rows = rows};
    const int status = options_read(&table, argc, argv);

    if (status >= 0)
        return status;
    if (optind != argc - 1 || (ports && journal))
        return options_refuse(&table);
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

/* Prints the line for a good file: enough to see that it is the one that was meant. */
static void print_summary(const cfg *config)
{
    printf("%s: ok (bus %s, %" PRIu32 " bit/s, ", config->file, config->bus_name,
           config->bitrate_bps);
    if (config->dbitrate_bps > 0)
        printf("data %" PRIu32 " bit/s, ", config->dbitrate_bps);
    printf("%s, %s, %s", cfg_has_fd(config) ? "CAN FD" : "classical CAN",
           counted(config->node_count, "node").text, counted(config->rule_count, "rule").text);
    if (config->expect_count > 0)
        printf(", %s", counted(config->expect_count, "expectation").text);
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

/* Reads the replayed files from end to end: a bad line in one would end a run at that moment. */
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

/* Checks each bus of a rig with what its gateways bring there. */
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

/* Checks a configuration or a file of rules. With `ports` it only lists ports, for scripts. */
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
