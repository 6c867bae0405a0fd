/* SPDX-License-Identifier: MIT
 *
 * sim_rig.c - runs the buses of a rig in one virtual time, with the gateways between them.
 *
 * All buses go to the first tick at which any node may receive a frame. There the gateways get the
 * events of all of them, in order, so that no frame comes to a bus that is already beyond it.
 */
#include "cli/sim/sim_rig.h"

#include "base/jsonput.h"
#include "base/plain.h"
#include "cli/cli.h"
#include "cli/sim/summary.h"
#include "config/files.h"
#include "record/output.h"
#include "run/gateways.h"

#include <stdlib.h>
#include <string.h>

#define QUIET_LIMIT_S 10u /* of bus time without a tx or a release, as for one bus */

/* An event that waits for those of other buses. */
typedef struct kept {
    size_t bus;
    size_t number; /* keeps the order of events of one bus */
    bool passed;   /* the gateways have had it */
    cw_event event;
} kept;

typedef struct sim_rig sim_rig;

typedef struct rig_bus {
    sim_rig *all;
    size_t index;
    sim_run run;
    sim_judge judge;
} rig_bus;

struct sim_rig {
    const sim_rig_options *options;
    rig *config;
    gateways *gateways;
    rig_bus buses[RIG_BUSES_MAX];
    cw_bus *bus_of[RIG_BUSES_MAX];
    size_t bus_count; /* opened */
    outfile events;
    outfile log;
    outfile stats;
    outfile no_junit;
    kept *list; /* events since the last look */
    size_t count;
    size_t room;
    bool no_memory;
};

/* ---- Events ---------------------------------------------------------------------------------- */

static bool has_frame(cw_event_kind kind)
{
    return kind == CW_EVENT_RX || kind == CW_EVENT_TX || kind == CW_EVENT_DROP ||
           kind == CW_EVENT_ARBITRATION_LOST || kind == CW_EVENT_OVERRUN ||
           kind == CW_EVENT_IMPROPER;
}

/* Copies what there is of an event in place. */
static void copy_event(cw_event *to, const cw_event *from)
{
    const cw_frame *frame = &from->frame;
    *to = (cw_event){.tick = 0};
    memcpy(to, from, offsetof(cw_event, frame));
    if (!has_frame(from->kind))
        return;
    const unsigned length = frame->flags & CW_FRAME_CUT ? 8 : cw_frame_length(frame);
    memcpy(&to->frame, frame, offsetof(cw_frame, data) + length);
}

static void keep_event(void *user, const cw_event *event)
{
    const rig_bus *b = user;
    sim_rig *s = b->all;
    if (s->count == s->room) {
        const size_t room = s->room > 0 ? 2 * s->room : 256;
        kept *list = realloc(s->list, room * sizeof *list);
        s->no_memory = s->no_memory || !list;
        if (!list)
            return;
        s->list = list;
        s->room = room;
    }
    s->list[s->count] = (kept){.bus = b->index, .number = s->count};
    copy_event(&s->list[s->count++].event, event);
}

static int compare_numbers(uint64_t a, uint64_t b)
{
    return (a > b) - (a < b);
}

static int compare_kept(const void *left, const void *right)
{
    const kept *a = left;
    const kept *b = right;
    int order = compare_numbers(a->event.tick, b->event.tick);
    if (order == 0)
        order = compare_numbers(a->bus, b->bus);
    return order != 0 ? order : compare_numbers(a->number, b->number);
}

static void write_event(sim_rig *s, const kept *k)
{
    const cfg *config = s->config->buses[k->bus];
    if (s->events.stream)
        output_event_of_bus(s->events.stream, config, &k->event);
    if (s->log.stream)
        output_log(s->log.stream, config, &k->event);
}

/* Gives the gateways all new events, and writes those before a tick that all buses have reached.
 * Until then a bus in the middle of a longer bit may have earlier ones. At that tick itself frames
 * may still come in, and be dropped. */
static void take_events(sim_rig *s, uint64_t tick)
{
    size_t written = 0;
    if (s->count > 1)
        qsort(s->list, s->count, sizeof *s->list, compare_kept);
    for (size_t i = 0; i < s->count; i++) {
        if (!s->list[i].passed)
            gateways_event(s->gateways, s->bus_of, s->list[i].bus, &s->list[i].event);
        s->list[i].passed = true;
    }
    for (; written < s->count && s->list[written].event.tick < tick; written++)
        write_event(s, &s->list[written]);
    if (written > 0)
        memmove(s->list, s->list + written, (s->count - written) * sizeof *s->list);
    s->count -= written;
    for (size_t i = 0; i < s->count; i++)
        s->list[i].number = i;
}

