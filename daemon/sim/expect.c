/* SPDX-License-Identifier: MIT
 *
 * expect.c - judges a run by the expectations of its configuration.
 */
#include "sim/expect.h"

#include "base/text/memo.h"
#include "base/text/number.h"
#include "trace/frametext.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

/* The percentiles in the order of cfg_percentile. */
static const unsigned percents[CFG_PERCENTILES] = {50, 90, 95, 99};

/* The times from a trigger to the start of its frame, in ticks. */
typedef struct spread {
    bool used;
    uint64_t least;
    uint64_t most;
} spread;

/* The findings about one expectation: by node where each node counts on its own, else all at index
 * 0. */
typedef struct tally {
    uint64_t count[CW_NODES_MAX];
    uint64_t first[CW_NODES_MAX];     /* tick, when count is not 0 */
    uint64_t last[CW_NODES_MAX];      /* GAP: tick of the last frame, or of the start */
    uint64_t total;                   /* DELAY: frames */
    uint64_t worst;                   /* ... the longest delay in ticks; GAP: the longest gap */
    uint64_t worst_at;                /* ... tick of its end */
    uint64_t beyond[CFG_PERCENTILES]; /* ... frames that took longer than the limit */
    spread *spreads;                  /* JITTER: of each trigger, see spread_of() */
    cw_bus_stats start;               /* of the bus, when it began */
    bool decided;                     /* it has failed, or its window is over; see expect_watch() */
} tally;

struct expect {
    const cfg *config;
    expect_failed *failed; /* NULL: nobody is told while the bus runs */
    void *user;
    uint64_t due; /* before that tick no expectation fails because of the time alone */
    size_t count;
    tally tallies[];
};

#define SPREADS (CW_NODES_MAX * (CW_TRIGGERS_MAX + 1))

/* The first gap begins with the run, or with the window of the expectation. */
static void begin_tally(tally *t, const cfg_expect *e, const cw_bus_stats *start)
{
    const uint64_t begin =
        e->when.time_begin > start->ticks ? e->when.time_begin : start->ticks;
    t->start = *start;
    for (unsigned i = 0; i < CW_NODES_MAX; i++)
        t->last[i] = begin;
}

expect *expect_start(const cfg *config, const cw_bus_stats *start)
{
    expect *x = calloc(1, sizeof *x + config->expect_count * sizeof x->tallies[0]);
    if (!x)
        return NULL;
    x->config = config;
    x->count = config->expect_count;
    for (size_t i = 0; i < x->count; i++) {
        begin_tally(&x->tallies[i], &config->expects[i], start);
        if (config->expects[i].kind != CFG_EXPECT_JITTER)
            continue;
        x->tallies[i].spreads = calloc(SPREADS, sizeof(spread));
        if (!x->tallies[i].spreads) {
            expect_free(x);
            return NULL;
        }
    }
    return x;
}

void expect_free(expect *x)
{
    for (size_t i = 0; x && i < x->count; i++)
        free(x->tallies[i].spreads);
    free(x);
}

/* ---- Events ---------------------------------------------------------------------------------- */

static bool is_counted_by_node(const cfg_expect *e)
{
    return e->to || e->node;
}

/* Frames with fewer bytes do not match. Bytes behind those of the condition do not matter. */
static bool matches_data(const cw_rule *when, const cw_frame *frame)
{
    if (cw_frame_length(frame) < when->data_length)
        return false;
    for (unsigned i = 0; i < when->data_length; i++)
        if ((frame->data[i] & when->data_mask[i]) != when->data_value[i])
            return false;
    return true;
}

static bool matches_rate(cw_phase_rate rate, bool data)
{
    return rate == CW_RATE_ANY || (rate == CW_RATE_DATA) == data;
}

static bool matches_frame(const cw_rule *when, const cw_frame *frame)
{
    const unsigned fast = CW_FRAME_FD | CW_FRAME_BRS;
    return matches_rate(when->rate, (frame->flags & fast) == fast) &&
           cw_frame_matches(frame, when->filters, when->filter_count) && matches_data(when, frame);
}

/* Returns true for a delivery: at the named receivers, otherwise at the sender when it is done. */
static bool is_delivery(const cfg_expect *e, const cw_event *event)
{
    return event->kind == (e->to ? CW_EVENT_RX : CW_EVENT_TX) &&
           (e->when.from == 0 || (e->when.from & event->from)) &&
           matches_frame(&e->when, &event->frame);
}

