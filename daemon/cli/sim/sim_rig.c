/* SPDX-License-Identifier: MIT
 *
 * sim_rig.c - runs the buses of a rig in one virtual time, with the gateways between them.
 *
 * The buses go from meeting to meeting (meeting.h). Their events are written in order as soon as
 * all buses are there.
 *
 * With an awaited event the run is done twice. A bus may be beyond it when another one comes to it.
 * So the first run only finds out where it comes, and the second one ends there.
 */
#include "cli/sim/sim_rig.h"

#include "base/text/jsonput.h"
#include "base/least.h"
#include "base/text/plain.h"
#include "base/text/memo.h"
#include "base/version.h"
#include "cli/cli.h"
#include "cli/status/gateways_text.h"
#include "cli/sim/sim_endless.h"
#include "cli/sim/summary.h"
#include "config/doubts.h"
#include "config/files.h"
#include "record/output.h"
#include "record/pcapng.h"
#include "run/bus_make.h"
#include "run/journal_play.h"
#include "sim/losses.h"
#include "sim/sim_group.h"
#include "sim/sim_until.h"

#include <stdlib.h>
#include <string.h>

#define KEPT_MAX 1024u /* events of a journal, before a look at what can be written */

/* An event that waits for those of other buses. */
typedef struct kept {
    char *line;   /* the event as text, of a configuration that has gone; else NULL */
    char *logged; /* in the same way: for --log */
    cw_event event;
} kept;

typedef struct sim_rig sim_rig;

typedef struct rig_bus {
    sim_rig *all;
    size_t index;
    unsigned first_node; /* number of the nodes of the buses before it */
    sim_run run;
    sim_judge judge;
    sim_until awaited; /* of a run that looks ahead */
    losses lost;       /* without a journal */
    uint32_t kinds;    /* of events that are kept */
    kept *list; /* events that some bus has not reached yet, in their order */
    size_t first;
    size_t end;
    size_t room;
} rig_bus;

struct sim_rig {
    const sim_rig_options *options;
    rig *config;            /* NULL with a journal */
    journal_player *player; /* NULL without */
    sim_group group;
    rig_bus buses[RIG_BUSES_MAX];
    size_t bus_count; /* opened */
    outfile events;
    outfile log;
    outfile pcapng;
    outfile stats;
    outfile junit;
    outfile no_junit; /* of a bus alone */
    bool looks_ahead; /* for the awaited event; nothing is written */
    bool endless;    /* without it: there is no other end */
    uint64_t ends_at; /* tick of the awaited event; CW_NEVER: none */
    unsigned awaits;  /* buses at which it may come */
    bool keeps;      /* events, since an output wants them */
    size_t count;    /* of kept events of all buses */
    size_t write_at; /* with a journal: this many events */
    FILE *nowhere;   /* for messages of the journal to a run that looks ahead */
    bool no_memory;
};

/* ---- Events ---------------------------------------------------------------------------------- */

static bool has_frame(cw_event_kind kind)
{
    return kind == CW_EVENT_RX || kind == CW_EVENT_TX || kind == CW_EVENT_DROP ||
           kind == CW_EVENT_ARBITRATION_LOST || kind == CW_EVENT_OVERRUN ||
           kind == CW_EVENT_IMPROPER || kind == CW_EVENT_CAPTURE;
}

/* Copies what there is of an event in place. */
static void copy_event(cw_event *to, const cw_event *from)
{
    const cw_frame *frame = &from->frame;
    memcpy(to, from, offsetof(cw_event, frame));
    if (!has_frame(from->kind)) {
        to->frame = (cw_frame){.id = 0};
        return;
    }
    const unsigned length = frame->flags & CW_FRAME_CUT ? 8 : cw_frame_length(frame);
    memcpy(&to->frame, frame, offsetof(cw_frame, data) + length);
}

/* Writes an event of a bus. The bus may have left its configuration since: then it was kept as
 * text. */
static void sim_rig_write_event(sim_rig *s, const rig_bus *b, kept *k)
{
    const cfg *config = b->run.config;
    if (s->events.stream && k->line)
        fputs(k->line, s->events.stream);
    else if (s->events.stream)
        output_event_of_bus(s->events.stream, config, &k->event);
    if (s->log.stream && k->logged)
        fputs(k->logged, s->log.stream);
    else if (s->log.stream)
        output_log(s->log.stream, config, &k->event);
    if (s->pcapng.stream)
        pcapng_event_of_bus(s->pcapng.stream, config, b->first_node, &k->event,
                            text_ticks_ns(k->event.tick));
    free(k->line);
    free(k->logged);
}

