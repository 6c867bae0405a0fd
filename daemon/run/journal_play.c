/* SPDX-License-Identifier: MIT
 *
 * journal_play.c - repeats the run of a journal: the same inputs, the same events.
 *
 * The journal contains frames of traffic like all others, so the releases of the configuration are
 * not used here.
 */
#include "run/journal_play.h"

#include "base/text/number.h"
#include "base/text/memo.h"
#include "run/bus_make.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

typedef struct played {
    live *live;
    void *memory; /* of the bus */
    inputs inputs;
    void *user;
    bool stopped; /* by `advance` */
} played;

struct journal_player {
    const char *file; /* of the caller */
    journal_reader *reader;
    size_t count;
    played buses[RIG_BUSES_MAX];
    played *now; /* the bus of the entry */
    journal_calls calls;
    void *user;
    FILE *errors;
    bool differs; /* from the recorded run */
    journal_entry entry;
};

/* ---- Start and stop -------------------------------------------------------------------------- */

static bool journal_play_fail(journal_player *p, const char *key, const char *problem)
{
    journal_complain(p->reader, key, "%s", problem);
    return false;
}

/* Makes a bus of the entry. */
static bool make_bus(journal_player *p, played *b)
{
    cfg *config = cfg_load_given(p->entry.files, p->entry.file_count, p->errors);
    if (!config)
        return journal_play_fail(p, "config", "the configuration has errors");
    b->live = live_new(config);
    if (!b->live)
        cfg_free(config);
    cw_bus *bus = b->live ? bus_make(&b->memory, config) : NULL;
    if (!bus)
        return journal_play_fail(p, NULL, bus_why_not());
    b->user = journal_buses(p->reader) > 0 ? p->calls.of_bus(p->user, p->count) : p->user;
    inputs_init(&b->inputs, b->live, bus, p->calls.drain, b->user);
    b->inputs.renaming = p->calls.renaming;
    return true;
}

static bool read_configs(journal_player *p)
{
    const size_t buses = journal_buses(p->reader);
    if (buses > 0 && !p->calls.of_bus)
        return journal_play_fail(p, "buses",
                                 "the journal of a rig can be run only from a regular file");
    do {
        journal_next(p->reader, &p->entry);
        if (p->entry.kind == JOURNAL_BAD)
            return false;
        if (p->entry.kind != JOURNAL_CONFIG)
            return journal_play_fail(
                p, NULL, "a journal begins with a configuration: {\"at\":0,\"config\":[...]}");
        if (p->entry.bus < p->count)
            return journal_play_fail(p, "config", "there is a second configuration");
        if (!make_bus(p, &p->buses[p->count]))
            return false;
        p->count++;
    } while (p->count < buses);
    return true;
}

journal_player *journal_player_open(const char *file, const journal_calls *calls, void *user,
                                    FILE *errors)
{
    journal_player *p = calloc(1, sizeof *p);
    if (!p) {
        fprintf(errors, "%s: out of memory\n", file);
        return NULL;
    }
    *p = (journal_player){.file = file, .calls = *calls, .user = user, .errors = errors};
    p->reader = journal_open(file, errors);
    if (p->reader && read_configs(p))
        return p;
    journal_player_close(p);
    return NULL;
}

void journal_player_close(journal_player *p)
{
    if (!p)
        return;
    journal_close(p->reader);
    for (size_t i = 0; i < RIG_BUSES_MAX; i++) {
        live_free(p->buses[i].live);
        free(p->buses[i].memory);
    }
    free(p);
}

const cfg *journal_player_config(const journal_player *p)
{
    return journal_player_config_of(p, 0);
}

cw_bus *journal_player_bus(const journal_player *p)
{
    return journal_player_bus_of(p, 0);
}

size_t journal_player_count(const journal_player *p)
{
    return p->count;
}

const cfg *journal_player_config_of(const journal_player *p, size_t bus)
{
    return live_config(p->buses[bus].live);
}

cw_bus *journal_player_bus_of(const journal_player *p, size_t bus)
{
    return p->buses[bus].inputs.bus;
}

const char *journal_player_writer(const journal_player *p)
{
    return journal_writer(p->reader);
}

/* ---- Inputs ---------------------------------------------------------------------------------- */

/* Reports, once, that the bus answers differently. */
static void differ(journal_player *p, const char *key, const char *how)
{
    if (!p->differs)
        journal_complain(p->reader, key,
                         "this run is another one than that of the journal: %s; it was written by "
                         "canwire %s",
                         how, journal_writer(p->reader));
    p->differs = true;
}

static void expect_ok(journal_player *p, const char *key, cw_status status)
{
    if (status != CW_OK)
        differ(p, key, "the bus refuses what it did then");
}

static bool journal_play_find_node(journal_player *p, unsigned *node)
{
    static const char *const keys[INPUT_COUNT] = {
        [INPUT_SEND] = "send", [INPUT_RESTART] = "restart", [INPUT_SET] = "set"};
    *node = cfg_find_node(live_config(p->now->live), p->entry.node);
    if (*node != CW_NO_NODE)
        return true;
    const char *key = keys[p->entry.what.kind];
    if (!key)
        key = p->entry.what.on ? "attach" : "detach";
    journal_complain(p->reader, key, "there is no node '%.80s'", p->entry.node);
    return false;
}

