/* SPDX-License-Identifier: MIT
 *
 * analyse.c - canwire analyse: what a bus can promise, and what a simulation of it shows.
 */
#include "cli/cli.h"

#include "base/plain.h"
#include "cli/analyse/report.h"
#include "cli/sim/sim_run.h"
#include "config/files.h"

#include <getopt.h>
#include <string.h>

static const char usage[] =
    "usage: canwire analyse FILE [--simulate TIME] [--error-every TIME] [--json]\n"
    "\n"
    "Shows the worst-case response time of each message that nodes of FILE send (traffic with\n"
    "`send`): from the begin of its period to the end of its frame and intermission. It counts\n"
    "its jitter, the longest frame of lower priority that has just begun, and all that come\n"
    "before it, with the most stuff bits. The analysis is exact for nodes that send by priority.\n"
    "For `order: fifo` and `model: basic` it is an upper bound: each frame waits for all others\n"
    "of its node. Also shown is the load of the bus and of each node, for frames as they are and\n"
    "with the most stuff bits. Fault rules of FILE do not count.\n"
    "\n"
    "  --simulate TIME\n"
    "                 simulate the bus for so long (60s), without faults, and show the longest\n"
    "                 time that each message needed. It must stay below the response time\n"
    "  --error-every TIME\n"
    "                 in each such time an error destroys a frame (10ms)\n"
    "  --json         as JSON, times in ns\n"
    "  -h, --help     this text\n"
    "\n"
    "Exit status: 0, 1 FILE or a value is bad, 2 wrong usage, 3 a message may come later than its\n"
    "period ends, or came later than its response time.\n";

static const struct option options[] = {
    {"help", no_argument, NULL, 'h'},       {"simulate", required_argument, NULL, 's'},
    {"error-every", required_argument, NULL, 'e'}, {"json", no_argument, NULL, 'j'},
    {NULL, 0, NULL, 0},
};

typedef struct wishes {
    const char *file;
    cfg_time simulate;    /* 0: no simulation */
    cfg_time error_every; /* 0: no errors */
    bool json;
} wishes;

static bool take_time(cfg_time *out, const char *option, const char *text)
{
    const char *wrong = text_parse_time(out, text);
    if (!wrong && out->ns == 0 && out->bits == 0)
        wrong = "the time must be more than 0";
    if (wrong)
        plain_print(stderr, "canwire analyse: %s %s: %s\n", option, text, wrong);
    return !wrong;
}

/* ---- Simulation ------------------------------------------------------------------------------ */

/* Takes the time of a frame that has been sent. */
static void note_sent(void *user, const cw_event *event)
{
    sources *s = user;
    const uint32_t key = response_key(&event->frame);
    if (event->kind != CW_EVENT_TX)
        return;
    for (size_t i = 0; i < s->count; i++) {
        source *one = &s->list[i];
        const uint64_t seen = event->tick - event->handed_in;
        if (s->messages[i].key != key || !(event->nodes >> s->messages[i].node & 1u))
            continue;
        one->seen = seen > one->seen ? seen : one->seen;
        one->seen_count++;
    }
}

static bool simulate(sources *s, cfg *config, uint64_t until)
{
    sim_run run;
    const sim_sink sink = {.user = s, .event = note_sent, .kinds = 1u << CW_EVENT_TX};
    config->rule_count = 0;
    bool good = sim_open(&run, config, true);
    if (good) {
        run.until = until;
        sim_add_sink(&run, &sink);
        good = sim_go(&run);
    } else {
        plain_print(stderr, "canwire analyse: out of memory\n");
    }
    sim_close(&run);
    return good;
}

/* ---- Analysis -------------------------------------------------------------------------------- */

static void show(const wishes *w, const analysis *a)
{
    if (w->json) {
        json_t *object = report_json(a);
        (void)json_dumpf(object, stdout, JSON_INDENT(2));
        putchar('\n');
        json_decref(object);
    } else {
        report_print(stdout, a);
    }
}

static uint64_t ticks_or(cfg_time time, cw_rate rate, uint64_t none)
{
    return time.ns || time.bits ? text_time_ticks(time, rate) : none;
}

static int analyse(const wishes *w, cfg *config)
{
    sources s;
    int status = CLI_BAD_INPUT;
    analysis a = {.sources = &s, .error_every = ticks_or(w->error_every, config->rate, CW_NEVER),
                  .simulated = ticks_or(w->simulate, config->rate, 0)};
    if (sources_find(&s, config)) {
        response_bus bus = {.bit = cw_rate_ticks(config->rate, 1), .error_every = a.error_every,
                            .messages = s.messages, .count = s.count};
        response_find(&bus);
        if (!a.simulated || simulate(&s, config, a.simulated)) {
            show(w, &a);
            status = report_is_bad(&a) ? CLI_EXPECTATION : CLI_OK;
        }
    } else {
        plain_print(stderr, "canwire analyse: out of memory\n");
    }
    sources_free(&s);
    return status;
}

static int analyse_file(const wishes *w)
{
    cfg *config = cfg_load(w->file, stderr);
    if (!config)
        return CLI_BAD_INPUT;
    fputs(config->warnings, stderr);
    const int status = analyse(w, config);
    cfg_free(config);
    return status;
}

int cli_analyse(int argc, char **argv)
{
    wishes w = {.json = false};
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
        if (option == 's' && !take_time(&w.simulate, "--simulate", optarg))
            return CLI_BAD_INPUT;
        if (option == 'e' && !take_time(&w.error_every, "--error-every", optarg))
            return CLI_BAD_INPUT;
        w.json = w.json || option == 'j';
    }
    if (optind != argc - 1) {
        fputs(usage, stderr);
        return CLI_USAGE;
    }
    w.file = argv[optind];
    return analyse_file(&w);
}
