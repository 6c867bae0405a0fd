/* SPDX-License-Identifier: MIT
 *
 * scenario.c - a configuration that is run many times in one process, in the same memory.
 */
#include "campaign/scenario.h"

#include "base/text/plain.h"
#include "config/doubts.h"
#include "run/bus_make.h"

#include <stdlib.h>
#include <string.h>

/* ---- Set-up ---------------------------------------------------------------------------------- */

/* Hands an event on to gateways of the rig, to the observation, to losses and to expectations. */
static void take_event(void *user, const cw_event *event)
{
    scenario_bus *b = user;
    sim_group_note(&b->all->group, b->index, event);
    observe_event(&b->seen, event, b->run.bus, b->config->rate);
    losses_event(&b->lost, event);
    if (b->judge)
        expect_event(b->judge, event);
}

/* Adds a bus. It only asks for the kinds of events that somebody reads: others cost time. */
static bool scenario_open_bus(scenario *s, cfg *config, FILE *messages)
{
    scenario_bus *b = &s->buses[s->count];
    sim_sink sink = {.user = b, .event = take_event, .kinds = OBSERVED_KINDS | LOSSES_KINDS};
    *b = (scenario_bus){.all = s, .index = s->count, .config = config, .seed = config->seed};
    b->lost.config = config;
    b->lost.of_row = true;
    b->lost.fed = doubts_fed(s->rig, b->index);
    s->count++;
    if (config->expect_count > 0)
        sink.kinds |= CW_EVENTS_USUAL;
    if (sim_group_wants(&s->group, b->index))
        sink.kinds |= 1u << CW_EVENT_RX;
    if (messages)
        fputs(config->warnings, messages);
    if (!sim_open(&b->run, config, messages))
        return false;
    b->run.messages = s->told.out;
    sim_add_sink(&b->run, &sink);
    s->group.runs[s->group.count++] = &b->run;
    return true;
}

/* Makes the buses of the rig, or the one of the file. Messages of a run go to memory. */
static bool open_buses(scenario *s, FILE *messages)
{
    const size_t count = s->rig ? s->rig->bus_count : 1;
    bool good = memo_begin(&s->told) && sim_group_open(&s->group, s->rig);
    for (size_t i = 0; i < count && good; i++)
        good = scenario_open_bus(s, s->rig ? s->rig->buses[i] : s->alone, messages);
    if (!good && messages)
        plain_print(messages, "canwire: %s\n", bus_why_not());
    return good;
}

/* Buses: of a rig; none: the file says all. */
static bool scenario_load(scenario *s, const cfg_file *file, const cfg_file *buses, size_t count,
                          FILE *errors)
{
    if (count == 0)
        return rig_load_either(&s->rig, &s->alone, file, errors);
    s->rig = rig_load_given(file, buses, count, errors);
    return s->rig;
}

scenario *scenario_open(const cfg_file *file, FILE *messages)
{
    return scenario_open_rig(file, NULL, 0, messages);
}

scenario *scenario_open_rig(const cfg_file *file, const cfg_file *buses, size_t count,
                            FILE *messages)
{
    FILE *nowhere = messages ? NULL : fopen("/dev/null", "re");
    scenario *s = calloc(1, sizeof *s);
    if (s)
        s->until = CW_NEVER;
    FILE *errors = messages ? messages : nowhere;
    const bool good =
        s && errors && scenario_load(s, file, buses, count, errors) && open_buses(s, messages);
    if (nowhere)
        (void)fclose(nowhere);
    if (good)
        return s;
    scenario_close(s);
    return NULL;
}

void scenario_close(scenario *s)
{
    if (!s)
        return;
    for (size_t i = 0; i < s->count; i++) {
        expect_free(s->buses[i].judge);
        sim_close(&s->buses[i].run);
    }
    sim_group_close(&s->group);
    expect_report_free(&s->report);
    cfg_free(s->alone);
    rig_free(s->rig);
    memo_end(&s->told);
    journal_player_close(s->player);
    free(s);
}

/* ---- Ends ------------------------------------------------------------------------------------ */

