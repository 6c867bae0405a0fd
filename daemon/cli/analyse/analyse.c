/* SPDX-License-Identifier: MIT
 *
 * analyse.c - canwire analyse: what a bus can promise, and what a simulation of it shows.
 */
#include "base/options.h"
#include "base/text/jsonput.h"
#include "base/text/plain.h"
#include "cli/analyse/failure.h"
#include "cli/analyse/report.h"
#include "cli/cli.h"
#include "config/files.h"
#include "config/rig.h"
#include "run/bus_make.h"
#include "sim/sim_run.h"

#include <getopt.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define INTEGRATED_BITS 22u /* after these all nodes have seen 11 recessive bits (M10) */

static const char usage[] =
    "usage: canwire analyse FILE [--simulate TIME] [--error-every TIME] [--error-rate RATE]\n"
    "                       [--json]\n"
    "\n"
    "Shows the worst-case response time of each message that nodes of FILE send (traffic with\n"
    "`send`): from the begin of its period to the end of its frame and intermission. It counts\n"
    "its `jitter`, the longest frame of lower priority that has just begun, and all that come\n"
    "before it, with the most stuff bits. Offsets do not count: any may come together. The\n"
    "analysis is exact for nodes that send by priority, also with mailboxes where each message\n"
    "always finds a free one (`model: full`). For `order: fifo`, `model: basic` and other\n"
    "mailboxes it is an upper bound (~): each frame waits for all others of its node. The slowest\n"
    "clock and overload frames of full buffers make frames longer. Fault rules of FILE do not\n"
    "count. FILE is one bus, no rig.\n"
    "\n"
    "Each trigger of a schedule is a message of its node, too: its period is the basic cycle\n"
    "times its `repeat`. Its frame is tried once, and what is shown is the longest time from the\n"
    "trigger to the end of a frame that is sent. A slot that finds the bus busy is not part of\n"
    "that. With several time masters the cycles of each of them count.\n"
    "\n"
    "Frames of ports, replays and replies are not known, nor are triggers whose reference message\n"
    "is not that of a schedule, and neither is the time that sleeping nodes need to wake up. The\n"
    "result says so (JSON: `complete`).\n"
    "\n"
    "Also shown is the load of the bus and of each node: for frames as they are, for random data,\n"
    "and with the most stuff bits. Identifiers that need stuff bits are named, since there two\n"
    "wrong bits may escape the CRC; 1490 of the 2048 base identifiers need none.\n"
    "\n"
    "  --simulate TIME\n"
    "                 simulate the bus for so long (60s), without faults, and show the longest\n"
    "                 time that each message needed. It must stay below the response time, and\n"
    "                 no frame may be lost. Frames of arbitrating windows may be given up.\n"
    "                 Traffic begins 22 bits later than FILE says, when nodes have integrated:\n"
    "                 that is not part of a response time\n"
    "  --error-every TIME\n"
    "                 in each such time an error destroys a frame (10ms)\n"
    "  --error-rate RATE\n"
    "                 errors come at random, so many in a bit (1e-5) or in a second (10/s).\n"
    "                 Show how many a message survives in its period, the probability of more,\n"
    "                 frames that are destroyed, and errors that nobody finds. Without\n"
    "                 --error-every response times are those of errors at the mean distance\n"
    "  --json         as JSON, times in ns\n"
    "  -h, --help     this text\n"
    "\n"
    "Exit status: 0, 1 FILE or a value is bad, 2 wrong usage, 3 a message may come later than its\n"
    "period ends, or came later than its response time, or not at all.\n";

typedef struct wishes {
    const char *file;
    cfg_time simulate;    /* 0: no simulation */
    cfg_time error_every; /* 0: no errors */
    double per_bit;       /* errors at random; 0: none */
    double per_second;
    bool json;
} wishes;

/* A time of 0 is refused: it would mean no simulation, or errors without end. */
static bool analyse_take_time(void *out, const char *option, const char *text)
{
    cfg_time *time = out;
    const char *wrong = text_parse_time(time, text);
    if (!wrong && time->ns == 0 && time->bits == 0)
        wrong = "the time must be more than 0";
    if (wrong)
        plain_print(stderr, "canwire analyse: %s %s: %s\n", option, text, wrong);
    return !wrong;
}

/* Reads a part of the bits, or a number a second. */
static bool take_rate(void *out, const char *option, const char *text)
{
    wishes *w = out;
    uint64_t fraction = 0;
    const size_t length = strlen(text);
    const bool per_second = length > 2 && strcmp(text + length - 2, "/s") == 0;
    const size_t digits = strspn(text, "0123456789.");
    w->per_bit = w->per_second = 0;
    if (per_second && digits == length - 2)
        w->per_second = strtod(text, NULL);
    else if (!per_second && !text_parse_probability(&fraction, text))
        w->per_bit = ldexp((double)fraction, -64);
    const bool good = w->per_bit > 0 ? w->per_bit < 1 : w->per_second > 0;
    if (!good)
        plain_print(stderr, "canwire analyse: %s %s: expected a part of all bits, more than 0 and "
                            "less than 1, such as 1e-5, or a number a second, such as 10/s\n",
                    option, text);
    return good;
}

/* ---- Simulation ------------------------------------------------------------------------------ */

static void note_given_up(sources *s, source *one, const cw_event *event)
{
    const bool integrated = event->tick > cw_rate_ticks(s->config->rate, INTEGRATED_BITS);
    one->given_up += one->trigger && integrated;
}

