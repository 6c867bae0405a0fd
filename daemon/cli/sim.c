/* SPDX-License-Identifier: MIT
 *
 * sim.c - `canwire sim`: the bus of a configuration in virtual time, without sockets.
 */
#include "cli.h"

#include "config.h"
#include "output.h"
#include "release.h"
#include "summary.h"

#include <errno.h>
#include <getopt.h>
#include <stdlib.h>
#include <string.h>

#define INBOX_FRAMES 1024
#define EVENT_RING 4096
#define QUIET_LIMIT_S 10u     /* of bus time without a tx or a release */
#define END_RECESSIVE_BITS 11 /* after the last frame */

typedef struct sim_options {
    const char *file;
    const char *until;
    const char *seed;
    const char *events;
    const char *log;
    const char *stats;
} sim_options;

typedef struct sim {
    cfg *config;
    void *memory;
    cw_bus *bus;
    release_plan *plan;
    FILE *events; /* NULL: not wanted */
    FILE *log;
    FILE *stats;
    uint64_t until;         /* tick, or CW_NEVER */
    uint64_t last_activity; /* tick of the last tx or release */
} sim;

static const char usage[] =
    "usage: canwire sim FILE [--until TIME] [--seed N] [--events F] [--log F] [--stats F]\n";

static const char help[] =
    "\n"
    "Runs the bus that FILE describes in virtual time: same engine, no sockets, no LCM. Nodes with\n"
    "a port are there but send nothing.\n"
    "\n"
    "  --until TIME   end at this bus time (10ms, 2s, 100bit); else when all traffic is done\n"
    "  --seed N       instead of the seed in FILE\n"
    "  --events F     every event as a line of JSON\n"
    "  --log F        every transmitted frame as candump -L writes it\n"
    "  --stats F      statistics as JSON, at the end\n"
    "\n"
    "F may be - for standard output. Without any of the three a summary is printed.\n"
    "Exit status: 0, 1 bad input, 2 wrong usage.\n";

/* ---- The run --------------------------------------------------------------------------------- */

static void write_events(sim *s)
{
    cw_event event;
    while (cw_bus_poll(s->bus, &event)) {
        if (event.tick > s->until)
            continue;
        if (event.kind == CW_EVENT_TX)
            s->last_activity = event.tick;
        if (s->events)
            output_event(s->events, s->config, &event);
        if (s->log)
            output_log(s->log, s->config, &event);
    }
}

static void advance(sim *s, uint64_t tick)
{
    while (cw_bus_advance(s->bus, tick) == CW_FULL)
        write_events(s);
    write_events(s);
}

static uint64_t least(uint64_t a, uint64_t b)
{
    return a < b ? a : b;
}

/* When a run without --until gives up waiting for something to happen. */
static uint64_t quiet_end(const sim *s)
{
    if (s->until != CW_NEVER)
        return CW_NEVER;
    return s->last_activity + (uint64_t)QUIET_LIMIT_S * CW_CLOCK_HZ;
}

/* Hands in all releases of one tick, which the bus has not reached, so that their events come among
 * the others of that tick. */
static void hand_in_due(sim *s, uint64_t tick)
{
    while (release_next_tick(s->plan) == tick) {
        if (release_hand_in(s->plan, s->bus) == CW_FULL) /* to the end of the bit it comes up in */
            advance(s, cw_bus_inbox_first(s->bus) + s->config->bit_ticks - 1);
        else
            s->last_activity = tick;
    }
}

/* Up to the last release; false when the run is over before. */
static bool run_releases(sim *s)
{
    for (;;) {
        uint64_t tick = release_next_tick(s->plan);
        if (tick == CW_NEVER)
            return true;
        if (tick > s->until)
            break;
        /* a tx on the way moves the end of the quiet time, so it is asked for again */
        while (cw_bus_now(s->bus) + s->config->bit_ticks < tick) {
            uint64_t target = least(tick - 1, quiet_end(s));
            if (target < cw_bus_now(s->bus) + s->config->bit_ticks)
                return false;
            advance(s, target);
        }
        if (tick > quiet_end(s))
            return false;
        hand_in_due(s, tick);
    }
    return true;
}

static bool traffic_is_over(const sim *s)
{
    return cw_bus_pending(s->bus) == 0 && cw_bus_recessive_bits(s->bus) >= END_RECESSIVE_BITS;
}

/* Bit by bit, so that the run ends in the very bit that the documentation names. */
static void run_out(sim *s)
{
    while (!traffic_is_over(s) && cw_bus_now(s->bus) < quiet_end(s))
        advance(s, cw_bus_now(s->bus) + s->config->bit_ticks);
}

static void run(sim *s)
{
    bool goes_on = run_releases(s);
    if (s->until == CW_NEVER) {
        if (goes_on)
            run_out(s);
        return;
    }
    advance(s, s->until);
    if (cw_bus_inbox_first(s->bus) <= s->until) /* in the middle of a bit, which has to be run */
        advance(s, s->until + s->config->bit_ticks);
}

/* ---- Set-up ---------------------------------------------------------------------------------- */