const char *scenario_set_until(scenario *s, cfg_time until)
{
    /* the last tick whose time in events, truncated to nanoseconds, is not after it */
    const cfg_time beyond = {.ns = 1};
    if (s->rig && until.bits > 0)
        return "a rig has bits of several lengths; give a time such as 10ms";
    s->until = text_time_ticks_sum(until, 1, beyond, s->buses[0].config->rate) - 1;
    return NULL;
}

bool scenario_ends(const scenario *s, const char *advice, FILE *messages)
{
    for (size_t i = 0; i < s->count && s->until == CW_NEVER; i++) {
        cfg_unending found;
        if (!cfg_find_unending(s->buses[i].config, &found))
            continue;
        if (messages)
            plain_print(messages, "%s:%d:%d: %s never ends: %s\n", found.file, found.place.line,
                        found.place.column, found.what, advice);
        return false;
    }
    return true;
}

uint64_t scenario_now(const scenario *s)
{
    return sim_group_now(&s->group);
}

/* ---- Runs ------------------------------------------------------------------------------------ */

/* Puts a bus to its start. */
static bool scenario_prepare(const scenario *s, scenario_bus *b, const uint64_t *seed)
{
    static const cw_bus_stats start = {.bits = 0};
    cfg *config = s->rig ? s->rig->buses[b->index] : s->alone;
    config->seed = seed ? *seed : b->seed;
    memset(&b->seen, 0, sizeof b->seen);
    losses_forget(&b->lost);
    b->run.until = s->until;
    expect_free(b->judge);
    b->judge = b->config->expect_count > 0 ? expect_start(b->config, &start) : NULL;
    return b->judge || b->config->expect_count == 0;
}

static bool restart(scenario *s)
{
    return s->rig ? sim_group_restart(&s->group, s->rig) : sim_restart(&s->buses[0].run);
}

/* Judges the run. Returns false when an expectation is not met or a file could not be read. */
static bool scenario_conclude(scenario *s)
{
    bool good = !s->failed;
    for (size_t i = 0; i < s->count; i++) {
        scenario_bus *b = &s->buses[i];
        observe_end(&b->seen, b->run.bus, (unsigned)b->config->node_count);
        release_tell(b->run.plan);
        if (b->judge && !expect_conclude(b->judge, &s->report, b->run.bus))
            good = false;
    }
    return good;
}

bool scenario_run(scenario *s, const uint64_t *seed)
{
    expect_report_free(&s->report);
    s->report = (expect_report){.count = 0};
    s->failed = false;
    (void)fseeko(s->told.out, 0, SEEK_SET);
    for (size_t i = 0; i < s->count; i++)
        if (!scenario_prepare(s, &s->buses[i], seed))
            return false;
    if (!restart(s))
        return false;
    if (s->rig)
        sim_group_simulate(&s->group);
    else
        (void)sim_go(&s->buses[0].run);
    s->failed = sim_group_failed(&s->group);
    return scenario_conclude(s);
}

const char *scenario_notes(const scenario *s)
{
    const char *notes = memo_text(&s->told);
    return notes ? notes : "";
}

char *scenario_why(scenario *s)
{
    const char *text = scenario_notes(s);
    size_t end = strlen(text);
    if (end == 0)
        return strdup("out of memory");
    while (end > 0 && text[end - 1] == '\n')
        end--;
    size_t begin = end; /* of the last message: others are notes */
    while (begin > 0 && text[begin - 1] != '\n')
        begin--;
    return strndup(text + begin, end - begin);
}

/* ---- A run from its journal ------------------------------------------------------------------ */

/* ---- Calls of the player --------------------------------------------------------------------- */

static bool scenario_journal_advance(void *user, uint64_t tick)
{
    scenario *s = user;
    return sim_advance(&s->buses[0].run, tick);
}

static void scenario_journal_drain(void *user)
{
    scenario *s = user;
    sim_pass_on(&s->buses[0].run, NULL);
}

static void scenario_journal_pass_on(void *user, const cw_event *event)
{
    scenario *s = user;
    sim_pass_on(&s->buses[0].run, event);
}

/* Judges from now on by the expectations of the configuration that is valid now. */
static void begin_judging(scenario *s)
{
    scenario_bus *b = &s->buses[0];
    cw_bus_stats start;
    s->report.configuration++;
    if (b->config->expect_count == 0)
        return;
    cw_bus_get_stats(b->run.bus, &start);
    b->judge = expect_start(b->config, &start);
    s->failed = s->failed || !b->judge;
}