/* Takes the time of a frame that has been sent, and notes one that its slot has not sent. */
static void note_end(void *user, const cw_event *event)
{
    sources *s = user;
    const uint32_t key = response_key(&event->frame);
    if (event->kind != CW_EVENT_TX && event->kind != CW_EVENT_DROP)
        return;
    for (size_t i = 0; i < s->count; i++) {
        source *one = &s->list[i];
        if (s->messages[i].key != key || !(event->nodes >> s->messages[i].node & 1u) ||
            event->trigger != one->trigger)
            continue;
        if (event->kind == CW_EVENT_DROP) {
            note_given_up(s, one, event);
            continue;
        }
        const uint64_t seen = event->tick - event->handed_in;
        one->seen = seen > one->seen ? seen : one->seen;
        one->seen_count++;
    }
}

/* Makes all traffic begin when nodes have integrated. Frames that wait for that would come closer
 * together than their periods say. */
static void begin_later(cfg *config)
{
    for (size_t i = 0; i < config->node_count; i++)
        for (size_t t = 0; t < config->nodes[i].traffic_count; t++)
            config->nodes[i].traffic[t].offset.bits += INTEGRATED_BITS;
}

/* Runs the traffic on the bus without faults, and keeps the worst response that each message has.
 * It begins when all nodes have integrated. */
static bool simulate(sources *s, cfg *config, uint64_t until)
{
    sim_run run;
    const sim_sink sink = {.user = s, .event = note_end,
                           .kinds = 1u << CW_EVENT_TX | 1u << CW_EVENT_DROP};
    config->rule_count = 0;
    begin_later(config);
    bool good = sim_open(&run, config, NULL);
    if (good) {
        run.until = until + cw_rate_ticks(config->rate, INTEGRATED_BITS);
        sim_add_sink(&run, &sink);
        good = sim_go(&run);
    } else {
        plain_print(stderr, "canwire analyse: %s\n", bus_why_not());
    }
    sim_close(&run);
    return good;
}

/* ---- Analysis -------------------------------------------------------------------------------- */

static void analyse_show(const wishes *w, const analysis *a)
{
    if (w->json) {
        json_t *object = report_json(a);
        put_out(stdout, object);
        json_decref(object);
    } else {
        report_print(stdout, a);
    }
}

static uint64_t ticks_or(cfg_time time, cw_rate rate, uint64_t none)
{
    return time.ns || time.bits ? text_time_ticks(time, rate) : none;
}

/* Returns the errors in a bit, at random. */
static double error_rate(const wishes *w, const cfg *config)
{
    const double second = (double)CW_CLOCK_HZ / (double)cw_rate_ticks(config->rate, 1);
    const double rate = w->per_bit > 0 ? w->per_bit : w->per_second / second;
    return rate < 1 ? rate : 1 - 1e-9;
}

/* Returns the time in which there is one error. */
static uint64_t error_every(const wishes *w, const analysis *a, cw_rate rate)
{
    const uint64_t given = ticks_or(w->error_every, rate, CW_NEVER);
    const double mean = a->error_rate > 0 ? (double)cw_rate_ticks(rate, 1) / a->error_rate : 0;
    return given != CW_NEVER || !(mean >= 1 && mean < 1e18) ? given : (uint64_t)(mean + 0.5);
}

/* Finds all that is to be found of a bus. Returns false without memory. */
static bool find_all(const analysis *a, sources *s, int *survived, cfg *config)
{
    response_bus bus = {.bit = cw_rate_ticks(config->rate, 1), .error_every = a->error_every,
                        .messages = s->messages, .count = s->count};
    if (a->error_rate > 0)
        failure_find(&bus, survived);
    response_find(&bus);
    return !a->simulated || simulate(s, config, a->simulated);
}

/* Finds the response times and shows them. A message that can be late is a failed expectation. */
static int analyse(const wishes *w, cfg *config)
{
    sources s;
    int status = CLI_BAD_INPUT;
    analysis a = {.sources = &s, .error_rate = error_rate(w, config),
                  .simulated = ticks_or(w->simulate, config->rate, 0)};
    a.error_every = error_every(w, &a, config->rate);
    const bool found = sources_find(&s, config);
    int *survived = calloc(s.count + 1, sizeof *survived);
    a.survived = survived;
    if (!found || !survived) {
        plain_print(stderr, "canwire analyse: out of memory\n");
    } else if (find_all(&a, &s, survived, config)) {
        analyse_show(w, &a);
        status = report_is_bad(&a) ? CLI_EXPECTATION : CLI_OK;
    }
    free(survived);
    sources_free(&s);
    return status;
}

/* A rig is refused: the delays of its gateways are not a part of the analysis. */
static int analyse_file(const wishes *w)
{
    if (rig_is_rig(w->file)) {
        plain_print(stderr, "canwire analyse: %s is a rig: analyse its buses one by one\n",
                    w->file);
        return CLI_BAD_INPUT;
    }
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
    const option_row rows[] = {
        {"simulate", .read = analyse_take_time, .out = &w.simulate},
        {"error-every", .read = analyse_take_time, .out = &w.error_every},
        {"error-rate", .read = take_rate, .out = &w},
        {"json", .flag = &w.json},
        {.name = NULL},
    };
    const option_table table = {.usage = usage, .help = "", .rows = rows};
    const int status = options_read(&table, argc, argv);
    if (status >= 0)
        return status;
    if (optind != argc - 1)
        return options_refuse(&table);
    w.file = argv[optind];
    return analyse_file(&w);
}