/* Returns true when a frame was sent, or was to be sent, in one of the windows. */
static bool matches_window(const cfg *config, const cfg_expect *e, const cw_event *event)
{
    if (e->windows == 0)
        return true;
    if (event->trigger == 0 || event->nodes == 0)
        return false;
    const cfg_schedule *s = &config->nodes[__builtin_ctzll(event->nodes)].schedule;
    if (event->trigger > s->trigger_count)
        return false;
    return e->windows & (s->arbitrating[event->trigger - 1] ? CFG_WINDOW_ARBITRATING
                                                            : CFG_WINDOW_EXCLUSIVE);
}

/* Returns the name of the rule that has hit; "" when somebody has cleared it. */
static const char *rule_name(const cfg *config, const cw_event *event)
{
    const char *name =
        event->rule < config->rule_count ? config->rules[event->rule].name : NULL;
    return name ? name : "";
}

/* Returns true when an expectation is about this event, whichever node it concerns. */
static bool is_about(const cfg *config, const cfg_expect *e, const cw_event *event)
{
    switch (e->kind) {
    case CFG_EXPECT_DELIVERED:
    case CFG_EXPECT_DELAY:
    case CFG_EXPECT_SEEN:
    case CFG_EXPECT_GAP:
        return is_delivery(e, event);
    case CFG_EXPECT_STATE:
        return event->kind == CW_EVENT_STATE && (e->states >> event->state & 1u);
    case CFG_EXPECT_ERRORS:
        return event->kind == CW_EVENT_ERROR && matches_rate(e->when.rate, event->fast) &&
               (e->types == 0 || (e->types >> event->error.type & 1u));
    case CFG_EXPECT_DROPS:
        return event->kind == CW_EVENT_DROP && (e->why == 0 || (e->why >> event->why & 1u)) &&
               matches_frame(&e->when, &event->frame) && matches_window(config, e, event);
    case CFG_EXPECT_RESTARTS:
        return event->kind == CW_EVENT_RESTART;
    case CFG_EXPECT_OVERLOADS:
        return event->kind == CW_EVENT_OVERLOAD;
    case CFG_EXPECT_EXCEPTIONS:
        return event->kind == CW_EVENT_EXCEPTION;
    case CFG_EXPECT_ARBITRATION_LOST:
        return event->kind == CW_EVENT_ARBITRATION_LOST &&
               matches_frame(&e->when, &event->frame) && matches_window(config, e, event);
    case CFG_EXPECT_JITTER:
        return event->kind == CW_EVENT_TX && event->trigger && is_delivery(e, event) &&
               matches_window(config, e, event);
    case CFG_EXPECT_FAULTS:
        return event->kind == CW_EVENT_FAULT &&
               (!e->rule || strcmp(e->rule, rule_name(config, event)) == 0);
    case CFG_EXPECT_LOAD:
    case CFG_EXPECT_COUNT:
        break;
    }
    return false;
}

static void sim_expect_count(tally *t, unsigned place, uint64_t tick)
{
    if (t->count[place]++ == 0)
        t->first[place] = tick;
}

/* The sender of a frame may have left the bus before its end: then nobody knows the delay. */
static void note_delay(tally *t, const cfg_expect *e, const cw_event *event)
{
    if (event->handed_in == CW_NEVER)
        return;
    const uint64_t delay = event->tick - event->handed_in;
    t->total++;
    if (delay > t->worst) {
        t->worst = delay;
        t->worst_at = event->tick;
    }
    for (unsigned i = 0; i < CFG_PERCENTILES; i++)
        t->beyond[i] += delay > e->percentile[i];
}

/* Notes the longest time between two frames, and the tick of its end. */
static void note_gap(tally *t, unsigned place, uint64_t tick)
{
    const uint64_t gap = tick - t->last[place];
    t->last[place] = tick;
    if (gap <= t->worst)
        return;
    t->worst = gap;
    t->worst_at = tick;
}

/* Returns the spread of the trigger that has sent a frame. */
static spread *spread_of(const tally *t, const cw_event *event)
{
    const unsigned node = (unsigned)__builtin_ctzll(event->nodes);
    return &t->spreads[node * (CW_TRIGGERS_MAX + 1) + event->trigger];
}

/* Notes how late a frame begins after its trigger. The jitter is that of one trigger, not of
 * all. */
