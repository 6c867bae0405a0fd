/* SPDX-License-Identifier: MIT
 *
 * journal_play.c - repeats the run of a journal: the same inputs, the same events.
 *
 * Since version 4 a journal does not have the frames that the configuration determines. It says how
 * many there were up to each line, so that they are handed in here between the same lines.
 */
#include "run/journal_play.h"

#include "base/text/number.h"
#include "base/text/memo.h"
#include "run/bus_make.h"
#include "run/journal_seal.h"

#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define DIFFERENCE_BYTES 120 /* of a message about another run */

typedef struct played {
    live *live;
    void *memory; /* of the bus */
    inputs inputs;
    release_plan *plan; /* of the traffic that the configuration determines */
    uint64_t due;       /* its frames to come up to the present line */
    uint64_t digest;    /* of those that have come */
    uint64_t good;      /* tick up to which that was as recorded */
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
    if (bus)
        b->plan = release_plan_of_sends(config);
    if (!bus || !b->plan)
        return journal_play_fail(p, NULL, bus ? strerror(ENOMEM) : bus_why_not());
    b->user = journal_buses(p->reader) > 0 ? p->calls.of_bus(p->user, p->count) : p->user;
    inputs_init(&b->inputs, b->live, bus, p->calls.drain, b->user);
    b->inputs.renaming = p->calls.renaming;
    return true;
}

/* Reads the configurations, which stand before all inputs, and makes a bus of each. */
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
        release_plan_free(p->buses[i].plan);
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

/* Finds the node of a line. Complains about a name that the present configuration does not have. */
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

/* Finds the rule of a line, which may have been injected before. */
static bool journal_play_find_rule(journal_player *p, unsigned *rule)
{
    const input *what = &p->entry.what;
    if (live_find(p->now->live, rule, what->rule))
        return true;
    journal_complain(p->reader, what->kind == INPUT_CLEAR ? "clear" : "fire",
                     "there is no rule '%.80s'", what->rule);
    return false;
}

/* ---- Traffic of the configuration ------------------------------------------------------------ */

/* Hands in the next frame of the configuration. */
static cw_status hand_in(played *b)
{
    unsigned node;
    const uint64_t tick = release_next_tick(b->plan);
    const cw_frame frame = *release_first(b->plan, &node);
    const cw_status status = inputs_release(&b->inputs, b->plan);
    if (status == CW_OK)
        b->digest = journal_digest(b->digest, node, &frame, tick);
    return status;
}

/* Advances until a frame has left the inbox, at most to a tick. Returns false when none can. */
static bool journal_play_make_room(const journal_player *p, uint64_t tick)
{
    played *b = p->now;
    const cw_bus *bus = b->inputs.bus;
    const uint64_t bit = cw_rate_ticks(live_config(b->live)->rate, 1);
    const uint64_t left = cw_bus_inbox_first(bus) + bit - 1;
    if (cw_bus_now(bus) >= tick)
        return false;
    b->stopped = !p->calls.advance(b->user, left < tick ? left : tick);
    return !b->stopped && cw_bus_inbox_room(b->inputs.bus) > 0;
}

/* Hands in those frames of the configuration that come before the present line and not behind a
 * tick. */
static void hand_in_to(const journal_player *p, uint64_t tick)
{
    played *b = p->now;
    while (b->due > 0 && release_next_tick(b->plan) <= tick &&
           release_next_tick(b->plan) != CW_NEVER) {
        const cw_status status = hand_in(b);
        if (status == CW_OK)
            b->due--;
        else if (tick == CW_NEVER || !journal_play_make_room(p, tick))
            break;
    }
}

/* Checks the frames of the configuration, up to a line that says what they come to. */
static void check_digest(journal_player *p)
{
    char how[DIFFERENCE_BYTES], begin[TIME_TEXT_MAX], end[TIME_TEXT_MAX];
    played *b = p->now;
    if (p->entry.has_digest && p->entry.digest != b->digest) {
        text_print_seconds(begin, b->good);
        text_print_seconds(end, p->entry.at);
        (void)snprintf(how, sizeof how,
                       "the configuration sends something else between %s s and %s s", begin, end);
        differ(p, "digest", how);
    }
    b->good = p->entry.at;
}