/* ---- The run --------------------------------------------------------------------------------- */

static uint64_t least(uint64_t a, uint64_t b)
{
    return a < b ? a : b;
}

static uint64_t until_of(const sim_rig *s)
{
    return s->bus_count > 0 ? s->buses[0].run.until : 0;
}

/* Returns the tick at which all buses meet next. */
static uint64_t next_meeting(const sim_rig *s)
{
    uint64_t next = CW_NEVER;
    uint64_t bits = 0; /* each bus goes on by one bit while all of them rest */
    for (size_t i = 0; i < s->bus_count; i++) {
        const uint64_t bit = cw_bus_tick_after(s->bus_of[i], 1);
        next = least(next, sim_next(&s->buses[i].run));
        bits = bit > bits ? bit : bits;
    }
    return least(next == CW_NEVER && until_of(s) == CW_NEVER ? bits : next, until_of(s));
}

static void go_to(sim_rig *s, uint64_t tick)
{
    uint64_t reached = tick;
    for (size_t i = 0; i < s->bus_count; i++)
        sim_release_to(&s->buses[i].run, tick);
    for (size_t i = 0; i < s->bus_count; i++)
        reached = least(reached, cw_bus_now(s->bus_of[i]));
    take_events(s, reached == CW_NEVER ? tick : reached);
}

static bool traffic_is_over(const sim_rig *s)
{
    bool over = true;
    for (size_t i = 0; i < s->bus_count; i++)
        over = over && sim_traffic_is_over(&s->buses[i].run);
    return over;
}

static bool is_quiet(const sim_rig *s, uint64_t tick)
{
    uint64_t last = 0;
    for (size_t i = 0; i < s->bus_count; i++)
        if (s->buses[i].run.last_activity > last)
            last = s->buses[i].run.last_activity;
    return tick != CW_NEVER && tick > last + (uint64_t)QUIET_LIMIT_S * CW_CLOCK_HZ;
}

static bool has_failed(const sim_rig *s)
{
    bool failed = s->no_memory;
    for (size_t i = 0; i < s->bus_count; i++)
        failed = failed || release_failed(s->buses[i].run.plan);
    return failed;
}

static void run(sim_rig *s)
{
    const uint64_t until = until_of(s);
    for (size_t i = 0; i < s->bus_count; i++)
        sim_begin(&s->buses[i].run);
    while (!has_failed(s) && (until != CW_NEVER || !traffic_is_over(s))) {
        const uint64_t tick = next_meeting(s);
        if (until == CW_NEVER && is_quiet(s, tick)) {
            plain_print(stderr,
                        "canwire sim: ended after %u s of bus time without a frame (--until TIME "
                        "waits longer)\n", QUIET_LIMIT_S);
            break;
        }
        go_to(s, tick);
        if (tick == until)
            break;
    }
    for (size_t i = 0; i < s->bus_count && until != CW_NEVER && !has_failed(s); i++)
        (void)sim_advance(&s->buses[i].run, CW_NEVER); /* ends bits that have begun */
    take_events(s, CW_NEVER);
}

/* ---- Set-up ---------------------------------------------------------------------------------- */

static bool fail(const char *why)
{
    plain_print(stderr, "canwire sim: %s\n", why);
    return false;
}

static bool check_end(const sim_rig *s, const cfg *config)
{
    if (s->options->has_until)
        return true;
    for (size_t i = 0; i < config->node_count; i++)
        for (size_t t = 0; t < config->nodes[i].traffic_count; t++) {
            const cfg_traffic *traffic = &config->nodes[i].traffic[t];
            if (!cfg_traffic_is_endless(traffic))
                continue;
            plain_print(stderr,
                        "%s:%d:%d: traffic without `count` never ends: give `count` or --until "
                        "TIME\n", config->file, traffic->place.line, traffic->place.column);
            return false;
        }
    return true;
}

