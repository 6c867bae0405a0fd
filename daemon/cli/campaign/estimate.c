/* SPDX-License-Identifier: MIT
 *
 * estimate.c - how long the rows of a campaign will take.
 */
#include "cli/campaign/estimate.h"

#include "base/text/counted.h"
#include "base/text/plain.h"
#include "base/wall.h"
#include "campaign/runner.h"

#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define TRIED_MAX 2000u            /* rows that are run ... */
#define TRIED_NS INT64_C(500000000) /* ... for about so long */
#define LIMIT_MS INT64_C(3000)     /* for one row */
#define NUMBER_MAX 24

/* Rows that are tried. Their times are lines of the pool. */
typedef struct estimate {
    const campaign *campaign;
    runner *runner;
    buffer row;
    uint64_t count; /* of rows that are tried ... */
    uint64_t step;  /* ... each so far from the one before */
    uint64_t taken;
    int64_t ns;      /* of all that have been taken */
    uint64_t lost;   /* the first row that has made no line; UINT64_MAX: none */
    bool timeout;    /* ... it took too long */
    bool failed;     /* a message has said why */
} estimate;

/* ---- The process ----------------------------------------------------------------------------- */

static unsigned char estimate_make(void *user, uint64_t number, buffer *line)
{
    estimate *e = user;
    const int64_t start = wall_ns();
    buffer_clear(&e->row);
    (void)runner_row(e->runner, number * e->step, &e->row);
    buffer_print(line, "%" PRId64, wall_ns() - start);
    return 0;
}

static unsigned char estimate_lose(void *user, uint64_t number, const pool_loss *loss,
                                   buffer *line)
{
    estimate *e = user;
    if (e->lost == UINT64_MAX) {
        e->lost = number * e->step;
        e->timeout = loss->timeout;
    }
    buffer_put(line, "0");
    return 1;
}

/* One row that takes too long is enough. */
static bool estimate_take(void *user, unsigned char code, const char *line, size_t length)
{
    estimate *e = user;
    char text[NUMBER_MAX] = "";
    memcpy(text, line, length < NUMBER_MAX ? length : NUMBER_MAX - 1);
    e->taken += code == 0;
    e->ns += strtoll(text, NULL, 10);
    return !e->timeout;
}

/* ---- The tries ------------------------------------------------------------------------------- */

/* Runs so many rows. Returns false when there is no estimate. */
static bool try_rows(estimate *e, uint64_t count)
{
    static const pool_calls calls = {
        .make = estimate_make, .lose = estimate_lose, .take = estimate_take};
    const int64_t limit = e->campaign->limit_ms < LIMIT_MS ? e->campaign->limit_ms : LIMIT_MS;
    const pool_work work = {.calls = &calls, .user = e, .count = count, .jobs = 1,
                            .limit_ms = limit};
    e->count = count;
    e->step = e->campaign->rows / count;
    e->taken = 0;
    e->ns = 0;
    if (pool_run(&work))
        return e->taken > 0;
    e->failed = errno != 0;
    if (e->failed)
        plain_print(stderr, "canwire campaign: %s\n", strerror(errno));
    return false;
}

/* Tries one row, and then as many as its time allows. */
static bool try_all(estimate *e)
{
    const uint64_t rows = e->campaign->rows;
    if (!try_rows(e, 1))
        return false;
    const int64_t fit = TRIED_NS / (e->ns > 0 ? e->ns : 1);
    uint64_t count = fit < (int64_t)TRIED_MAX ? (uint64_t)fit : TRIED_MAX;
    count = count < rows ? count : rows;
    return count < 2 || try_rows(e, count);
}

/* Says what is known. */
static void print(const estimate *e, bool known, unsigned jobs)
{
    const campaign *c = e->campaign;
    if (e->timeout)
        printf("row %" PRIu64 " takes more than %g s; how long all take is not known\n", e->lost,
               (double)(c->limit_ms < LIMIT_MS ? c->limit_ms : LIMIT_MS) / 1e3);
    else if (e->lost != UINT64_MAX)
        printf("row %" PRIu64 " ends the process that runs it\n", e->lost);
    if (known && !e->timeout) {
        const double each = (double)e->ns / (double)e->taken;
        printf("about %.3g s in %s, %.3g us a row\n", each * (double)c->rows / jobs / 1e9,
               counted(jobs, "process").text, each / 1e3);
    }
}

bool estimate_print(const campaign *c, unsigned jobs)
{
    estimate e = {.campaign = c, .runner = runner_new(c, false), .lost = UINT64_MAX};
    if (!e.runner) {
        fputs("canwire campaign: out of memory\n", stderr);
        return false;
    }
    print(&e, try_all(&e), jobs);
    buffer_free(&e.row);
    runner_free(e.runner);
    return !e.failed;
}