static void note_begin(tally *t, const cw_event *event)
{
    spread *s = spread_of(t, event);
    if (!s->used || event->late < s->least)
        s->least = event->late;
    if (!s->used || event->late > s->most)
        s->most = event->late;
    s->used = true;
    t->total++;
    if (s->most - s->least > t->worst) {
        t->worst = s->most - s->least;
        t->worst_at = event->tick;
    }
}

/* Counts an event, at each node where these count on their own. */
static void note_event(tally *t, const cfg_expect *e, const cw_event *event)
{
    if (e->kind == CFG_EXPECT_JITTER) {
        note_begin(t, event);
        return;
    }

    const uint64_t places = is_counted_by_node(e) ? event->nodes & (e->to | e->node) : 1u;
    for (uint64_t rest = places; rest; rest &= rest - 1) {
        const unsigned place = (unsigned)__builtin_ctzll(rest);
        sim_expect_count(t, place, event->tick);
        if (e->kind == CFG_EXPECT_DELAY)
            note_delay(t, e, event);
        else if (e->kind == CFG_EXPECT_GAP)
            note_gap(t, place, event->tick);
    }
}

/* ---- Expectations as text -------------------------------------------------------------------- */

static void write_span(FILE *out, const char *before, uint64_t ticks)
{
    char text[TIME_TEXT_MAX];
    text_print_span(text, ticks);
    fprintf(out, "%s%s", before, text);
}

/* Writes names with commas between them; nothing for an empty set. */
static void write_nodes(FILE *out, const cfg *config, const char *before, uint64_t nodes)
{
    for (uint64_t rest = nodes; rest; rest &= rest - 1) {
        fprintf(out, "%s%s", before, config->nodes[__builtin_ctzll(rest)].name);
        before = ", ";
    }
}

/* Writes the limits; returns the last number. */
static uint64_t write_limits(FILE *out, const cfg_expect *e)
{
    if (e->min == e->max)
        fprintf(out, "%" PRIu64, e->min);
    else if (e->max == UINT64_MAX)
        fprintf(out, "at least %" PRIu64, e->min);
    else if (e->min == 0)
        fprintf(out, "at most %" PRIu64, e->max);
    else
        fprintf(out, "%" PRIu64 " to %" PRIu64, e->min, e->max);
    return e->max == UINT64_MAX ? e->min : e->max;
}

/* Writes identifiers and data as the configuration has them, with '.' for open digits. */
static void write_filters(FILE *out, const cw_rule *when)
{
    for (unsigned i = 0; i < when->filter_count; i++) {
        char text[FILTER_TEXT_MAX];
        text_print_filter(text, &when->filters[i]);
        fprintf(out, "%s%s", i == 0 ? " " : ",", text);
    }
    if (when->data_length > 0)
        fputs(" with data ", out);
    for (unsigned i = 0; i < when->data_length; i++)
        for (unsigned shift = 8; shift > 0; shift -= 4)
            fputc((when->data_mask[i] >> (shift - 4) & 15u)
                      ? "0123456789ABCDEF"[when->data_value[i] >> (shift - 4) & 15u]
                      : '.',
                  out);
}

static void write_where(FILE *out, const cfg *config, const cfg_expect *e)
{
    write_nodes(out, config, " from ", e->when.from);
    write_nodes(out, config, " to ", e->to);
    write_nodes(out, config, " at ", e->node);
}

/* A window may lack a begin, an end or both. */
static void write_window(FILE *out, const cw_rule *when)
{
    if (when->time_begin > 0)
        write_span(out, " from ", when->time_begin);
    if (when->time_end != CW_NEVER)
        write_span(out, when->time_begin > 0 ? " to " : " before ", when->time_end);
}

/* Writes the words of a set, in brackets. */
static void write_words(FILE *out, uint32_t set, unsigned size, const char *(*name)(unsigned))
{
    const char *before = " (";
    for (unsigned i = 0; i < size; i++) {
        if (!(set >> i & 1u))
            continue;
        fprintf(out, "%s%s", before, name(i));
        before = ", ";
    }
    if (set)
        fputc(')', out);
}

static const char *type_name(unsigned type)
{
    return cw_error_type_name((cw_error_type)type);
}

static const char *why_name(unsigned why)
{
    return cw_drop_name((cw_drop)why);
}

