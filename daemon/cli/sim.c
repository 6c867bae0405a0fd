/* SPDX-License-Identifier: MIT
 *
 * sim.c - `canwire sim`: the bus of a configuration in virtual time, without sockets.
 */
#include "cli.h"

#include "output.h"
#include "pcapng.h"
#include "sim_journal.h"
#include "sim_judge.h"
#include "sim_run.h"
#include "sim_trace.h"
#include "sim_until.h"
#include "summary.h"

#include <errno.h>
#include <getopt.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef struct sim_options {
    const char *file; /* NULL with a journal */
    const char *journal;
    const char *until;
    const char *until_event;
    const char *seed;
    const char *events;
    const char *log;
    const char *pcapng;
    const char *stats;
    const char *vcd;
    const char *svg;
    const char *junit;
    const char *from;
    const char *to;
    bool step;
} sim_options;

typedef struct sim {
    cfg *config; /* NULL with a journal, whose own is that of the run */
    sim_journal journal;
    sim_run run;
    FILE *events; /* NULL: not wanted */
    FILE *log;
    FILE *pcapng;
    FILE *stats;
    sim_trace trace;
    sim_until awaited;
    sim_judge judge;
} sim;

static const char usage[] =
    "usage: canwire sim FILE [--until TIME] [--until-event EVENT] [--seed N] [--events F]\n"
    "       [--log F] [--pcapng F] [--stats F] [--vcd F] [--svg F] [--from TIME] [--to TIME]\n"
    "       [--step] [--junit F]\n"
    "       canwire sim --journal FILE ...\n";

static const char help[] =
    "\n"
    "Runs the bus that FILE describes in virtual time: same engine, no sockets, no LCM. Nodes with\n"
    "a port are there but send nothing.\n"
    "\n"
    "  --journal FILE what canwired --journal has written down, once more\n"
    "  --until TIME   end at this bus time (10ms, 2s, 100bit); else when all traffic is done,\n"
    "                 or after 10 s of bus time without a frame or a release\n"
    "  --until-event [NODE:]EVENT\n"
    "                 end with this event, if it comes: error, restart, drop, ... (see watch), a\n"
    "                 state (bus-off, error-passive, ...), tx:FILTER or rx:FILTER, fault:RULE\n"
    "  --seed N       instead of the seed in FILE\n"
    "  --events F     every event as a line of JSON\n"
    "  --log F        every transmitted frame as candump -L writes it\n"
    "  --pcapng F     the same and error frames as a capture for Wireshark; bus time is from 1970 on\n"
    "  --stats F      statistics as JSON, at the end\n"
    "  --vcd F        levels, fields and states of all nodes, for GTKWave, PulseView and sigrok\n"
    "  --svg F        the same as a picture, for reports\n"
    "  --from TIME    of these only the bits from this bus time on\n"
    "  --to TIME      ... up to this one\n"
    "  --junit F      what has become of the expectations in FILE, as JUnit XML\n"
    "  --step         simulate every node in every bit: slower, the same results\n"
    "\n"
    "F may be - for standard output. Without any output a summary is printed. Expectations are\n"
    "reported in any case, on standard error when an F is standard output.\n"
    "Exit status: 0, 1 bad input, 2 wrong usage, 3 an expectation failed.\n";

/* ---- Set-up ---------------------------------------------------------------------------------- */

static bool has_endless_traffic(const cfg *config)
{
    for (size_t i = 0; i < config->node_count; i++)
        for (size_t t = 0; t < config->nodes[i].traffic_count; t++)
            if (cfg_traffic_is_endless(&config->nodes[i].traffic[t]))
                return true;
    return false;
}

