/* SPDX-License-Identifier: MIT
 *
 * sim.c - `canwire sim`: the bus of a configuration in virtual time, without sockets.
 */
#include "base/options.h"
#include "base/text/plain.h"
#include "cli/cli.h"
#include "cli/sim/sim_endless.h"
#include "cli/sim/sim_journal.h"
#include "cli/sim/sim_judge.h"
#include "cli/sim/sim_progress.h"
#include "cli/sim/sim_rig.h"
#include "cli/sim/sim_seeds.h"
#include "cli/sim/sim_trace.h"
#include "cli/sim/summary.h"
#include "config/files.h"
#include "record/output.h"
#include "record/pcapng.h"
#include "run/bus_make.h"
#include "sim/losses.h"
#include "sim/sim_run.h"
#include "sim/sim_until.h"

#include <getopt.h>
#include <inttypes.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* A drop has the time at which its frame was handed in, which may be within a bit. */
#define CAREFUL_BITS 2u

typedef enum output {
    OUT_EVENTS = 0,
    OUT_LOG,
    OUT_PCAPNG,
    OUT_STATS,
    OUT_VCD,
    OUT_SVG,
    OUT_JUNIT,
    OUT_COUNT
} output;

typedef struct sim_options {
    const char *file; /* NULL with a journal */
    const char *journal;
    time_option until;
    time_option from;
    time_option to;
    const char *until_event;
    bool has_seed;
    uint64_t seed;
    const char *outputs[OUT_COUNT]; /* NULL: not wanted */
    bool step;
    bool sync;
    bool captures;
    bool has_seeds;
    bool has_jobs;
    sim_seeds_options seeds;
} sim_options;

typedef struct sim {
    cfg *config; /* NULL with a journal, whose own configuration the run has */
    sim_journal journal;
    sim_run run;
    outfile out[OUT_COUNT];
    bool sync; /* --events has synchronisations, too ... */
    bool captures; /* ... and captures of local times */
    sim_trace trace;
    sim_until awaited;
    sim_judge judge;
    sim_progress progress;
    losses lost; /* without a journal, which tells what has happened elsewhere */
} sim;

static const char usage[] =
    "usage: canwire sim FILE [--until TIME] [--until-event EVENT] [--seed N] [--events F]\n"
    "       [--log F] [--pcapng F] [--stats F] [--vcd F] [--svg F] [--from TIME] [--to TIME]\n"
    "       [--sync] [--captures] [--step] [--junit F]\n"
    "       canwire sim --journal FILE ...\n"
    "       canwire sim FILE --seeds A..B [--jobs J] [--until TIME] [--step]\n";

static const char help[] =
    "Runs the bus that FILE describes in virtual time: same engine, no sockets, no LCM. Nodes\n"
    "with a port are there but send nothing. FILE may be a rig of several buses: all options but\n"
    "--vcd and --svg then are for all of them. The event of --until-event is that of any bus.\n"
    "\n"
    "  --journal FILE\n"
    "                 what canwired --journal has written down, once more\n"
    "  --until TIME   end at this bus time (10ms, 2s, 100bit); else when all traffic is done and\n"
    "                 no rule has a time to come, or after 10 s of bus time without a frame, a\n"
    "                 release or such a time\n"
    "  --until-event [NODE:]EVENT\n"
    "                 end with this event, if it comes: error, restart, drop, ... (see watch), a\n"
    "                 state (bus-off, error-passive, ...), tx:FILTER or rx:FILTER, fault:RULE.\n"
    "                 If it does not come, the run ends as it does without this option; but when\n"
    "                 traffic has no `count`, and there is no --until, it never ends. The run is\n"
    "                 done twice: outputs are written when it is known where the event comes\n"
    "  --seed N       instead of the seed in FILE\n"
    "  --events F     every event as a line of JSON\n"
    "  --sync         ... and synchronisations, where clocks or bit timings of nodes differ;\n"
    "                 slower\n"
    "  --captures     ... and captures of local times\n"
    "  --log F        every transmitted frame as candump -L writes it\n"
    "  --pcapng F     the same and error frames as a capture for Wireshark; bus time is from\n"
    "                 1970 on\n"
    "  --stats F      statistics as JSON, at the end\n"
    "  --vcd F        levels, fields and states of all nodes, for GTKWave, PulseView and sigrok,\n"
    "                 whose decoder for CAN knows no error frames\n"
    "  --svg F        the same as a picture, for reports; of 2000 bits at most\n"
    "  --from TIME    of these only the bits from this bus time on\n"
    "  --to TIME      ... up to this one. Traffic without an end ends there, without --until\n"
    "  --junit F      the outcome of the expectations in FILE, as JUnit XML\n"
    "  --step         simulate every node in every bit: slower, the same results\n"
    "  --seeds A..B   run FILE with each of these seeds; a line of JSON for each: outcome,\n"
    "                 expectations, first error, counters, and the command that repeats it\n"
    "  --jobs J       ... in so many processes, by default one a processor\n"
    "\n"
    "F may be - for standard output. Without any output a summary is printed. Expectations are\n"
    "reported in any case, on standard error when an F is standard output. Ctrl-C ends a run at\n"
    "once: outputs end anywhere, and there are no statistics, no JUnit XML and no summary.\n"
    "Standard error tells at the end which frames were dropped or never sent, which rules never\n"
    "matched, and why the run ended before its traffic.\n"
    "Exit status: 0, 1 a value or a file is bad, or FILE has no such node or rule, 2 wrong\n"
    "usage, 3 an expectation failed.\n";