/* Returns the bus with the next event, or NULL when there is none before a tick. */
static rig_bus *find_next(sim_rig *s, uint64_t tick)
{
    rig_bus *next = NULL;
    for (size_t i = 0; i < s->bus_count; i++) {
        rig_bus *b = &s->buses[i];
        if (b->first == b->end || b->list[b->first].event.tick >= tick)
            continue;
        if (!next || b->list[b->first].event.tick < next->list[next->first].event.tick)
            next = b;
    }
    return next;
}

/* Writes the events before a tick that all buses have reached. Until then a bus in the middle of a
 * longer bit may have earlier ones. At that tick itself frames may still come in, and be
 * dropped. */
static void write_events(sim_rig *s, uint64_t tick)
{
    for (rig_bus *b; (b = find_next(s, tick)); s->count--)
        sim_rig_write_event(s, b, &b->list[b->first++]);
    for (size_t i = 0; i < s->bus_count; i++) {
        rig_bus *b = &s->buses[i];
        if (b->first == 0)
            continue;
        memmove(b->list, b->list + b->first, (b->end - b->first) * sizeof *b->list);
        b->end -= b->first;
        b->first = 0;
    }
}

/* Writes what all buses have reached, but for the events from a tick on. */
static void write_reached_before(sim_rig *s, uint64_t tick)
{
    uint64_t reached = tick;
    for (size_t i = 0; i < s->bus_count; i++)
        reached = least(reached, cw_bus_now(s->buses[i].run.bus));
    write_events(s, reached);
    s->write_at = 2 * s->count > KEPT_MAX ? 2 * s->count : KEPT_MAX;
}

static void write_reached(void *user)
{
    write_reached_before(user, CW_NEVER);
}

/* Opens a gap in the list, which has room. */
static kept *open_gap(rig_bus *b, size_t place)
{
    memmove(b->list + place + 1, b->list + place, (b->end - place) * sizeof *b->list);
    b->end++;
    b->all->count++;
    b->list[place].line = NULL;
    b->list[place].logged = NULL;
    return &b->list[place];
}

/* Finds the place of an event, as the bus does it. A gateway may have handed in a frame behind the
 * bit that ended at its tick. An event of several nodes is divided when one comes in between. A
 * journal repeats the order in which the running rig has told its events. */
static size_t sim_rig_find_place(rig_bus *b, const cw_event *added)
{
    size_t place = b->end;
    uint64_t behind;
    while (!b->all->player && place > b->first &&
           (behind = cw_event_part_behind(&b->list[place - 1].event, added)) != 0) {
        kept *before = &b->list[place - 1];
        if (behind != UINT64_MAX && behind != before->event.nodes && !before->line) {
            copy_event(&open_gap(b, place)->event, &before->event);
            b->list[place].event.nodes = behind;
            before->event.nodes &= ~behind;
            break;
        }
        place--;
    }
    return place;
}

/* Adds an event to those of a bus. Returns false without memory. */
static bool sim_rig_keep(rig_bus *b, const cw_event *event)
{
    if (b->room - b->end < 2) {
        const size_t room = b->room > 0 ? 2 * b->room : 256;
        kept *list = realloc(b->list, room * sizeof *list);
        if (!list)
            return false;
        b->list = list;
        b->room = room;
    }
    copy_event(&open_gap(b, sim_rig_find_place(b, event))->event, event);
    return true;
}

/* Keeps an event until all buses have reached its time: outputs are in order of time. The bus may
 * be beyond it, and have more events to tell behind this one. */
static void keep_event(void *user, const cw_event *event)
{
    rig_bus *b = user;
    sim_rig *s = b->all;
    sim_group_note(&s->group, b->index, event);
    losses_event(&b->lost, event);
    if (!s->keeps || !(b->kinds >> event->kind & 1u))
        return;
    if (!sim_rig_keep(b, event)) {
        s->no_memory = true;
        return;
    }
    if (s->player && s->count >= s->write_at)
        write_reached_before(s, event->tick);
}

/* ---- Journal --------------------------------------------------------------------------------- */

static bool sim_rig_advance(void *user, uint64_t tick)
{
    rig_bus *b = user;
    return sim_advance(&b->run, tick);
}