/* Writes the limit of all frames and of each percentile that is given. */
static void write_delay_limits(FILE *out, const cfg_expect *e)
{
    const char *before = "";
    if (e->delay_max != CW_NEVER) {
        write_span(out, "at most ", e->delay_max);
        before = ", ";
    }
    for (unsigned i = 0; i < CFG_PERCENTILES; i++) {
        if (e->percentile[i] == CW_NEVER)
            continue;
        fprintf(out, "%s%u %% within", before, percents[i]);
        write_span(out, " ", e->percentile[i]);
        before = ", ";
    }
}

/* Any of the states counts. */
static void write_states(FILE *out, const cfg_expect *e)
{
    const char *before = "";
    for (unsigned i = 0; i < CW_STATE_COUNT; i++) {
        if (!(e->states >> i & 1u))
            continue;
        fprintf(out, "%s%s", before, cw_state_name((cw_state)i));
        before = " or ";
    }
    fputs(e->never ? " never reached" : " reached", out);
}

static void write_permille(FILE *out, uint64_t permille)
{
    fprintf(out, "%" PRIu64 ".%" PRIu64 " %%", permille / 10, permille % 10);
}

/* Limits that are not given are 0 and 100 %. */
static void write_load_limits(FILE *out, const cfg_expect *e)
{
    fputs("a load of ", out);
    write_permille(out, e->min);
    fputs(" to ", out);
    write_permille(out, e->max);
}

/* Writes a number of events, with their word as the number needs it. */
static void write_counted(FILE *out, const cfg_expect *e)
{
    static const char *const names[CFG_EXPECT_COUNT][2] = {
        [CFG_EXPECT_ERRORS] = {"error", "errors"},
        [CFG_EXPECT_DROPS] = {"frame dropped", "frames dropped"},
        [CFG_EXPECT_RESTARTS] = {"restart", "restarts"},
        [CFG_EXPECT_OVERLOADS] = {"overload flag", "overload flags"},
        [CFG_EXPECT_EXCEPTIONS] = {"protocol exception", "protocol exceptions"},
        [CFG_EXPECT_FAULTS] = {"hit", "hits"},
        [CFG_EXPECT_ARBITRATION_LOST] = {"lost arbitration", "lost arbitrations"},
        [CFG_EXPECT_DELIVERED] = {"frame", "frames"},
    };
    uint64_t number = write_limits(out, e);
    fprintf(out, " %s", names[e->kind][number != 1]);
}

/* Writes what is expected; conditions follow it. */
static void write_subject(FILE *out, const cfg_expect *e)
{
    switch (e->kind) {
    case CFG_EXPECT_DELAY:
        fputs("delays of ", out);
        write_delay_limits(out, e);
        fputs(" for frames", out);
        break;
    case CFG_EXPECT_JITTER:
        write_span(out, "a jitter of at most ", e->delay_max);
        fputs(" for frames of triggers", out);
        break;
    case CFG_EXPECT_GAP:
        write_span(out, "gaps of at most ", e->delay_max);
        fputs(" between frames", out);
        break;
    case CFG_EXPECT_SEEN:
        fputs(e->never ? "no frame" : "a frame", out);
        break;
    case CFG_EXPECT_STATE:
        write_states(out, e);
        break;
    case CFG_EXPECT_LOAD:
        write_load_limits(out, e);
        break;
    case CFG_EXPECT_DELIVERED:
    case CFG_EXPECT_ERRORS:
    case CFG_EXPECT_DROPS:
    case CFG_EXPECT_RESTARTS:
    case CFG_EXPECT_OVERLOADS:
    case CFG_EXPECT_EXCEPTIONS:
    case CFG_EXPECT_ARBITRATION_LOST:
    case CFG_EXPECT_FAULTS:
    case CFG_EXPECT_COUNT:
        write_counted(out, e);
        break;
    }
}

/* Writes an expectation in words, which is its name when it has none. */
static void write_wanted(FILE *out, const cfg *config, const cfg_expect *e)
{
    static const char *const windows[] = {
        "", " in exclusive windows", " in arbitrating windows", " in windows",
    };
    write_subject(out, e);
    write_filters(out, &e->when);
    write_words(out, e->types, CW_ERROR_COUNT, type_name);
    write_words(out, e->why, CW_DROP_COUNT, why_name);
    if (e->windows)
        fputs(windows[e->windows], out);
    if (e->rule)
        fprintf(out, " of %s", e->rule);
    if (e->when.rate != CW_RATE_ANY)
        fprintf(out, " at the %s rate", e->when.rate == CW_RATE_DATA ? "data" : "nominal");
    write_where(out, config, e);
    write_window(out, &e->when);
}