/* ---- The first run, to find the tick of an awaited event ------------------------------------- */

/* A bus that must not run ahead of its events is many times slower. So two runs at full speed, this
 * one without output, take less time than one careful run. */
typedef struct sim_scout {
    const char *journal; /* that drives the run; NULL: its configuration does */
    sim_run *run;        /* ready to start */
    bool progress;       /* show the progress */
} sim_scout;

/* Returns true for a regular file: a pipe is empty the second time. Files of replays are
 * regular. */
static bool can_be_read_again(const char *file)
{
    struct stat status;
    return stat(file, &status) == 0 && S_ISREG(status.st_mode);
}

/* Prepares a run that is ahead of its events: the bus may be anywhere after the awaited one. */
static bool sim_scout_prepare(sim_run *ahead, sim_progress *progress, sim_until *found,
                              const sim_scout *s, const sim_until *awaited)
{
    if (!sim_until_start(found, awaited->text, ahead))
        return false;
    found->warns = awaited->warns;
    sim_be_careful(ahead, CW_NEVER);
    ahead->until = s->run->until;
    ahead->messages = NULL;
    sim_progress_start(progress, ahead, s->progress, awaited->text);
    return true;
}

/* Looks for the event in a run of the configuration. */
static bool run_file(sim_until *found, const sim_scout *s, const sim_until *awaited)
{
    sim_run ahead;
    sim_progress progress;
    bool good = sim_open(&ahead, s->run->config, NULL) &&
                sim_scout_prepare(&ahead, &progress, found, s, awaited);
    if (good)
        (void)sim_go(&ahead); /* an error occurs again in the real run */
    sim_close(&ahead);
    return good;
}

/* Looks for the event in a run of the journal, whose complaints come in the real run. */
static bool run_journal(sim_until *found, const sim_scout *s, const sim_until *awaited)
{
    sim_run ahead = {.bus = NULL};
    sim_progress progress;
    FILE *nowhere = fopen("/dev/null", "w");
    sim_journal player = {.errors = nowhere, .run = &ahead, .awaited = found};
    bool good = nowhere && sim_journal_open(&player, s->journal) &&
                sim_scout_prepare(&ahead, &progress, found, s, awaited);
    if (good)
        (void)sim_journal_go(&player);
    sim_close(&ahead);
    sim_journal_close(&player);
    if (nowhere)
        fclose(nowhere);
    return good;
}

/* Makes the run careful only at the event, if that comes. The run does not change when the search
 * is impossible: the journal is a pipe, or memory is short. */
static void sim_scout_go(const sim_scout *s, sim_until *awaited)
{
    sim_until found = {.happened = false};
    const uint64_t early = cw_rate_ticks(s->run->config->rate, CAREFUL_BITS);
    if (s->journal && !can_be_read_again(s->journal))
        return;
    if (!(s->journal ? run_journal(&found, s, awaited) : run_file(&found, s, awaited)))
        return;
    awaited->warns = NULL; /* it has warned already */
    if (!found.happened)
        sim_be_careful(s->run, CW_NEVER);
    else
        sim_be_careful(s->run, found.tick > early ? found.tick - early : 0);
}