static void sim_rig_drain(void *user)
{
    rig_bus *b = user;
    sim_pass_on(&b->run, NULL);
}

static void sim_rig_pass_on(void *user, const cw_event *event)
{
    rig_bus *b = user;
    sim_pass_on(&b->run, event);
}

/* Prints an event as text, to be freed; NULL: without memory. */
static char *sim_rig_text_of(const cfg *config, const cw_event *event,
                             void (*print)(FILE *out, const cfg *config, const cw_event *event))
{
    memo line;
    if (memo_begin(&line))
        print(line.out, config, event);
    return memo_take(&line);
}

/* Makes texts of the events of a bus that are not written yet: they have names of rules and nodes
 * that go. */
static void keep_names(void *user)
{
    rig_bus *b = user;
    for (size_t i = b->first; i < b->end; i++) {
        kept *k = &b->list[i];
        if (k->line)
            continue;
        k->line = sim_rig_text_of(b->run.config, &k->event, output_event_of_bus);
        k->logged = sim_rig_text_of(b->run.config, &k->event, output_log);
    }
}

/* Ends what belongs to the configuration that a bus leaves. Names of its nodes are kept for events
 * that are still to be written. */
static void sim_rig_leave(void *user, const cfg *next, const uint8_t from[CW_NODES_MAX])
{
    rig_bus *b = user;
    (void)next;
    (void)from;
    if (!b->all->looks_ahead)
        sim_judge_leave(&b->judge, &b->run);
    keep_names(b);
}

/* A bus has its next configuration: the run, the awaited event and the judge go over to it. */
static void sim_rig_go_over(void *user)
{
    rig_bus *b = user;
    const journal_player *player = b->all->player;
    sim_change(&b->run, journal_player_config_of(player, b->index),
               journal_player_bus_of(player, b->index));
    sim_until_change(&b->awaited);
    if (!b->all->looks_ahead)
        sim_judge_enter(&b->judge, &b->run);
}

static void *of_bus(void *user, size_t bus)
{
    sim_rig *s = user;
    return &s->buses[bus];
}

/* The journal calls each bus by itself. A run that looks ahead prints no messages. */
static bool open_journal(sim_rig *s)
{
    static const journal_calls calls = {.advance = sim_rig_advance,
                                        .drain = sim_rig_drain,
                                        .event = sim_rig_pass_on,
                                        .renaming = keep_names,
                                        .leaving = sim_rig_leave,
                                        .changed = sim_rig_go_over,
                                        .of_bus = of_bus};
    const char *file = s->options->journal;
    s->player = journal_player_open(file, &calls, s, s->looks_ahead ? s->nowhere : stderr);
    const char *writer = s->player ? journal_player_writer(s->player) : CANWIRE_VERSION;
    if (!s->looks_ahead && strcmp(writer, CANWIRE_VERSION) != 0)
        plain_print(stderr, "canwire sim: %s: written by canwire %s; this is " CANWIRE_VERSION "\n",
                    file, writer);
    return s->player;
}

/* Runs to the end. Returns false after a message. */
static bool sim_rig_run(sim_rig *s)
{
    bool good = true;
    sim_group_begin(&s->group);
    if (s->player) {
        good = journal_play(s->player) != JOURNAL_FAILED;
    } else {
        sim_group_simulate(&s->group);
    }
    write_events(s, CW_NEVER);
    return good;
}

/* ---- Set-up ---------------------------------------------------------------------------------- */

static bool sim_rig_fail(const char *why)
{
    plain_print(stderr, "canwire sim: %s\n", why);
    return false;
}

/* Returns true when the buses end some time. */
static bool check_end(const sim_rig *s, const cfg *config)
{
    if (s->options->has_until || s->ends_at != CW_NEVER)
        return true;
    if (!s->looks_ahead)
        sim_endless_tell(config);
    return !cfg_find_unending(config, NULL);
}

/* Makes a bus, from the journal or the configuration. Messages come from the real run alone. */
static bool open_run(sim_rig *s, rig_bus *b)
{
    if (s->player)
        return sim_open_bus(&b->run, journal_player_config_of(s->player, b->index),
                            journal_player_bus_of(s->player, b->index),
                            s->looks_ahead ? NULL : stderr);
    cfg *config = s->config->buses[b->index];
    if (!s->looks_ahead)
        fputs(config->warnings, stderr);
    if (s->options->has_seed)
        config->seed = s->options->seed;
    return sim_open(&b->run, config, s->looks_ahead ? NULL : stderr);
}