static bool has_endless_traffic(const cfg *config)
{
    for (size_t i = 0; i < config->node_count; i++)
        for (size_t t = 0; t < config->nodes[i].traffic_count; t++)
            if (config->nodes[i].traffic[t].count == UINT64_MAX)
                return true;
    return false;
}

static bool set_until(sim *s, const char *text)
{
    cfg_time until;
    s->until = CW_NEVER;
    if (text) {
        const char *wrong = text_parse_time(&until, text);
        if (wrong) {
            fprintf(stderr, "canwire sim: --until %s: %s\n", text, wrong);
            return false;
        }
        /* the last tick whose time, truncated to nanoseconds as in events, is not after TIME */
        const cfg_time beyond = {.ns = 1};
        s->until = text_time_ticks_sum(until, 1, beyond, s->config->bit_ticks) - 1;
    } else if (has_endless_traffic(s->config)) {
        fprintf(stderr,
                "canwire sim: %s: traffic without `count` never ends: give `count` or --until TIME\n",
                s->config->file);
        return false;
    }
    return true;
}

static bool set_seed(cfg *config, const char *text)
{
    if (!text)
        return true;
    char *end;
    errno = 0;
    unsigned long long seed = strtoull(text, &end, 10);
    if (errno != 0 || *end != '\0' || *text < '0' || *text > '9') {
        fprintf(stderr, "canwire sim: --seed %s: a whole number from 0 to %llu is expected\n", text,
                (unsigned long long)UINT64_MAX);
        return false;
    }
    config->seed = seed;
    return true;
}

static bool open_output(FILE **out, const char *name)
{
    if (!name)
        return true;
    *out = strcmp(name, "-") == 0 ? stdout : fopen(name, "we");
    if (!*out)
        fprintf(stderr, "canwire sim: %s: %s\n", name, strerror(errno));
    return *out != NULL;
}

static bool close_output(FILE *out, const char *name)
{
    if (!out)
        return true;
    bool good = !ferror(out);
    good = (out == stdout ? fflush(out) : fclose(out)) == 0 && good;
    if (!good)
        fprintf(stderr, "canwire sim: %s: %s\n", name, strerror(errno));
    return good;
}

static bool make_bus(sim *s)
{
    cw_node_config nodes[CW_NODES_MAX];
    cw_bus_config bus_config;
    cfg_bus_config(&bus_config, nodes, s->config);
    bus_config.inbox = INBOX_FRAMES;
    bus_config.events = EVENT_RING;
    s->memory = malloc(cw_bus_size(&bus_config));
    s->plan = release_plan_new(s->config);
    if (!s->memory || !s->plan) {
        fprintf(stderr, "canwire sim: out of memory\n");
        return false;
    }
    s->bus = cw_bus_init(s->memory, &bus_config);
    return s->bus != NULL;
}

static bool set_up(sim *s, const sim_options *o)
{
    s->config = cfg_load(o->file, stderr);
    return s->config && set_seed(s->config, o->seed) && set_until(s, o->until) && make_bus(s) &&
           open_output(&s->events, o->events) && open_output(&s->log, o->log) &&
           open_output(&s->stats, o->stats);
}

static bool finish(sim *s, const sim_options *o)
{
    if (s->stats)
        output_stats(s->stats, s->config, s->bus);
    if (!s->stats && !s->events && !s->log)
        summary_print(stdout, s->config, s->bus);
    bool good = close_output(s->events, o->events);
    good = close_output(s->log, o->log) && good;
    return close_output(s->stats, o->stats) && good;
}

static void tear_down(sim *s)
{
    release_plan_free(s->plan);
    free(s->memory);
    cfg_free(s->config);
}

/* ---- Command line ---------------------------------------------------------------------------- */

/* Returns -1 to go on, else the exit status. */
static int parse_options(sim_options *o, int argc, char **argv)
{
    static const struct option options[] = {
        {"until", required_argument, NULL, 'u'}, {"seed", required_argument, NULL, 's'},
        {"events", required_argument, NULL, 'e'}, {"log", required_argument, NULL, 'l'},
        {"stats", required_argument, NULL, 't'},  {"help", no_argument, NULL, 'h'},
        {NULL, 0, NULL, 0},
    };
    int c;
    while ((c = getopt_long(argc, argv, "h", options, NULL)) != -1) {
        switch (c) {
        case 'u':
            o->until = optarg;
            break;
        case 's':
            o->seed = optarg;
            break;
        case 'e':
            o->events = optarg;
            break;
        case 'l':
            o->log = optarg;
            break;
        case 't':
            o->stats = optarg;
            break;
        case 'h':
            fputs(usage, stdout);
            fputs(help, stdout);
            return 0;
        default:
            fputs(usage, stderr);
            return 2;
        }
    }
    if (optind + 1 != argc) {
        fputs(usage, stderr);
        return 2;
    }
    o->file = argv[optind];
    return -1;
}

int cli_sim(int argc, char **argv)
{
    sim_options options = {.file = NULL};
    int status = parse_options(&options, argc, argv);
    if (status >= 0)
        return status;
    sim s = {.config = NULL};
    bool good = set_up(&s, &options);
    if (good)
        run(&s);
    if (good)
        good = finish(&s, &options);
    tear_down(&s);
    return good ? 0 : 1;
}