/* ---- Results --------------------------------------------------------------------------------- */

/* Judges one place of a tally. */
static bool is_met_at(const cfg_expect *e, const tally *t, unsigned place)
{
    if (e->kind == CFG_EXPECT_SEEN || e->kind == CFG_EXPECT_STATE)
        return (t->count[place] == 0) == e->never;
    return t->count[place] >= e->min && t->count[place] <= e->max;
}

/* Writes what there was: how many, or when first. */
static void write_found(FILE *out, const cfg_expect *e, const tally *t, unsigned place)
{
    bool moment = e->kind == CFG_EXPECT_SEEN || e->kind == CFG_EXPECT_STATE;
    if (!moment)
        fprintf(out, "%" PRIu64, t->count[place]);
    else if (t->count[place] == 0)
        fputs(e->kind == CFG_EXPECT_SEEN ? "none" : "never", out);
    else
        write_span(out, e->kind == CFG_EXPECT_SEEN ? "one at " : "at ", t->first[place]);
}

/* Each node that counts on its own must meet the limits. */
static bool judge_counts(FILE *out, const cfg *config, const cfg_expect *e, const tally *t)
{
    const uint64_t nodes = is_counted_by_node(e) ? e->to | e->node : 1u;
    const bool several = (nodes & (nodes - 1)) != 0;
    const char *before = "";
    bool met = true;
    for (uint64_t rest = nodes; rest; rest &= rest - 1) {
        unsigned i = (unsigned)__builtin_ctzll(rest);
        met = is_met_at(e, t, i) && met;
        if (several)
            fprintf(out, "%s%s: ", before, config->nodes[i].name);
        write_found(out, e, t, i);
        before = ", ";
    }
    return met;
}

/* Writes a share, rounded down. */
static void write_share(FILE *out, uint64_t part, uint64_t all, uint64_t limit)
{
    uint64_t permille = part * 1000 / all;
    fputs(", ", out);
    write_permille(out, permille);
    write_span(out, " within ", limit);
}

/* Without a frame nothing is met: a delay that never was proves nothing. */
static bool judge_delays(FILE *out, const cfg_expect *e, const tally *t)
{
    bool met = t->worst <= e->delay_max;
    if (t->total == 0) {
        fputs("no frame", out);
        return false;
    }
    write_span(out, "at most ", t->worst);
    write_span(out, " (at ", t->worst_at);
    fputc(')', out);
    for (unsigned i = 0; i < CFG_PERCENTILES; i++) {
        if (e->percentile[i] == CW_NEVER)
            continue;
        write_share(out, t->total - t->beyond[i], t->total, e->percentile[i]);
        met = met && t->beyond[i] * 100 <= t->total * (100 - percents[i]);
    }
    fprintf(out, ", of %" PRIu64, t->total);
    return met;
}

/* Without a frame nothing is met, either. */
static bool judge_jitter(FILE *out, const cfg_expect *e, const tally *t)
{
    if (t->total == 0) {
        fputs("no frame", out);
        return false;
    }
    write_span(out, "at most ", t->worst);
    write_span(out, " (at ", t->worst_at);
    fprintf(out, "), of %" PRIu64, t->total);
    return t->worst <= e->delay_max;
}

/* The time from the last frame to the end is a gap, too. */
static bool judge_gaps(FILE *out, const cfg_expect *e, const tally *t, const cw_bus_stats *bus)
{
    const uint64_t end = e->when.time_end < bus->ticks ? e->when.time_end : bus->ticks;
    uint64_t worst = t->worst, worst_at = t->worst_at;
    for (uint64_t rest = e->to ? e->to : 1u; rest; rest &= rest - 1) {
        const uint64_t gap = end - t->last[__builtin_ctzll(rest)];
        if (gap > worst) {
            worst = gap;
            worst_at = end;
        }
    }
    write_span(out, "at most ", worst);
    write_span(out, " (up to ", worst_at);
    fputc(')', out);
    return worst <= e->delay_max;
}

static bool judge_load(FILE *out, const cfg_expect *e, const cw_bus_stats *start,
                       const cw_bus_stats *bus)
{
    uint64_t permille = cw_load_permille(start, bus);
    write_permille(out, permille);
    return permille >= e->min && permille <= e->max;
}

