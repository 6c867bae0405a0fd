/* SPDX-License-Identifier: MIT
 *
 * plan.c - `canwire campaign plan` and `show`: what a campaign will do.
 */
#include "base/text/counted.h"
#include "base/text/number.h"
#include "base/text/plain.h"
#include "base/wall.h"
#include "campaign/campaign.h"
#include "campaign/pool.h"
#include "campaign/runner.h"
#include "campaign/space/variant.h"
#include "cli/campaign/parts.h"
#include "cli/cli.h"

#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define FIRST_ROWS 5u

/* ---- How long the rows take ------------------------------------------------------------------ */

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

/* Makes a row for the estimate alone, and gives how long that took. */
static unsigned char estimate_make(void *user, uint64_t number, buffer *line)
{
    estimate *e = user;
    const int64_t start = wall_ns();
    buffer_clear(&e->row);
    (void)runner_row(e->runner, number * e->step, &e->row);
    buffer_print(line, "%" PRId64, wall_ns() - start);
    return 0;
}

/* Keeps the first row that has ended its process or its time: the estimate says so. */
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
    const char *digits = text;
    uint64_t ns = 0;
    memcpy(text, line, length < NUMBER_MAX ? length : NUMBER_MAX - 1);
    (void)text_take_digits(&ns, &digits, INT64_MAX);
    e->taken += code == 0;
    e->ns += (int64_t)ns;
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

/* Runs some rows from all parts of the campaign, in a process that is ended when one takes long.
 * Prints on standard output how long all rows will take in that many processes, or why that is not
 * known. Returns false after a message when no process can run them. */
static bool estimate_print(const campaign *c, unsigned jobs)
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

/* Returns true, with a message, when a part of a text is missing. */
static bool lacks_memory(const buffer *text)
{
    if (text->no_memory)
        fputs("canwire campaign: out of memory\n", stderr);
    return text->no_memory;
}

/* ---- Plan ------------------------------------------------------------------------------------ */

/* Prints the number of rows and how they are chosen, then the values of each factor. */
static void print_factors(const campaign *c)
{
    static const char *const samples[] = {
        [SAMPLE_FULL] = "the full product",
        [SAMPLE_PAIRWISE] = "each pair of values",
        [SAMPLE_RANDOM] = "at random",
        [SAMPLE_LOW_DISCREPANCY] = "of low discrepancy",
    };
    printf("%s: %s", counted(c->rows, "row").text, samples[c->sample]);
    if (c->pruned > 0)
        printf("; %s %s pruned", counted(c->pruned, "row").text, c->pruned == 1 ? "is" : "are");
    puts("");
    for (size_t i = 0; i < c->factor_count; i++) {
        const factor *f = &c->factors[i];
        const bool drawn = f->kind == FACTOR_UNIFORM || f->kind == FACTOR_NORMAL;
        plain_print(stdout, "  %s: %s", f->name,
                    counted(f->count, drawn ? "draw" : "value").text);
        if (f->pruned > 0)
            printf(", %" PRIu64 " pruned", f->pruned);
        puts("");
    }
}

/* Prints the value of a factor in a row. Returns false after a message, without memory. */
static bool print_value(const factor *f, const choice *chosen)
{
    buffer value = {.data = NULL};
    sample_value(&value, f, chosen);
    const char *text = buffer_text(&value);
    const bool good = !lacks_memory(&value);
    if (good)
        plain_print(stdout, " %s=%s", f->name, text);
    buffer_free(&value);
    return good;
}

/* Prints the values of the first rows. Returns false without memory. */
static bool print_rows(const campaign *c)
{
    bool good = true;
    for (uint64_t i = 0; i < c->rows && i < FIRST_ROWS; i++) {
        choice choices[CAMPAIGN_FACTORS_MAX];
        printf("row %" PRIu64 ":", i);
        sample_choose(choices, c, i);
        for (size_t f = 0; good && f < c->factor_count; f++)
            good = print_value(&c->factors[f], &choices[f]);
        puts("");
    }
    return good;
}

/* Tells how long rows with programs take: nobody knows before they run. */
static void print_real_time(const campaign *c, unsigned processes)
{
    const double each = (double)c->until_time.ns / 1e9;
    if (c->until_time.ns > 0)
        printf("%.3g s in %s, %.3g s a row, and the time until the programs are ready\n",
               each * (double)c->rows / processes, counted(processes, "process").text, each);
    else
        puts("a row takes until its programs end");
}

/* Prints the factors, some rows and how long all of them take. Rows with programs take their own
 * time. */
int campaign_plan(const campaign *c, unsigned jobs)
{
    print_factors(c);
    const bool good = print_rows(c);
    (void)fflush(stdout);
    if (!good)
        return CLI_BAD_INPUT;
    const unsigned processes = jobs > 0 ? jobs : pool_jobs_default();
    if (c->ecus.count == 0)
        return estimate_print(c, processes) ? CLI_OK : CLI_BAD_INPUT;
    print_real_time(c, processes);
    return CLI_OK;
}

/* ---- Show ------------------------------------------------------------------------------------ */

/* Prints the scenario of a row. */
int campaign_show(const campaign *c, uint64_t number)
{
    choice choices[CAMPAIGN_FACTORS_MAX];
    buffer text = {.data = NULL};
    if (number >= c->rows) {
        plain_print(stderr,
                    "canwire campaign: there is no row %" PRIu64 ", the last one is %" PRIu64 "\n",
                    number, c->rows - 1);
        return CLI_BAD_INPUT;
    }
    sample_choose(choices, c, number);
    variant_text(&text, c, choices);
    const bool good = !lacks_memory(&text);
    if (good)
        (void)fwrite(buffer_first(&text), 1, buffer_length(&text), stdout);
    buffer_free(&text);
    return good ? CLI_OK : CLI_BAD_INPUT;
}