static bool journal_play_find_rule(journal_player *p, unsigned *rule)
{
    const input *what = &p->entry.what;
    if (live_find(p->now->live, rule, what->rule))
        return true;
    journal_complain(p->reader, what->kind == INPUT_CLEAR ? "clear" : "fire",
                     "there is no rule '%.80s'", what->rule);
    return false;
}

/* Injects the rules of an entry. The messages are about the text; they are suppressed when the
 * recorded run refused it, too. */
static bool inject(journal_player *p)
{
    const input *what = &p->entry.what;
    memo errors;
    if (!memo_begin(&errors))
        return journal_play_fail(p, NULL, "out of memory");
    cfg_rules *rules =
        inputs_inject(&p->now->inputs, what->text, what->size, what->name, errors.out);
    if (!rules != what->refused)
        differ(p, "inject",
               rules ? "the bus takes these rules" : "the bus does not take these rules");
    if (!rules && !what->refused)
        fputs(memo_text(&errors) ? errors.text : "", p->errors);
    cfg_free_rules(rules);
    memo_end(&errors);
    return true;
}

/* Tells that names of now will be gone. */
static void renaming(journal_player *p)
{
    p->calls.drain(p->now->user);
    if (p->calls.renaming)
        p->calls.renaming(p->now->user);
}

static bool act_on_rule(journal_player *p)
{
    unsigned rule;
    if (!journal_play_find_rule(p, &rule))
        return false;
    if (p->entry.what.kind == INPUT_CLEAR) {
        renaming(p);
        inputs_clear(&p->now->inputs, rule);
        return true;
    }
    expect_ok(p, "fire", inputs_fire(&p->now->inputs, rule));
    return true;
}

static void journal_play_set(journal_player *p, unsigned node)
{
    const input *what = &p->entry.what;
    char problem[RETIME_PROBLEM_MAX];
    expect_ok(p, "set", inputs_set_all(&p->now->inputs, problem, node, what->settings, what->time));
}

/* Puts a guest on the bus under the name of then. */
static bool attach_as(journal_player *p, unsigned node, const char *name)
{
    const cfg *config = live_config(p->now->live);
    if (config->nodes[node].guest == 0 || cfg_find_node(config, name) != CW_NO_NODE) {
        journal_complain(p->reader, "as", "'%.80s' cannot be the name of this node", name);
        return false;
    }
    inputs_attach_as(&p->now->inputs, node, name);
    return true;
}

/* Puts a node on the bus, or takes it off. */
static bool attach(journal_player *p, unsigned node)
{
    const input *what = &p->entry.what;
    renaming(p);
    if (what->as)
        return attach_as(p, node, what->as);
    inputs_attach(&p->now->inputs, node, what->on);
    return true;
}

static bool act_on_node(journal_player *p)
{
    const input *what = &p->entry.what;
    unsigned node;
    if (!journal_play_find_node(p, &node))
        return false;
    if (what->kind == INPUT_SEND)
        expect_ok(p, "send", inputs_send(&p->now->inputs, node, what->frame, what->at_tick));
    else if (what->kind == INPUT_RESTART)
        expect_ok(p, "restart", inputs_restart(&p->now->inputs, node));
    else if (what->kind == INPUT_SET)
        journal_play_set(p, node);
    else
        return attach(p, node);
    return true;
}

static bool skip(journal_player *p)
{
    const input *what = &p->entry.what;
    const cw_event event = inputs_skip(&p->now->inputs, what->skipped, what->earlier);
    p->calls.event(p->now->user, &event);
    return true;
}

static bool journal_play_go_over(journal_player *p, cfg *config)
{
    uint8_t from[CW_NODES_MAX];
    void *memory;
    cw_bus *bus = bus_make(&memory, config);
    cfg_match_nodes(from, config, live_config(p->now->live));
    if (!bus || inputs_take_over(&p->now->inputs, bus, config, from) != CW_OK) {
        const char *why = bus ? "the bus cannot go over to it" : bus_why_not();
        free(memory);
        cfg_free(config);
        return journal_play_fail(p, "reload", why);
    }
    p->calls.leaving(p->now->user, config, from);
    free(p->now->memory);
    p->now->memory = memory;
    live_replace(p->now->live, config);
    p->calls.changed(p->now->user);
    return true;
}

static bool reload(journal_player *p)
{
    cfg *config = cfg_load_given(p->entry.files, p->entry.file_count, p->errors);
    return config ? journal_play_go_over(p, config)
                  : journal_play_fail(p, "reload", "the configuration has errors");
}

static bool act(journal_player *p)
{
    switch (p->entry.what.kind) {
    case INPUT_SEND:
    case INPUT_RESTART:
    case INPUT_SET:
    case INPUT_ATTACH:
        return act_on_node(p);
    case INPUT_INJECT:
        return inject(p);
    case INPUT_CLEAR:
    case INPUT_FIRE:
        return act_on_rule(p);
    case INPUT_SKIP:
        return skip(p);
    case INPUT_RELOAD:
        return reload(p);
    case INPUT_COUNT:
        break;
    }
    return false;
}