static bool set_until(sim *s, const char *text)
{
    cfg_time until;
    if (text) {
        const char *wrong = text_parse_time(&until, text);
        if (wrong) {
            fprintf(stderr, "canwire sim: --until %s: %s\n", text, wrong);
            return false;
        }
        /* the last tick whose time, truncated to nanoseconds as in events, is not after TIME */
        const cfg_time beyond = {.ns = 1};
        s->run.until = text_time_ticks_sum(until, 1, beyond, s->run.config->bit_ticks) - 1;
    } else if (!s->awaited.text && !s->journal.player && has_endless_traffic(s->config)) {
        fprintf(stderr,
                "canwire sim: %s: traffic without `count` never ends: give `count`, --until TIME or "
                "--until-event EVENT\n",
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

static void write_event(void *user, const cw_event *event)
{
    const sim *s = user;
    if (s->events)
        output_event(s->events, s->run.config, event);
    if (s->log)
        output_log(s->log, s->run.config, event);
    if (s->pcapng)
        pcapng_event(s->pcapng, s->run.config, event, text_ticks_ns(event->tick));
}

static bool make_bus(sim *s, const sim_options *o)
{
    s->config = cfg_load(o->file, stderr);
    if (!s->config || !set_seed(s->config, o->seed))
        return false;
    if (sim_open(&s->run, s->config))
        return true;
    fprintf(stderr, "canwire sim: out of memory\n");
    return false;
}

static bool open_journal(sim *s, const sim_options *o)
{
    s->journal = (sim_journal){.run = &s->run,
                               .judge = &s->judge,
                               .trace = &s->trace,
                               .awaited = &s->awaited,
                               .pcapng = &s->pcapng};
    return sim_journal_open(&s->journal, o->journal);
}

static void add_writer(sim *s, const sim_options *o)
{
    const sim_sink writer = {.user = s, .event = write_event,
                             .kinds = o->events || o->pcapng ? 0 : 1u << CW_EVENT_TX};
    s->run.step = o->step;
    sim_add_sink(&s->run, &writer);
}

/* Behind what else looks on: what has to do with events comes before what has to do with bits. */
static bool start_trace(sim *s, const sim_options *o)
{
    if (!sim_trace_window(&s->trace, o->from, o->to, s->run.config, "canwire sim"))
        return false;
    if (!open_output(&s->trace.vcd_out, o->vcd) || !open_output(&s->trace.svg_out, o->svg))
        return false;
    return sim_trace_start(&s->trace, &s->run, "canwire sim");
}

static bool start_pcapng(sim *s, const char *name)
{
    if (!open_output(&s->pcapng, name))
        return false;
    if (s->pcapng)
        pcapng_begin(s->pcapng, s->run.config);
    return true;
}

static bool set_up(sim *s, const sim_options *o)
{
    if (!(o->journal ? open_journal(s, o) : make_bus(s, o)))
        return false;
    add_writer(s, o);
    return sim_until_start(&s->awaited, o->until_event, &s->run) && set_until(s, o->until) &&
           open_output(&s->events, o->events) && open_output(&s->log, o->log) &&
           start_pcapng(s, o->pcapng) && open_output(&s->stats, o->stats) &&
           open_output(&s->judge.junit, o->junit) &&
           sim_judge_start(&s->judge, &s->run, o->journal) && start_trace(s, o);
}

static bool finish(sim *s, const sim_options *o)
{
    if (s->stats)
        output_stats(s->stats, s->run.config, s->run.bus);
    if (!s->stats && !s->events && !s->log && !s->pcapng && !s->trace.vcd_out &&
        !s->trace.svg_out && !s->judge.junit)
        summary_print(stdout, s->run.config, s->run.bus);
    bool good = sim_judge_finish(&s->judge, &s->run);
    good = sim_trace_finish(&s->trace, "canwire sim") && good;
    good = close_output(s->judge.junit, o->junit) && good;
    good = close_output(s->trace.vcd_out, o->vcd) && good;
    good = close_output(s->trace.svg_out, o->svg) && good;
    good = close_output(s->events, o->events) && good;
    good = close_output(s->log, o->log) && good;
    good = close_output(s->pcapng, o->pcapng) && good;
    return close_output(s->stats, o->stats) && good;
}

static bool writes_to_stdout(const sim_options *o)
{
    const char *const outputs[] = {o->events, o->log, o->pcapng, o->stats,
                                   o->vcd,    o->svg, o->junit};
    bool any = false;
    for (size_t i = 0; i < sizeof outputs / sizeof outputs[0]; i++)
        any = any || (outputs[i] && strcmp(outputs[i], "-") == 0);
    return any;
}

static void tear_down(sim *s)
{
    sim_trace_close(&s->trace);
    sim_judge_close(&s->judge);
    sim_close(&s->run);
    sim_journal_close(&s->journal);
    cfg_free(s->config);
}

/* ---- Command line ---------------------------------------------------------------------------- */

/* Two outputs in one file would overwrite each other; on standard output they come in turn. The one
 * that stands there twice, or NULL. */
static const char *shared_output(const sim_options *o)
{
    const char *const outputs[] = {o->events, o->log, o->pcapng, o->stats,
                                   o->vcd,    o->svg, o->junit};
    const size_t count = sizeof outputs / sizeof outputs[0];
    for (size_t i = 0; i < count; i++)
        for (size_t k = i + 1; k < count; k++)
            if (outputs[i] && outputs[k] && strcmp(outputs[i], "-") != 0 &&
                strcmp(outputs[i], outputs[k]) == 0)
                return outputs[i];
    return NULL;
}

/* Returns -1 to go on, else the exit status. */
static int parse_options(sim_options *o, int argc, char **argv)
{
    static const struct option options[] = {
        {"until", required_argument, NULL, 'u'}, {"seed", required_argument, NULL, 's'},
        {"events", required_argument, NULL, 'e'}, {"log", required_argument, NULL, 'l'},
        {"stats", required_argument, NULL, 't'},  {"step", no_argument, NULL, 'S'},
        {"vcd", required_argument, NULL, 'v'},    {"svg", required_argument, NULL, 'g'},
        {"from", required_argument, NULL, 'f'},   {"to", required_argument, NULL, 'o'},
        {"help", no_argument, NULL, 'h'},         {"until-event", required_argument, NULL, 'E'},
        {"junit", required_argument, NULL, 'j'},  {"pcapng", required_argument, NULL, 'p'},
        {"journal", required_argument, NULL, 'J'}, {NULL, 0, NULL, 0},
    };
    int c;
    while ((c = getopt_long(argc, argv, "h", options, NULL)) != -1) {
        switch (c) {
        case 'u':
            o->until = optarg;
            break;
        case 'J':
            o->journal = optarg;
            break;
        case 'E':
            o->until_event = optarg;
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
        case 'p':
            o->pcapng = optarg;
            break;
        case 't':
            o->stats = optarg;
            break;
        case 'v':
            o->vcd = optarg;
            break;
        case 'g':
            o->svg = optarg;
            break;
        case 'j':
            o->junit = optarg;
            break;
        case 'f':
            o->from = optarg;
            break;
        case 'o':
            o->to = optarg;
            break;
        case 'S':
            o->step = true;
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
    if (optind + (o->journal ? 0 : 1) != argc) {
        fputs(usage, stderr);
        return 2;
    }
    if (o->journal && o->seed) {
        fprintf(stderr, "canwire sim: --seed is in the journal\n%s", usage);
        return 2;
    }
    if ((o->from || o->to) && !o->vcd && !o->svg) {
        fprintf(stderr, "canwire sim: --from and --to are for --vcd and --svg\n%s", usage);
        return 2;
    }
    const char *shared = shared_output(o);
    if (shared) {
        fprintf(stderr, "canwire sim: %s: two outputs into one file\n%s", shared, usage);
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
    sim s = {.judge.to_stderr = writes_to_stdout(&options)};
    bool good = set_up(&s, &options);
    if (good) {
        bool room = !s.judge.to_stderr || !isatty(STDOUT_FILENO);
        sim_progress_start(&s.run.progress, room);
        good = options.journal ? sim_journal_go(&s.journal) : sim_go(&s.run);
        sim_until_finish(&s.awaited);
        good = finish(&s, &options) && good;
    }
    bool met = s.judge.report.failed == 0;
    tear_down(&s);
    if (!good)
        return CLI_BAD_INPUT;
    return met ? CLI_OK : CLI_EXPECTATION;
}