/* Writes what there was, and returns true when that is good. A window that the run has not seen is
 * not met. */
static bool expect_judge(FILE *out, const expect *x, size_t i, const cw_bus_stats *bus)
{
    const cfg_expect *e = &x->config->expects[i];
    const tally *t = &x->tallies[i];
    if (e->when.time_begin > bus->ticks) {
        write_span(out, "nothing: the run ended at ", bus->ticks);
        return false;
    }
    if (e->when.time_end <= t->start.ticks) {
        write_span(out, "nothing: it is judged from ", t->start.ticks);
        return false;
    }
    if (e->kind == CFG_EXPECT_DELAY)
        return judge_delays(out, e, t);
    if (e->kind == CFG_EXPECT_JITTER)
        return judge_jitter(out, e, t);
    if (e->kind == CFG_EXPECT_GAP)
        return judge_gaps(out, e, t, bus);
    if (e->kind == CFG_EXPECT_LOAD)
        return judge_load(out, e, &t->start, bus);
    return judge_counts(out, x->config, e, t);
}

bool expect_look(const expect *x, size_t i, const cw_bus_stats *bus, expect_outcome *out)
{
    const cfg_expect *e = &x->config->expects[i];
    const uint64_t start = x->tallies[i].start.ticks;
    const uint64_t begin = e->when.time_begin > start ? e->when.time_begin : start;
    const uint64_t end = e->when.time_end < bus->ticks ? e->when.time_end : bus->ticks;
    memo wanted, got;
    *out = (expect_outcome){.name = e->name ? strdup(e->name) : NULL};
    if (memo_begin(&wanted))
        write_wanted(wanted.out, x->config, e);
    if (memo_begin(&got))
        out->met = expect_judge(got.out, x, i, bus);
    out->wanted = memo_take(&wanted);
    out->got = memo_take(&got);
    out->ticks = end > begin ? end - begin : 0;
    return out->wanted && out->got && (!e->name || out->name);
}

bool expect_conclude(expect *x, expect_report *report, const cw_bus *bus)
{
    cw_bus_stats stats;
    cw_bus_get_stats(bus, &stats);
    for (size_t i = 0; i < x->count; i++) {
        expect_outcome o;
        const bool good = expect_look(x, i, &stats, &o);
        if (!expect_report_add(report, o) || !good)
            return false;
    }
    return true;
}

/* ---- While the bus runs ---------------------------------------------------------------------- */

/* Returns true when nothing that is still to come can make it met. */
static bool is_lost(const cfg_expect *e, const tally *t)
{
    if (e->kind == CFG_EXPECT_DELAY || e->kind == CFG_EXPECT_JITTER || e->kind == CFG_EXPECT_GAP)
        return t->worst > e->delay_max;
    const bool moment = e->kind == CFG_EXPECT_SEEN || e->kind == CFG_EXPECT_STATE;
    const uint64_t most = moment ? (e->never ? 0 : UINT64_MAX) : e->max;
    for (uint64_t rest = is_counted_by_node(e) ? e->to | e->node : 1u; rest; rest &= rest - 1)
        if (t->count[__builtin_ctzll(rest)] > most)
            return true;
    return false;
}

/* Writes an event in the words of its JSON: "error crc at dash". */
static void write_event(FILE *out, const cfg *config, const cfg_expect *e, const cw_event *event)
{
    const uint64_t named = e->to | e->node;
    char frame[FRAME_TEXT_MAX];
    fputs(cw_event_name(event->kind), out);
    if (event->kind == CW_EVENT_STATE)
        fprintf(out, " %s", cw_state_name((cw_state)event->state));
    if (event->kind == CW_EVENT_ERROR)
        fprintf(out, " %s", type_name(event->error.type));
    if (event->kind == CW_EVENT_FAULT)
        fprintf(out, " %s", rule_name(config, event));
    if (event->kind == CW_EVENT_TX || event->kind == CW_EVENT_RX ||
        event->kind == CW_EVENT_DROP || event->kind == CW_EVENT_ARBITRATION_LOST) {
        text_print_frame(frame, &event->frame);
        fprintf(out, " %s", frame);
    }
    if (event->kind == CW_EVENT_DROP)
        fprintf(out, " (%s)", why_name(event->why));
    write_nodes(out, config, " at ", is_counted_by_node(e) ? event->nodes & named : event->nodes);
}