/* Concludes the expectations of the configuration that ends, at its last tick. */
static void end_judging(scenario *s)
{
    scenario_bus *b = &s->buses[0];
    if (b->judge && !expect_conclude(b->judge, &s->report, b->run.bus))
        s->failed = true;
    expect_free(b->judge);
    b->judge = NULL;
}

/* A reload begins, which an ECU may have asked for. Counters are kept by the numbers of nodes. */
static void scenario_journal_leave(void *user, const cfg *next, const uint8_t from[CW_NODES_MAX])
{
    scenario *s = user;
    observation *seen = &s->buses[0].seen;
    const observation before = *seen;
    end_judging(s);
    memset(seen->tec_max, 0, sizeof seen->tec_max);
    memset(seen->rec_max, 0, sizeof seen->rec_max);
    for (unsigned i = 0; i < next->node_count; i++)
        if (from[i] < CW_NODES_MAX) {
            seen->tec_max[i] = before.tec_max[from[i]];
            seen->rec_max[i] = before.rec_max[from[i]];
        }
}

/* The configuration after a reload is valid now: its expectations and losses begin anew. */
static void scenario_journal_go_over(void *user)
{
    scenario *s = user;
    sim_change(&s->buses[0].run, s->buses[0].config, journal_player_bus(s->player));
    losses_forget(&s->buses[0].lost);
    begin_judging(s);
}

/* ---- The run --------------------------------------------------------------------------------- */

/* Does without gateways: a journal is of one bus. */
static void take_played_event(void *user, const cw_event *event)
{
    scenario_bus *b = user;
    observe_event(&b->seen, event, b->run.bus, b->config->rate);
    losses_event(&b->lost, event);
    if (b->judge)
        expect_event(b->judge, event);
}

/* Makes the one bus of a journal, whose programs send frames that no configuration names. */
static bool scenario_journal_open_bus(scenario *s, uint64_t until_ns, FILE *messages)
{
    const cfg_time until = {.ns = until_ns};
    const cfg_time beyond = {.ns = 1};
    const sim_sink sink = {.user = &s->buses[0], .event = take_played_event,
                           .kinds = OBSERVED_KINDS | CW_EVENTS_USUAL};
    scenario_bus *b = &s->buses[0];
    *b = (scenario_bus){.all = s, .config = journal_player_config(s->player)};
    b->lost.programs = true;
    s->count = 1;
    if (!sim_open_bus(&b->run, b->config, journal_player_bus(s->player), messages))
        return false;
    if (until_ns != UINT64_MAX) /* as scenario_set_until() has it */
        b->run.until = text_time_ticks_sum(until, 1, beyond, b->config->rate) - 1;
    sim_add_sink(&b->run, &sink);
    s->group.runs[s->group.count++] = &b->run;
    return true;
}

/* Plays the journal to its end. Losses get the last configuration, since a reload may have made
 * another. */
static void play(scenario *s)
{
    scenario_bus *b = &s->buses[0];
    begin_judging(s);
    sim_begin(&b->run);
    s->failed = journal_play(s->player) == JOURNAL_FAILED || s->failed;
    sim_end(&b->run);
    end_judging(s);
    b->lost.config = b->config;
    observe_end(&b->seen, b->run.bus, (unsigned)b->config->node_count);
}

scenario *scenario_replay(const char *file, uint64_t until_ns, FILE *messages)
{
    static const journal_calls calls = {.advance = scenario_journal_advance,
                                        .drain = scenario_journal_drain,
                                        .event = scenario_journal_pass_on,
                                        .leaving = scenario_journal_leave,
                                        .changed = scenario_journal_go_over};
    scenario *s = calloc(1, sizeof *s);
    if (s)
        s->player = journal_player_open(file, &calls, s, messages);
    if (s && s->player && sim_group_open(&s->group, NULL) &&
        scenario_journal_open_bus(s, until_ns, messages)) {
        play(s);
        if (!s->failed)
            return s;
    }
    scenario_close(s);
    return NULL;
}