static bool has_output(const sim_rig_options *o)
{
    return o->events || o->log || o->pcapng || o->stats || o->junit;
}

/* Ends all buses with the event, but for those that are beyond it. Another bus may still come to
 * one before it. */
static void end_at(void *user, uint64_t tick)
{
    sim_rig *s = user;
    s->ends_at = least(s->ends_at, tick);
    for (size_t i = 0; i < s->bus_count; i++)
        s->buses[i].run.until = least(s->buses[i].run.until, s->ends_at);
}

/* Returns what the awaited event is at a bus: all but the name of the bus. NULL: it is one of
 * another bus. */
static const char *event_at(const sim_rig *s, const rig_bus *b)
{
    const char *text = s->options->until_event;
    for (size_t i = 0; i < s->bus_count; i++) {
        const char *name = s->buses[i].run.config->bus_name;
        const size_t length = strlen(name);
        if (strncmp(text, name, length) == 0 && text[length] == ':')
            return i == b->index ? text + length + 1 : NULL;
    }
    return text;
}

/* Awaits the event at a bus that knows its words. */
static void sim_rig_await(sim_rig *s, rig_bus *b, bool quiet)
{
    const char *text = event_at(s, b);
    b->run.messages = quiet ? NULL : stderr;
    if (text && sim_until_start(&b->awaited, text, &b->run))
        s->awaits++;
    else
        b->awaited.text = NULL;
    b->run.messages = NULL;
    sim_be_careful(&b->run, CW_NEVER);
    b->awaited.found = end_at;
    b->awaited.user = s;
}

/* Awaits the event at all buses that know its words. Returns false after a message when there is
 * none. */
static bool await_all(sim_rig *s)
{
    for (size_t i = 0; i < s->bus_count; i++)
        sim_rig_await(s, &s->buses[i], true);
    for (size_t i = 0; i < s->bus_count && s->awaits == 0; i++) {
        const bool tells = event_at(s, &s->buses[i]);
        if (tells)
            sim_rig_await(s, &s->buses[i], false);
        if (tells)
            break;
    }
    return s->awaits > 0;
}

/* Chooses the events of a bus that outputs need. */
static void choose_events(rig_bus *b, const sim_rig_options *o)
{
    b->kinds = 1u << CW_EVENT_TX;
    if (o->events || o->pcapng)
        b->kinds = CW_EVENTS_USUAL;
    if (o->sync)
        b->kinds |= 1u << CW_EVENT_SYNC;
    if (o->captures)
        b->kinds |= 1u << CW_EVENT_CAPTURE;
}

/* Makes bus i of a rig, with its end, its judge and what it keeps. */
static bool sim_rig_open_bus(sim_rig *s, size_t i)
{
    rig_bus *b = &s->buses[i];
    sim_sink keeper = {.user = b, .event = keep_event};
    s->bus_count++;
    b->all = s;
    b->index = i;
    s->group.runs[s->group.count++] = &b->run;
    const rig_bus *before = i > 0 ? b - 1 : NULL;
    if (before)
        b->first_node = before->first_node + (unsigned)before->run.config->node_count;
    if (!open_run(s, b))
        return sim_rig_fail(bus_why_not());
    b->run.step = s->options->step;
    if (s->options->has_until) /* the last tick whose time in events is not after TIME */
        b->run.until = text_time_ticks_sum(s->options->until, 1, (cfg_time){.ns = 1},
                                           b->run.config->rate) - 1;
    b->run.until = least(b->run.until, s->ends_at);
    b->judge.junit = &s->no_junit;
    b->judge.to_stderr = has_output(s->options);
    choose_events(b, s->options);
    keeper.kinds = b->kinds | LOSSES_KINDS;
    b->lost.config = s->player ? NULL : s->config->buses[i];
    b->lost.fed = doubts_fed(s->config, i);
    if (sim_group_wants(&s->group, i))
        keeper.kinds |= 1u << CW_EVENT_RX;
    sim_add_sink(&b->run, &keeper);
    const bool ends = s->player || check_end(s, b->run.config);
    if (!s->looks_ahead)
        return ends && sim_judge_start(&b->judge, &b->run, s->player);
    s->endless = s->endless || !ends;
    return true;
}

