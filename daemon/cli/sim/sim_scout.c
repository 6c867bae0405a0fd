/* SPDX-License-Identifier: MIT
 *
 * sim_scout.c - runs a bus a first time, without output, to find the tick of an awaited event.
 */
#include "cli/sim/sim_scout.h"

#include "cli/sim/sim_journal.h"
#include "cli/sim/sim_progress.h"

#include <stdio.h>
#include <sys/stat.h>

/* A drop has the time at which its frame was handed in, which is no end of a bit. */
#define CAREFUL_BITS 2u

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

void sim_scout_go(const sim_scout *s, sim_until *awaited)
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