/* Tells that an expectation has failed at this tick: because of an event, or of the time alone. */
static void fail(expect *x, size_t i, uint64_t tick, const cw_event *event)
{
    const cfg_expect *e = &x->config->expects[i];
    tally *t = &x->tallies[i];
    const cw_bus_stats then = {.ticks = tick};
    const bool silence =
        !event && e->kind == CFG_EXPECT_GAP && e->when.time_end > t->start.ticks;
    memo got, what;
    if (memo_begin(&got)) {
        if (silence)
            write_span(got.out, "none since ", tick - e->delay_max);
        else
            (void)expect_judge(got.out, x, i, &then);
    }
    if (memo_begin(&what) && event)
        write_event(what.out, x->config, e, event);
    t->decided = true;
    x->failed(x->user, &(expect_failure){.index = i, .tick = tick, .got = memo_text(&got),
                                         .event = memo_text(&what)});
    memo_end(&got);
    memo_end(&what);
}

/* Returns the tick after which an expectation may fail because of the time alone. */
static uint64_t deadline(const cfg_expect *e, const tally *t)
{
    uint64_t end = e->when.time_end;
    if (end <= t->start.ticks)
        return t->start.ticks; /* it was over before it was judged */
    if (e->kind != CFG_EXPECT_GAP)
        return end;
    for (uint64_t rest = e->to ? e->to : 1u; rest; rest &= rest - 1) {
        const uint64_t last = t->last[__builtin_ctzll(rest)];
        if (last < end && e->delay_max < end - last)
            end = last + e->delay_max;
    }
    return end;
}

/* Decides an expectation whose deadline has passed. */
static void decide(expect *x, size_t i, uint64_t at)
{
    const cw_bus_stats then = {.ticks = at + 1};
    memo unread;
    const bool met = memo_begin(&unread) && expect_judge(unread.out, x, i, &then);
    memo_end(&unread);
    x->tallies[i].decided = true;
    if (!met)
        fail(x, i, at, NULL);
}

void expect_pass(expect *x, uint64_t tick)
{
    x->due = CW_NEVER;
    for (size_t i = 0; i < x->count && x->failed; i++) {
        if (x->tallies[i].decided)
            continue;
        const uint64_t at = deadline(&x->config->expects[i], &x->tallies[i]);
        if (at < tick)
            decide(x, i, at);
        else if (at < x->due)
            x->due = at;
    }
}

void expect_event(expect *x, const cw_event *event)
{
    if (x->failed && event->tick > x->due)
        expect_pass(x, event->tick);
    for (size_t i = 0; i < x->count; i++) {
        const cfg_expect *e = &x->config->expects[i];
        tally *t = &x->tallies[i];
        if (event->tick < e->when.time_begin || event->tick >= e->when.time_end ||
            !is_about(x->config, e, event))
            continue;
        note_event(t, e, event);
        if (x->failed && !t->decided && is_lost(e, t))
            fail(x, i, event->tick, event);
    }
}

void expect_watch(expect *x, expect_failed *failed, void *user)
{
    x->failed = failed;
    x->user = user;
}

void expect_adopt(expect *x, size_t i, const expect *old, size_t k,
                  const uint8_t from[CW_NODES_MAX])
{
    const bool by_node = is_counted_by_node(&x->config->expects[i]);
    const tally *was = &old->tallies[k], fresh = x->tallies[i];
    tally *t = &x->tallies[i];
    *t = *was;
    t->spreads = fresh.spreads;
    for (unsigned n = 0; n < CW_NODES_MAX; n++) {
        const unsigned other = by_node ? from[n] : n;
        const bool known = other < CW_NODES_MAX;
        t->count[n] = known ? was->count[other] : 0;
        t->first[n] = known ? was->first[other] : 0;
        t->last[n] = known ? was->last[other] : fresh.last[n];
    }
    for (unsigned n = 0; t->spreads && n < CW_NODES_MAX; n++)
        if (from[n] < CW_NODES_MAX)
            memcpy(&t->spreads[n * (CW_TRIGGERS_MAX + 1)],
                   &was->spreads[from[n] * (CW_TRIGGERS_MAX + 1)],
                   (CW_TRIGGERS_MAX + 1) * sizeof(spread));
    x->due = 0;
}