/* No output may be an input or another output. */
static bool check_files(const sim_rig *s)
{
    const struct { const char *what, *path; } outputs[] = {
        {"--events", s->options->events},
        {"--log", s->options->log},
        {"--pcapng", s->options->pcapng},
        {"--stats", s->options->stats},
        {"--junit", s->options->junit},
    };
    fileuses all = {.count = 0};
    if (s->player)
        fileuses_add(&all, &(fileuse){.what = "--journal", .path = s->options->journal});
    else
        fileuses_add(&all, &(fileuse){.what = "rig", .path = s->config->file});
    for (size_t i = 0; !s->player && i < s->config->bus_count; i++)
        cfg_add_files_read(&all, s->config->buses[i]);
    for (size_t i = 0; i < sizeof outputs / sizeof *outputs; i++)
        if (outputs[i].path && strcmp(outputs[i].path, "-") != 0)
            fileuses_add(&all, &(fileuse){.what = outputs[i].what, .path = outputs[i].path,
                                          .written = true});
    const bool good = fileuses_check(&all, "canwire sim", stderr);
    fileuses_free(&all);
    return good;
}

/* Loads the rig and its gateways. Returns false after a message. */
static bool load_rig(sim_rig *s)
{
    s->config = rig_load(s->options->file, stderr);
    if (!s->config)
        return false;
    return sim_group_open(&s->group, s->config) || sim_rig_fail("out of memory");
}

/* Makes all buses and opens the outputs. Returns false after a message. */
static bool set_up(sim_rig *s)
{
    s->group = (sim_group){.step = s->options->step,
                           .messages = s->looks_ahead ? NULL : stderr,
                           .user = s,
                           .reached = write_reached};
    if (!(s->options->journal ? open_journal(s) : load_rig(s)))
        return false;
    const size_t count = s->player ? journal_player_count(s->player) : s->config->bus_count;
    for (size_t i = 0; i < count; i++)
        if (!sim_rig_open_bus(s, i))
            return false;
    return check_files(s) && outfile_open(&s->events, s->options->events, "canwire sim") &&
           outfile_open(&s->log, s->options->log, "canwire sim") &&
           outfile_open(&s->pcapng, s->options->pcapng, "canwire sim") &&
           outfile_open(&s->junit, s->options->junit, "canwire sim") &&
           outfile_open(&s->stats, s->options->stats, "canwire sim");
}

/* Writes the statistics of all buses in their order, and those of gateways. */
static void write_stats(sim_rig *s)
{
    json_t *root = json_object();
    json_t *buses = json_array();
    for (size_t i = 0; i < s->bus_count; i++)
        put_last(buses, output_all_stats(s->buses[i].run.config, s->buses[i].run.bus));
    put(root, "buses", buses);
    if (s->group.meeting.gateways)
        put(root, "gateways", gateways_stats(s->group.meeting.gateways, GATEWAYS_ALL));
    put_out(s->stats.stream, root);
    json_decref(root);
}

/* Writes the outcomes of all buses. */
static void write_junit(sim_rig *s)
{
    expect_suite suites[RIG_BUSES_MAX];
    for (size_t i = 0; i < s->bus_count; i++)
        suites[i] = (expect_suite){.report = &s->buses[i].judge.report,
                                   .bus = s->buses[i].run.config->bus_name};
    expect_report_junit(outfile_begin(&s->junit), suites, s->bus_count,
                        cw_bus_now(s->buses[0].run.bus));
}

/* Prints the summary of the gateways. */
static void print_gateways(const sim_rig *s)
{
    json_t *all = gateways_stats(s->group.meeting.gateways, GATEWAYS_ALL);
    gateways_print(stdout, all);
    json_decref(all);
}

/* Tells what a bus has lost. */
static void tell_losses(const rig_bus *b)
{
    char before[CFG_NODE_NAME_MAX + 2];
    (void)snprintf(before, sizeof before, "%s:", b->run.config->bus_name);
    if (b->lost.config)
        losses_print(&b->lost, b->run.bus, before, stderr);
}

