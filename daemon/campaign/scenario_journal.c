/* SPDX-License-Identifier: MIT
 *
 * scenario_journal.c - what has become of a bus of canwired, from its journal.
 */
#include "campaign/scenario_journal.h"

#include <stdlib.h>
#include <string.h>

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

static void scenario_journal_go_over(void *user)
{
    scenario *s = user;
    sim_change(&s->buses[0].run, s->buses[0].config, journal_player_bus(s->player));
    losses_forget(&s->buses[0].lost);
    begin_judging(s);
}

/* ---- The run --------------------------------------------------------------------------------- */

static void take_event(void *user, const cw_event *event)
{
    scenario_bus *b = user;
    observe_event(&b->seen, event, b->run.bus, b->config->rate);
    losses_event(&b->lost, event);
    if (b->judge)
        expect_event(b->judge, event);
}

static bool scenario_journal_open_bus(scenario *s, uint64_t until_ns, FILE *messages)
{
    const cfg_time until = {.ns = until_ns};
    const cfg_time beyond = {.ns = 1};
    const sim_sink sink = {.user = &s->buses[0], .event = take_event,
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
