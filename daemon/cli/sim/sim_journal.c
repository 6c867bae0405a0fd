/* SPDX-License-Identifier: MIT
 *
 * sim_journal.c - a run of `canwire sim` that is driven by the journal of canwired.
 */
#include "cli/sim/sim_journal.h"

#include "base/version.h"
#include "record/pcapng.h"

#include <string.h>

static bool sim_journal_advance(void *user, uint64_t tick)
{
    const sim_journal *j = user;
    return sim_advance(j->run, tick);
}

static void sim_journal_drain(void *user)
{
    const sim_journal *j = user;
    sim_pass_on(j->run, NULL);
}

static void sim_journal_pass_on(void *user, const cw_event *event)
{
    const sim_journal *j = user;
    sim_pass_on(j->run, event);
}

/* Returns true when the nodes are the same, in the same places. */
static bool same_nodes(const cfg *config, const cfg *next, const uint8_t *from)
{
    bool same = config->node_count == next->node_count;
    for (unsigned i = 0; i < next->node_count; i++)
        same = same && from[i] == i;
    return same;
}

/* Ends what cannot go over to the next configuration. With other nodes traces end, and captures
 * name the new ones. */
static void sim_journal_leave(void *user, const cfg *next, const uint8_t from[CW_NODES_MAX])
{
    const sim_journal *j = user;
    bool same = same_nodes(j->run->config, next, from);
    if (j->judge)
        sim_judge_leave(j->judge, j->run);
    if (!same && j->trace)
        sim_trace_leave(j->trace, "canwire sim");
    if (!same && j->pcapng && j->pcapng->stream)
        pcapng_begin(j->pcapng->stream, next);
}

/* Goes on with the next configuration of the journal. */
static void sim_journal_go_over(void *user)
{
    const sim_journal *j = user;
    sim_change(j->run, journal_player_config(j->player), journal_player_bus(j->player));
    if (j->judge)
        sim_judge_enter(j->judge, j->run);
    sim_until_change(j->awaited);
}

bool sim_journal_open(sim_journal *j, const char *file)
{
    static const journal_calls calls = {
        .advance = sim_journal_advance,
        .drain = sim_journal_drain,
        .event = sim_journal_pass_on,
        .leaving = sim_journal_leave,
        .changed = sim_journal_go_over,
    };
    j->player = journal_player_open(file, &calls, j, j->errors);
    if (!j->player)
        return false;
    if (strcmp(journal_player_writer(j->player), CANWIRE_VERSION) != 0)
        fprintf(j->errors, "canwire sim: %s: written by canwire %s; this is " CANWIRE_VERSION "\n",
                file, journal_player_writer(j->player));
    if (sim_open_bus(j->run, journal_player_config(j->player), journal_player_bus(j->player),
                     stderr))
        return true;
    fprintf(j->errors, "canwire sim: out of memory\n");
    return false;
}

void sim_journal_close(sim_journal *j)
{
    journal_player_close(j->player);
}

bool sim_journal_go(sim_journal *j)
{
    sim_begin(j->run);
    journal_outcome outcome = journal_play(j->player);
    sim_end(j->run);
    return outcome != JOURNAL_FAILED;
}