/* Reports; *met tells about the expectations. */
static bool sim_rig_finish(sim_rig *s, bool *met)
{
    bool good = s->player || !sim_group_failed(&s->group);
    if (s->no_memory || s->group.no_memory)
        good = sim_rig_fail("out of memory");
    if (outfile_begin(&s->stats))
        write_stats(s);
    for (size_t i = 0; i < s->bus_count; i++) {
        rig_bus *b = &s->buses[i];
        if (!b->judge.to_stderr)
            summary_print(stdout, b->run.config, b->run.bus);
        good = sim_judge_finish(&b->judge, &b->run) && good;
        *met = *met && b->judge.report.failed == 0;
        tell_losses(b);
    }
    if (s->junit.stream)
        write_junit(s);
    if (!has_output(s->options) && s->group.meeting.gateways)
        print_gateways(s);
    good = outfile_close(&s->events, "canwire sim") && good;
    good = outfile_close(&s->log, "canwire sim") && good;
    good = outfile_close(&s->pcapng, "canwire sim") && good;
    good = outfile_close(&s->junit, "canwire sim") && good;
    return outfile_close(&s->stats, "canwire sim") && good;
}

/* Frees all, also after a failure anywhere before. Outputs that sim_rig_finish() has closed are
 * NULL by now. */
static void tear_down(sim_rig *s)
{
    for (size_t i = 0; i < s->bus_count; i++) {
        sim_judge_close(&s->buses[i].judge);
        sim_close(&s->buses[i].run);
        free(s->buses[i].list);
    }
    (void)outfile_close(&s->events, "canwire sim");
    (void)outfile_close(&s->log, "canwire sim");
    (void)outfile_close(&s->pcapng, "canwire sim");
    (void)outfile_close(&s->junit, "canwire sim");
    (void)outfile_close(&s->stats, "canwire sim");
    sim_group_close(&s->group);
    journal_player_close(s->player);
    rig_free(s->config);
    if (s->nowhere)
        (void)fclose(s->nowhere);
    free(s);
}

static void begin_pcapng(sim_rig *s)
{
    if (outfile_begin(&s->pcapng))
        pcapng_begin_all(s->pcapng.stream, (const cfg *const *)s->config->buses,
                         s->config->bus_count);
}

/* Warns once, for all buses, that the awaited event may never come. */
static void warn_once(sim_rig *s)
{
    size_t i = 0;
    while (!s->buses[i].awaited.text)
        i++;
    sim_until_warn(&s->buses[i].awaited, stderr);
}

/* Finds where the awaited event comes; CW_NEVER: it does not. Returns false after a message. */
static bool look_ahead(const sim_rig_options *options, uint64_t *ends_at)
{
    const sim_rig_options silent = {.file = options->file, .journal = options->journal,
                                    .has_until = options->has_until, .until = options->until,
                                    .until_event = options->until_event,
                                    .has_seed = options->has_seed, .seed = options->seed,
                                    .step = options->step};
    sim_rig *s = calloc(1, sizeof *s);
    if (!s)
        return sim_rig_fail("out of memory");
    s->options = &silent;
    s->looks_ahead = true;
    s->ends_at = CW_NEVER;
    s->nowhere = fopen("/dev/null", "w");
    bool good =
        (s->nowhere || sim_rig_fail("/dev/null cannot be opened")) && set_up(s) && await_all(s);
    if (good && s->endless)
        warn_once(s);
    if (good)
        (void)sim_rig_run(s); /* the other run says what is wrong */
    *ends_at = s->ends_at;
    tear_down(s);
    return good;
}

static void tell_no_event(const sim_rig *s)
{
    if (s->options->until_event && s->ends_at == CW_NEVER)
        plain_print(stderr, "canwire sim: --until-event %s: it did not happen\n",
                    s->options->until_event);
}

int sim_rig_main(const sim_rig_options *options)
{
    uint64_t ends_at = CW_NEVER;
    if (options->until_event && !look_ahead(options, &ends_at))
        return CLI_BAD_INPUT;
    sim_rig *s = calloc(1, sizeof *s);
    bool met = true;
    if (!s) {
        (void)sim_rig_fail("out of memory");
        return CLI_BAD_INPUT;
    }
    s->options = options;
    s->ends_at = ends_at;
    s->keeps = options->events || options->log || options->pcapng;
    bool good = set_up(s);
    if (good) {
        (void)outfile_begin(&s->events);
        (void)outfile_begin(&s->log);
        begin_pcapng(s);
        good = sim_rig_run(s);
        tell_no_event(s);
        good = sim_rig_finish(s, &met) && good;
    }
    tear_down(s);
    if (!good)
        return CLI_BAD_INPUT;
    return met ? CLI_OK : CLI_EXPECTATION;
}
