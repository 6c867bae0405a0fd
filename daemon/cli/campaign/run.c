/* SPDX-License-Identifier: MIT
 *
 * run.c - `canwire campaign run`: the rows of a campaign.
 */
#include "base/text/counted.h"
#include "cli/campaign/parts.h"

#include "base/text/plain.h"
#include "base/wall.h"
#include "campaign/ecu/ecu_row.h"
#include "cli/campaign/resume.h"
#include "cli/campaign/rowfile.h"
#include "cli/cli.h"

#include <errno.h>
#include <inttypes.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef struct run {
    const campaign *campaign;
    runner *runner;
    ecu_rows *ecus; /* NULL: there are no programs */
    rowfile file;
    tally tally;
    uint64_t first;
    uint64_t count;    /* of the rows of the shard */
    resume old;        /* rows of an earlier run */
    uint64_t taken;
    uint64_t bad;      /* the first row that could not be run; UINT64_MAX: none */
    int64_t start_ns;
    bool shows;        /* progress on a terminal */
} run;

/* ---- Rows ------------------------------------------------------------------------------------ */

static unsigned char run_make(void *user, uint64_t number, buffer *row)
{
    const run *r = user;
    return (unsigned char)(r->ecus ? ecu_row(r->ecus, number, row)
                                   : runner_row(r->runner, number, row));
}

static unsigned char run_lose(void *user, uint64_t number, const pool_loss *loss, buffer *row)
{
    const run *r = user;
    return (unsigned char)runner_lost(r->runner, number, loss, row);
}

static void wipe(const run *r)
{
    if (r->shows)
        fputs("\r\033[K", stderr);
}

/* Counts the next row. */
static void count_row(run *r, outcome o, const char *row, size_t length)
{
    const bool bad = o == OUTCOME_INVALID || o == OUTCOME_BROKEN;
    if (bad && r->bad == UINT64_MAX)
        r->bad = r->first + r->old.there + r->taken;
    if (r->tally.noted == 0 && tally_first_note(row, length))
        wipe(r);
    tally_add(&r->tally, "canwire campaign", o, row, length);
}

/* Counts a row and writes it. Rows come in order, whichever process has made them. */
static bool run_take(void *user, unsigned char code, const char *row, size_t length)
{
    run *r = user;
    count_row(r, (outcome)code, row, length);
    r->taken++;
    if (fwrite(row, 1, length, r->file.stream) == length)
        return true;
    const char *error = strerror(errno);
    plain_print(stderr, "canwire campaign: %s: %s\n",
                r->file.name ? r->file.part : "standard output", error);
    return false;
}

/* Takes a row of an earlier run, which must be the next one. */
static bool check_row(void *user, const char *line, size_t length)
{
    run *r = user;
    return resume_take(&r->old, line, length);
}

/* ---- Progress -------------------------------------------------------------------------------- */

/* Shows the progress now and then, and brings written rows to the file. */
static void run_look(void *user, uint64_t made)
{
    const run *r = user;
    const double rate = (double)made * 1e9 / (double)(wall_ns() - r->start_ns);
    const uint64_t left = r->count - r->old.there - made;
    const uint64_t seconds = rate > 0 ? (uint64_t)((double)left / rate) : 0;
    (void)fflush(r->file.stream); /* little is lost when the program is killed */
    if (!r->shows)
        return;
    wipe(r);
    fprintf(stderr, "%" PRIu64 " of %" PRIu64 " rows, %.0f a second", r->old.there + made, r->count,
            rate);
    if (rate > 0)
        fprintf(stderr, ", %" PRIu64 ":%02u:%02u left", seconds / 3600,
                (unsigned)(seconds / 60 % 60), (unsigned)(seconds % 60));
}

static void few(void *user, unsigned jobs, int error)
{
    const run *r = user;
    wipe(r);
    pool_tell_few("canwire campaign", jobs, error);
}

/* ---- The run --------------------------------------------------------------------------------- */