/* ---- Set-up ---------------------------------------------------------------------------------- */

/* Sets the end of the run. Traffic without an end needs one, or an awaited event. */
static bool set_until(sim *s, const time_option *o, const time_option *to)
{
    const bool endless = !s->journal.player && cfg_find_unending(s->config, NULL);
    const cw_rate rate = s->run.config->rate;
    if (o->text) {
        /* the last tick whose time in events, truncated to nanoseconds, is not after TIME */
        const cfg_time beyond = {.ns = 1};
        s->run.until = text_time_ticks_sum(o->time, 1, beyond, rate) - 1;
    } else if (endless && !s->awaited.text && to->text) {
        /* at the end of the last bit of the window */
        s->run.until = cw_rate_next_bit(rate, text_time_ticks(to->time, rate));
    } else if (endless && !s->awaited.text) {
        sim_endless_tell(s->config);
        return false;
    } else if (endless) {
        sim_until_warn(&s->awaited, stderr);
    }
    return true;
}

/* Writes an event into each output that is open. Synchronisations and captures are for those who
 * ask. */
static void sim_write_event(void *user, const cw_event *event)
{
    const sim *s = user;
    const bool asked = (event->kind != CW_EVENT_SYNC || s->sync) &&
                       (event->kind != CW_EVENT_CAPTURE || s->captures);
    if (s->out[OUT_EVENTS].stream && asked)
        output_event(s->out[OUT_EVENTS].stream, s->run.config, event);
    if (s->out[OUT_LOG].stream)
        output_log(s->out[OUT_LOG].stream, s->run.config, event);
    if (s->out[OUT_PCAPNG].stream)
        pcapng_event(s->out[OUT_PCAPNG].stream, s->run.config, event, text_ticks_ns(event->tick));
}

static void note_loss(void *user, const cw_event *event)
{
    losses_event(user, event);
}

static void watch_losses(sim *s)
{
    const sim_sink sink = {.user = &s->lost, .event = note_loss, .kinds = LOSSES_KINDS};
    s->lost.config = s->config;
    sim_add_sink(&s->run, &sink);
}

/* Loads the configuration and makes its bus. */
static bool make_bus(sim *s, const sim_options *o)
{
    s->config = cfg_load(o->file, stderr);
    if (!s->config)
        return false;
    fputs(s->config->warnings, stderr);
    if (o->has_seed)
        s->config->seed = o->seed;
    if (sim_open(&s->run, s->config, stderr) &&
        (!o->outputs[OUT_STATS] || sim_count_syncs(&s->run)))
        return true;
    plain_print(stderr, "canwire sim: %s\n", bus_why_not());
    return false;
}

/* The journal takes the parts of the run by reference: they must stay where they are. */
static bool open_journal(sim *s, const sim_options *o)
{
    s->journal = (sim_journal){.errors = stderr,
                               .run = &s->run,
                               .judge = &s->judge,
                               .trace = &s->trace,
                               .awaited = &s->awaited,
                               .pcapng = &s->out[OUT_PCAPNG]};
    return sim_journal_open(&s->journal, o->journal);
}

/* Asks for the events that outputs need, and for no more: each kind costs time. */
static void add_writer(sim *s, const sim_options *o)
{
    sim_sink writer = {.user = s, .event = sim_write_event, .kinds = 1u << CW_EVENT_TX};
    if (o->outputs[OUT_EVENTS] || o->outputs[OUT_PCAPNG])
        writer.kinds = CW_EVENTS_USUAL;
    if (o->sync)
        writer.kinds |= 1u << CW_EVENT_SYNC;
    if (o->captures)
        writer.kinds |= 1u << CW_EVENT_CAPTURE;
    s->sync = o->sync;
    s->captures = o->captures;
    s->run.step = o->step;
    sim_add_sink(&s->run, &writer);
}

static bool set_window(sim *s, const sim_options *o)
{
    return sim_trace_window(&s->trace, &o->from, &o->to, s->run.config, "canwire sim");
}

static bool set_event(sim *s, const sim_options *o)
{
    return sim_until_start(&s->awaited, o->until_event, &s->run);
}

static bool wants_output(const sim_options *o)
{
    bool any = false;
    for (unsigned i = 0; i < OUT_COUNT; i++)
        any = any || o->outputs[i];
    return any;
}