/* Hands in the rest of them, whose ticks are to come. */
static void hand_in_rest(journal_player *p)
{
    char how[DIFFERENCE_BYTES];
    played *b = p->now;
    hand_in_to(p, CW_NEVER);
    if (b->due == 0)
        return;
    (void)snprintf(how, sizeof how, "%" PRIu64 " of the frames of the configuration do not come",
                   b->due);
    differ(p, "sent", how);
}

/* Hands in a frame of the configuration that came late then. */
static cw_status send_late(journal_player *p)
{
    unsigned node, other;
    played *b = p->now;
    if (!journal_play_find_node(p, &node) || release_next_tick(b->plan) == CW_NEVER ||
        !cw_frame_equal(release_first(b->plan, &other), &p->entry.frame) || other != node)
        return CW_INVALID;
    return inputs_release(&b->inputs, b->plan);
}

/* ---- Rules and nodes ------------------------------------------------------------------------- */

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

/* Clears or fires a rule. */
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

/* Makes an input that a node gets: a frame, a restart, settings, its ECU comes or goes. */
static bool act_on_node(journal_player *p)
{
    const input *what = &p->entry.what;
    unsigned node;
    if (!journal_play_find_node(p, &node))
        return false;
    if (what->kind == INPUT_SEND && p->entry.late)
        expect_ok(p, "late", send_late(p));
    else if (what->kind == INPUT_SEND)
        expect_ok(p, "send", inputs_send(&p->now->inputs, node, what->frame, what->at_tick));
    else if (what->kind == INPUT_RESTART)
        expect_ok(p, "restart", inputs_restart(&p->now->inputs, node));
    else if (what->kind == INPUT_SET)
        journal_play_set(p, node);
    else
        return attach(p, node);
    return true;
}

/* Bus time stands still for the skip, so the event is made here and not by the bus. */
static bool skip(journal_player *p)
{
    const input *what = &p->entry.what;
    const cw_event event = inputs_skip(&p->now->inputs, what->skipped, what->earlier);
    p->calls.event(p->now->user, &event);
    return true;
}

/* Puts the traffic of another configuration into the place of the present one's. */
static void take_over_traffic(journal_player *p, release_plan *plan,
                              const uint8_t from[CW_NODES_MAX])
{
    release_take_over(plan, p->now->plan, from, p->entry.what.at_tick);
    release_plan_free(p->now->plan);
    p->now->plan = plan;
}

/* Goes over to a new configuration as canwired did, at the same tick. Takes the configuration. */
static bool journal_play_go_over(journal_player *p, cfg *config)
{
    uint8_t from[CW_NODES_MAX];
    void *memory;
    cw_bus *bus = bus_make(&memory, config);
    release_plan *plan = release_plan_of_sends(config);
    cfg_match_nodes(from, config, live_config(p->now->live));
    if (!bus || !plan ||
        inputs_take_over(&p->now->inputs, bus, config, from, p->entry.what.at_tick) != CW_OK) {
        const char *why = !bus   ? bus_why_not()
                          : plan ? "the bus cannot go over to it"
                                 : strerror(ENOMEM);
        free(memory);
        release_plan_free(plan);
        cfg_free(config);
        return journal_play_fail(p, "reload", why);
    }
    p->calls.leaving(p->now->user, config, from);
    take_over_traffic(p, plan, from);
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

/* Makes the input that a line says. False: the line cannot be carried out. */
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

/* Compares the counters of the bus with those of the line. One that differs is told. */
static void check_counters(journal_player *p)
{
    cw_bus_stats stats;
    char how[DIFFERENCE_BYTES];
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

/* Tells where the journal ends without an end. */
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

/* Returns how the run has ended, and reports a journal that is not whole. */
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
        check_digest(p);
        check_counters(p);
        return true;
    case JOURNAL_SENT:
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
    played *b = p->now;
    if (!check_order(p))
        return false;
    b->due = e->sent;
    hand_in_to(p, e->at);
    bool advance = e->at > cw_bus_now(b->inputs.bus) || e->what.advanced;
    b->stopped = b->stopped || (advance && !p->calls.advance(b->user, e->at));
    if (b->stopped)
        return true;
    hand_in_rest(p);
    return check_reached(p) && play_entry(p);
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