/* Makes the rows that are not there yet, in several processes. */
static bool run_rows(run *r, const campaign_run_options *o)
{
    static const pool_calls calls = {
        .make = run_make, .lose = run_lose, .take = run_take, .look = run_look, .few = few};
    const pool_work work = {.calls = &calls,
                            .user = r,
                            .first = r->first + r->old.there,
                            .count = r->count - r->old.there,
                            .jobs = o->jobs > 0 ? o->jobs : pool_jobs_default(),
                            .limit_ms = r->ecus ? ecu_rows_limit_ms(r->campaign)
                                                : r->campaign->limit_ms};
    r->start_ns = wall_ns();
    r->shows = r->file.name && isatty(STDERR_FILENO);
    const bool good = pool_run(&work);
    const int error = errno;
    wipe(r);
    if (!good && error != 0)
        plain_print(stderr, "canwire campaign: %s\n", strerror(error));
    return good;
}

/* Prints the outcome of all rows. Returns the exit status. */
static int run_conclude(const run *r)
{
    const uint64_t total = tally_total(&r->tally);
    fprintf(stderr, "canwire campaign: %s: ", counted(total, "row").text);
    tally_print(stderr, &r->tally);
    fputc('\n', stderr);
    if (r->bad != UINT64_MAX) {
        plain_print(stderr, "canwire campaign: row %" PRIu64 " could not be run:\n", r->bad);
        if (r->campaign->ecus.count > 0)
            fputs("`why` in the row says more\n", stderr);
        if (r->campaign->ecus.count == 0 || r->campaign->until)
            runner_explain(r->campaign, r->bad, stderr);
        return CLI_BAD_INPUT;
    }
    return tally_all_passed(&r->tally) ? CLI_OK : CLI_EXPECTATION;
}

/* Chooses the rows: one, those of a shard, or all. */
static void choose_rows(run *r, const campaign_run_options *o)
{
    const uint64_t rows = r->campaign->rows;
    r->first = o->has_only ? o->only : shard_begin(&o->shard, o->shard.k, rows);
    r->count = o->has_only ? 1 : shard_begin(&o->shard, o->shard.k + 1, rows) - r->first;
    r->old = (resume){.campaign = r->campaign, .runner = r->runner, .first = r->first,
                      .count = r->count, .bad = UINT64_MAX};
}

/* Opens the file of rows, and checks those that are there. Returns false after a message. */
static bool open_rows(run *r, const campaign_run_options *o)
{
    if (!rowfile_open(&r->file, o->out, o->resume, check_row, r))
        return false;
    if (r->file.whole && r->old.there < r->count) {
        plain_print(stderr, "canwire campaign: %s: rows are missing in it; remove it\n", o->out);
        return false;
    }
    r->tally = r->old.tally;
    r->bad = r->old.bad;
    return !o->resume || resume_check(&r->old, r->file.whole ? r->file.name : r->file.part);
}

/* Prepares the programs, if there are any. Returns false after a message. */
static bool prepare_ecus(run *r, const campaign_run_options *o)
{
    char folder[PATH_MAX];
    const char *base = o->out ? o->out : r->campaign->file;
    if (r->campaign->ecus.count == 0)
        return true;
    if (snprintf(folder, sizeof folder, "%s.d", base) >= (int)sizeof folder)
        return false;
    r->ecus = ecu_rows_new(r->campaign, r->runner, o->work ? o->work : folder, o->keep);
    return r->ecus;
}

/* A file that is whole has all rows: with --resume nothing is left to do. */
int campaign_run(const campaign *c, const campaign_run_options *o)
{
    run r = {.campaign = c, .runner = runner_new(c, o->reload), .bad = UINT64_MAX};
    if (o->has_only && o->only >= c->rows) {
        plain_print(stderr, "canwire campaign: --only %" PRIu64 ": the last row is %" PRIu64 "\n",
                    o->only, c->rows - 1);
        runner_free(r.runner);
        return CLI_BAD_INPUT;
    }
    choose_rows(&r, o);
    if (!r.runner)
        fputs("canwire campaign: out of memory\n", stderr);
    bool good = r.runner && open_rows(&r, o);
    if (good && !r.file.whole)
        good = prepare_ecus(&r, o) && run_rows(&r, o);
    good = rowfile_close(&r.file, good) && good;
    resume_free(&r.old);
    ecu_rows_free(r.ecus);
    runner_free(r.runner);
    return good ? run_conclude(&r) : CLI_BAD_INPUT;
}