/* Adds the outputs; a run without outputs prints a summary. */
static void add_outputs(fileuses *all, const sim_options *o)
{
    static const char *const names[OUT_COUNT] = {
        [OUT_EVENTS] = "--events", [OUT_LOG] = "--log",     [OUT_PCAPNG] = "--pcapng",
        [OUT_STATS] = "--stats",   [OUT_VCD] = "--vcd",     [OUT_SVG] = "--svg",
        [OUT_JUNIT] = "--junit",
    };
    bool standard = !wants_output(o);
    for (unsigned i = 0; i < OUT_COUNT; i++) {
        fileuse use = {.what = names[i], .path = o->outputs[i], .written = true};
        if (use.path && strcmp(use.path, "-") != 0)
            fileuses_add(all, &use);
        standard = standard || (use.path && strcmp(use.path, "-") == 0);
    }
    if (standard)
        fileuses_add(all, &(fileuse){.what = "", .path = "-", .written = true});
}

/* Checks that no output is an input or another output. The journal contains the configuration, and
 * all replayed frames. */
static bool check_files(const sim *s, const sim_options *o)
{
    fileuses all = {.count = 0};
    if (o->journal)
        fileuses_add(&all, &(fileuse){.what = "--journal", .path = o->journal});
    else
        cfg_add_files_read(&all, s->config);
    add_outputs(&all, o);
    bool good = fileuses_check(&all, "canwire sim", stderr);
    fileuses_free(&all);
    return good;
}

/* Opens all outputs before the run. Files keep their content until outfile_begin(). */
static bool open_outputs(sim *s, const sim_options *o)
{
    bool good = check_files(s, o);
    for (unsigned i = 0; i < OUT_COUNT && good; i++)
        good = outfile_open(&s->out[i], o->outputs[i], "canwire sim");
    s->trace.vcd_out = &s->out[OUT_VCD];
    s->trace.svg_out = &s->out[OUT_SVG];
    s->judge.junit = &s->out[OUT_JUNIT];
    return good;
}

/* Returns the tick at which the run ends if nothing fails, CW_NEVER: not known yet. */
static uint64_t known_end(const sim *s, const sim_options *o)
{
    return o->until_event || o->journal ? CW_NEVER : s->run.until;
}

/* Finds the tick of an awaited event first, since only the part from there on needs care. The
 * reference run is careful all the time. */
static void look_ahead(sim *s, const sim_options *o, bool progress)
{
    sim_scout scout = {.journal = o->journal, .run = &s->run, .progress = progress};
    if (o->until_event && !o->step)
        sim_scout_go(&scout, &s->awaited);
}

/* Begins outputs that are written while the bus runs. The search for an awaited event has ended; it
 * may take long or be interrupted, and leaves the files unchanged. */
static void begin_outputs(sim *s)
{
    (void)outfile_begin(&s->out[OUT_EVENTS]);
    (void)outfile_begin(&s->out[OUT_LOG]);
    if (outfile_begin(&s->out[OUT_PCAPNG]))
        pcapng_begin(s->out[OUT_PCAPNG].stream, s->run.config);
    sim_trace_begin(&s->trace);
}

/* Sets up the run. The trace is the last sink, since events come before bits. No output is changed
 * until the run is known to be possible. */
static bool set_up(sim *s, const sim_options *o)
{
    if (!(o->journal ? open_journal(s, o) : make_bus(s, o)))
        return false;
    add_writer(s, o);
    if (s->config)
        watch_losses(s);
    return set_event(s, o) && set_until(s, &o->until, &o->to) && set_window(s, o) &&
           open_outputs(s, o) &&
           sim_judge_start(&s->judge, &s->run, o->journal) &&
           sim_trace_start(&s->trace, &s->run, known_end(s, o), "canwire sim");
}

/* Closes all outputs, also after one that fails. Returns false when one was not written whole. */
static bool close_outputs(sim *s)
{
    bool good = true;
    for (unsigned i = 0; i < OUT_COUNT; i++)
        good = outfile_close(&s->out[i], "canwire sim") && good;
    return good;
}