static bool open_bus(sim_rig *s, size_t i)
{
    rig_bus *b = &s->buses[i];
    cfg *config = s->config->buses[i];
    const sim_sink keeper = {.user = b, .event = keep_event};
    *b = (rig_bus){.all = s, .index = i};
    fputs(config->warnings, stderr);
    if (s->options->has_seed)
        config->seed = s->options->seed;
    s->bus_count++;
    if (!sim_open(&b->run, config, false))
        return fail("out of memory");
    s->bus_of[i] = b->run.bus;
    b->run.step = s->options->step;
    if (s->options->has_until) /* the last tick whose time in events is not after TIME */
        b->run.until = text_time_ticks_sum(s->options->until, 1, (cfg_time){.ns = 1},
                                           config->rate) - 1;
    b->judge.junit = &s->no_junit;
    b->judge.to_stderr = s->options->events || s->options->log || s->options->stats;
    sim_add_sink(&b->run, &keeper);
    return check_end(s, config) && sim_judge_start(&b->judge, &b->run, false);
}

/* No output may be an input or another output. */
static bool check_files(const sim_rig *s)
{
    const struct { const char *what, *path; } outputs[] = {
        {"--events", s->options->events},
        {"--log", s->options->log},
        {"--stats", s->options->stats},
    };
    fileuses all = {.count = 0};
    fileuses_add(&all, &(fileuse){.what = "rig", .path = s->config->file});
    for (size_t i = 0; i < s->config->bus_count; i++)
        cfg_add_files_read(&all, s->config->buses[i]);
    for (size_t i = 0; i < sizeof outputs / sizeof *outputs; i++)
        if (outputs[i].path && strcmp(outputs[i].path, "-") != 0)
            fileuses_add(&all, &(fileuse){.what = outputs[i].what, .path = outputs[i].path,
                                          .written = true});
    const bool good = fileuses_check(&all, "canwire sim", stderr);
    fileuses_free(&all);
    return good;
}

static bool set_up(sim_rig *s)
{
    s->config = rig_load(s->options->file, stderr);
    if (!s->config)
        return false;
    s->gateways = gateways_new(s->config);
    if (!s->gateways)
        return fail("out of memory");
    for (size_t i = 0; i < s->config->bus_count; i++)
        if (!open_bus(s, i))
            return false;
    return check_files(s) && outfile_open(&s->events, s->options->events, "canwire sim") &&
           outfile_open(&s->log, s->options->log, "canwire sim") &&
           outfile_open(&s->stats, s->options->stats, "canwire sim");
}

static void write_stats(sim_rig *s)
{
    json_t *root = json_object();
    json_t *buses = json_array();
    for (size_t i = 0; i < s->bus_count; i++)
        put_last(buses, output_all_stats(s->config->buses[i], s->bus_of[i]));
    put(root, "buses", buses);
    put(root, "gateways", gateways_stats(s->gateways));
    put_out(s->stats.stream, root);
    json_decref(root);
}

/* Reports; *met tells about the expectations. */
static bool finish(sim_rig *s, bool *met)
{
    bool good = !has_failed(s);
    if (s->no_memory)
        good = fail("out of memory");
    if (outfile_begin(&s->stats))
        write_stats(s);
    for (size_t i = 0; i < s->bus_count; i++) {
        rig_bus *b = &s->buses[i];
        if (!b->judge.to_stderr)
            summary_print(stdout, s->config->buses[i], s->bus_of[i]);
        good = sim_judge_finish(&b->judge, &b->run) && good;
        *met = *met && b->judge.report.failed == 0;
    }
    good = outfile_close(&s->events, "canwire sim") && good;
    good = outfile_close(&s->log, "canwire sim") && good;
    return outfile_close(&s->stats, "canwire sim") && good;
}

static void tear_down(sim_rig *s)
{
    for (size_t i = 0; i < s->bus_count; i++) {
        sim_judge_close(&s->buses[i].judge);
        sim_close(&s->buses[i].run);
    }
    (void)outfile_close(&s->events, "canwire sim");
    (void)outfile_close(&s->log, "canwire sim");
    (void)outfile_close(&s->stats, "canwire sim");
    gateways_free(s->gateways);
    rig_free(s->config);
    free(s->list);
    free(s);
}

int sim_rig_main(const sim_rig_options *options)
{
    sim_rig *s = calloc(1, sizeof *s);
    bool met = true;
    if (!s) {
        (void)fail("out of memory");
        return CLI_BAD_INPUT;
    }
    s->options = options;
    bool good = set_up(s);
    if (good) {
        (void)outfile_begin(&s->events);
        (void)outfile_begin(&s->log);
        run(s);
        good = finish(s, &met);
    }
    tear_down(s);
    if (!good)
        return CLI_BAD_INPUT;
    return met ? CLI_OK : CLI_EXPECTATION;
}