/* ---- The run --------------------------------------------------------------------------------- */

static bool check_order(journal_player *p)
{
    if (p->entry.at >= cw_bus_now(p->now->inputs.bus))
        return true;
    return journal_play_fail(p, "at", "at: before the line above");
}

/* The bus that wrote the line was at the end of a bit. This one has gone there, or as near as its
 * bits let it: then its bits are others. */
static bool check_reached(journal_player *p)
{
    const uint64_t now = cw_bus_now(p->now->inputs.bus);
    if (p->entry.at == now)
        return true;
    journal_complain(p->reader, "at", "at: not the end of a bit; the last one before it ends at %"
                     PRIu64, now);
    return false;
}

static void check_counters(journal_player *p)
{
    cw_bus_stats stats;
    char how[80];
    cw_bus_get_stats(p->now->inputs.bus, &stats);
    for (size_t i = 0; i < JOURNAL_COUNTERS; i++) {
        uint64_t now = cw_stat_value(&journal_counters[i], &stats, 0);
        if (now == p->entry.counters[i])
            continue;
        (void)snprintf(how, sizeof how, "%s is %" PRIu64 " and was %" PRIu64,
                       journal_counters[i].name, now, p->entry.counters[i]);
        differ(p, p->entry.kind == JOURNAL_MARK ? "mark" : "end", how);
        return;
    }
}

static void report_incomplete(journal_player *p, const char *why)
{
    char time[TIME_TEXT_MAX];
    text_print_seconds(time, cw_bus_now(p->now->inputs.bus));
    fprintf(p->errors, "%s: %s at %s s (line %zu, byte %" PRIu64 "); what followed is not known\n",
            p->file, why, time, journal_line(p->reader), journal_byte(p->reader));
}

/* Reports a gap. The bus at its end differs from the one before it: the lines behind the gap can be
 * read, but not run. */
static void report_gap(journal_player *p)
{
    char begin[TIME_TEXT_MAX];
    char end[TIME_TEXT_MAX];
    text_print_seconds(begin, cw_bus_now(p->now->inputs.bus));
    text_print_seconds(end, p->entry.at);
    fprintf(p->errors,
            "%s:%zu:1: nothing was written from %s s to %s s (%s), %" PRIu64
            " lines are missing; what followed cannot be run again\n",
            p->file, journal_line(p->reader), begin, end, p->entry.why, p->entry.missing);
}

static journal_outcome journal_play_conclude(journal_player *p)
{
    journal_outcome outcome = JOURNAL_PLAYED;
    if (p->entry.kind == JOURNAL_GAP) {
        report_gap(p);
        outcome = JOURNAL_INCOMPLETE;
    }
    if (p->entry.kind == JOURNAL_BROKEN || p->entry.kind == JOURNAL_CUT) {
        report_incomplete(p, p->entry.kind == JOURNAL_CUT ? "the journal is cut off"
                                                        : "the journal is broken");
        outcome = JOURNAL_INCOMPLETE;
    }
    return p->differs ? JOURNAL_FAILED : outcome;
}

/* Plays an entry at its time. Returns false when that is impossible. */
static bool play_entry(journal_player *p)
{
    switch (p->entry.kind) {
    case JOURNAL_INPUT:
        return act(p);
    case JOURNAL_MARK:
    case JOURNAL_END:
        check_counters(p);
        return true;
    case JOURNAL_CONFIG:
        return journal_play_fail(p, "config", "there is a second configuration");
    case JOURNAL_GAP:
    case JOURNAL_BROKEN:
    case JOURNAL_CUT:
    case JOURNAL_BAD:
        break;
    }
    return true;
}

/* Returns true when `advance` has ended the run of all buses. */
static bool all_stopped(const journal_player *p)
{
    bool all = true;
    for (size_t i = 0; i < p->count; i++)
        all = all && p->buses[i].stopped;
    return all;
}

/* Takes the bus to the entry, and plays that. Returns false when that is impossible. */
static bool play_at(journal_player *p)
{
    const journal_entry *e = &p->entry;
    if (!check_order(p))
        return false;
    bool advance = e->at > cw_bus_now(p->now->inputs.bus) || e->what.advanced;
    p->now->stopped = advance && !p->calls.advance(p->now->user, e->at);
    return p->now->stopped || (check_reached(p) && play_entry(p));
}

journal_outcome journal_play(journal_player *p)
{
    const journal_entry *e = &p->entry;
    do {
        journal_next(p->reader, &p->entry);
        p->now = &p->buses[e->bus];
        if (e->kind == JOURNAL_BAD)
            return JOURNAL_FAILED;
        if (e->kind == JOURNAL_CUT || e->kind == JOURNAL_GAP)
            return journal_play_conclude(p);
        if (!p->now->stopped && !play_at(p))
            return JOURNAL_FAILED;
        if (all_stopped(p))
            return p->differs ? JOURNAL_FAILED : JOURNAL_STOPPED;
    } while (!e->last);
    return journal_play_conclude(p);
}