/* Writes what is known at the end: statistics or a summary, the judgement, losses, traces. */
static bool sim_finish_run(sim *s, const sim_options *o)
{
    if (outfile_begin(&s->out[OUT_STATS]))
        output_stats(s->out[OUT_STATS].stream, s->run.config, s->run.bus);
    if (!wants_output(o))
        summary_print(stdout, s->run.config, s->run.bus);
    bool good = sim_judge_finish(&s->judge, &s->run);
    if (s->config)
        losses_print(&s->lost, s->run.bus, "", stderr);
    good = sim_trace_finish(&s->trace, "canwire sim") && good;
    return close_outputs(s) && good;
}

/* Returns true when an output is standard output. Reports of expectations then go to standard
 * error. */
static bool writes_to_stdout(const sim_options *o)
{
    bool any = false;
    for (unsigned i = 0; i < OUT_COUNT; i++)
        any = any || (o->outputs[i] && strcmp(o->outputs[i], "-") == 0);
    return any;
}

/* Frees all, also after a failure anywhere before. */
static void tear_down(sim *s)
{
    sim_trace_close(&s->trace);
    (void)close_outputs(s);
    sim_judge_close(&s->judge);
    sim_close(&s->run);
    sim_journal_close(&s->journal);
    cfg_free(s->config);
}

/* ---- Command line ---------------------------------------------------------------------------- */

static bool can_be_shared(const char *file)
{
    struct stat found;
    return stat(file, &found) == 0 && !S_ISREG(found.st_mode);
}

/* Returns an output that is given twice, or NULL. Two outputs in one file would overwrite each
 * other. Standard output takes them in turn, and a device (/dev/null) takes all. */
static const char *shared_output(const sim_options *o)
{
    for (size_t i = 0; i < OUT_COUNT; i++)
        for (size_t k = i + 1; k < OUT_COUNT; k++)
            if (o->outputs[i] && o->outputs[k] && strcmp(o->outputs[i], "-") != 0 &&
                strcmp(o->outputs[i], o->outputs[k]) == 0 && !can_be_shared(o->outputs[i]))
                return o->outputs[i];
    return NULL;
}

/* Complains; returns the exit status. */
static int sim_refuse(const char *what, const char *why)
{
    plain_print(stderr, "canwire sim: %s: %s\n%s", what, why, usage);
    return CLI_USAGE;
}

/* The text stays with the time, for messages and for commands that repeat the run. */
static bool sim_take_time(void *out, const char *option, const char *text)
{
    time_option *time = out;
    const char *wrong = text_parse_time(&time->time, text);
    time->text = text;
    if (wrong)
        plain_print(stderr, "canwire sim: %s %s: %s\n", option, text, wrong);
    return !wrong;
}

static bool take_seed(void *out, const char *option, const char *text)
{
    if (!text_parse_uint(out, text))
        return true;
    plain_print(stderr, "canwire sim: %s %s: a whole number from 0 to %" PRIu64 " is expected\n",
                option, text, UINT64_MAX);
    return false;
}

static bool take_seeds(void *out, const char *option, const char *text)
{
    (void)option;
    return sim_seeds_parse(out, text);
}

static bool sim_take_jobs(void *out, const char *option, const char *text)
{
    (void)option;
    return sim_seeds_parse_jobs(out, "canwire sim", text);
}

/* Checks combinations of options. Returns -1 to go on, otherwise the exit status. */
static int check_options(const sim_options *o)
{
    const char *shared = shared_output(o);
    if (o->has_seeds && (o->journal || o->has_seed || o->until_event || wants_output(o)))
        return sim_refuse("--seeds", "it has no journal, no other seed, no event and no outputs");
    if (o->has_jobs && !o->has_seeds)
        return sim_refuse("--jobs", "it is for --seeds");
    if (o->journal && o->has_seed)
        return sim_refuse("--seed", "it is in the journal");
    if ((o->from.text || o->to.text) && !o->outputs[OUT_VCD] && !o->outputs[OUT_SVG])
        return sim_refuse("--from and --to", "they are for --vcd and --svg");
    if (o->sync && !o->outputs[OUT_EVENTS])
        return sim_refuse("--sync", "it is for --events");
    if (o->captures && !o->outputs[OUT_EVENTS])
        return sim_refuse("--captures", "it is for --events");
    if (shared)
        return sim_refuse(shared, "two outputs into one file");
    return -1;
}

/* Returns -1 to go on, otherwise the exit status. */
static int sim_parse_options(sim_options *o, int argc, char **argv)
{
    const option_row rows[] = {
        {"until", .read = sim_take_time, .out = &o->until},
        {"until-event", .text = &o->until_event},
        {"seed", .read = take_seed, .out = &o->seed, .flag = &o->has_seed},
        {"seeds", .read = take_seeds, .out = &o->seeds, .flag = &o->has_seeds},
        {"jobs", .read = sim_take_jobs, .out = &o->seeds.jobs, .flag = &o->has_jobs},
        {"journal", .text = &o->journal},
        {"from", .read = sim_take_time, .out = &o->from},
        {"to", .read = sim_take_time, .out = &o->to},
        {"sync", .flag = &o->sync},
        {"captures", .flag = &o->captures},
        {"step", .flag = &o->step},
        {"events", .text = &o->outputs[OUT_EVENTS]},
        {"log", .text = &o->outputs[OUT_LOG]},
        {"pcapng", .text = &o->outputs[OUT_PCAPNG]},
        {"stats", .text = &o->outputs[OUT_STATS]},
        {"vcd", .text = &o->outputs[OUT_VCD]},
        {"svg", .text = &o->outputs[OUT_SVG]},
        {"junit", .text = &o->outputs[OUT_JUNIT]},
        {.name = NULL},
    };
    const option_table table = {.usage = usage, .help = help, .rows = rows};
    const int status = options_read(&table, argc, argv);
    if (status >= 0)
        return status;
    if (optind + (o->journal ? 0 : 1) != argc)
        return options_refuse(&table);
    o->file = argv[optind];
    return check_options(o);
}

/* Runs a rig. It has no outputs of single bits. */
static int run_rig(const sim_options *o)
{
    const sim_rig_options options = {
        .file = o->journal ? NULL : o->file, .journal = o->journal,
        .has_until = o->until.text, .until = o->until.time,
        .has_seed = o->has_seed, .seed = o->seed, .events = o->outputs[OUT_EVENTS],
        .log = o->outputs[OUT_LOG], .pcapng = o->outputs[OUT_PCAPNG],
        .junit = o->outputs[OUT_JUNIT], .stats = o->outputs[OUT_STATS], .step = o->step,
        .until_event = o->until_event, .sync = o->sync, .captures = o->captures};
    if (o->until.time.bits > 0)
        return sim_refuse("--until", "a rig has bits of several lengths; give a time such as 10ms");
    if (o->outputs[OUT_VCD] || o->outputs[OUT_SVG])
        return sim_refuse(
            o->journal ? o->journal : o->file,
            "bits of several lengths are not in one --vcd or --svg; for those of one bus "
            "run its own file");
    if (o->journal && o->until_event && !can_be_read_again(o->journal))
        return sim_refuse(o->journal,
                          "the journal of a rig is read twice for --until-event: it has to "
                          "be a file");
    if (o->journal && o->outputs[OUT_PCAPNG])
        return sim_refuse(o->journal, "the journal of a rig has no --pcapng");
    return sim_rig_main(&options);
}

/* Hands over the options that make sense for many runs; others were refused before. */
static int run_seeds(const sim_options *o)
{
    sim_seeds_options seeds = o->seeds;
    seeds.file = o->file;
    seeds.until_text = o->until.text;
    seeds.until = o->until.time;
    seeds.step = o->step;
    return sim_seeds_main(&seeds);
}

int cli_sim(int argc, char **argv)
{
    sim_options options = {.file = NULL};
    int status = sim_parse_options(&options, argc, argv);
    if (status >= 0)
        return status;
    if (options.has_seeds)
        return run_seeds(&options);
    if (options.journal ? journal_is_of_rig(options.journal) : rig_is_rig(options.file))
        return run_rig(&options);
    sim s = {.judge.to_stderr = writes_to_stdout(&options)};
    bool good = set_up(&s, &options);
    if (good) {
        bool room = !s.judge.to_stderr || !isatty(STDOUT_FILENO);
        look_ahead(&s, &options, room);
        begin_outputs(&s);
        sim_progress_start(&s.progress, &s.run, room, options.until_event);
        good = options.journal ? sim_journal_go(&s.journal) : sim_go(&s.run);
        sim_until_finish(&s.awaited, stderr);
        good = sim_finish_run(&s, &options) && good;
    }
    bool met = s.judge.report.failed == 0;
    tear_down(&s);
    if (!good)
        return CLI_BAD_INPUT;
    return met ? CLI_OK : CLI_EXPECTATION;
}
