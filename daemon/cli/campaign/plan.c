/* SPDX-License-Identifier: MIT
 *
 * plan.c - `canwire campaign plan` and `show`: what a campaign will do.
 */
#include "cli/campaign/parts.h"

#include "base/plain.h"
#include "base/wall.h"
#include "campaign/runner.h"
#include "campaign/variant.h"
#include "cli/cli.h"

#include <inttypes.h>

#define FIRST_ROWS 5u
#define TRIED_MAX 2000u    /* rows that are run for the estimate ... */
#define TRIED_SECONDS 0.5  /* ... for so long at most */

static double now_seconds(void)
{
    return (double)wall_ns() / 1e9;
}

/* ---- Plan ------------------------------------------------------------------------------------ */

static void print_factors(const campaign *c)
{
    static const char *const samples[] = {
        [SAMPLE_FULL] = "the full product",
        [SAMPLE_PAIRWISE] = "each pair of values",
        [SAMPLE_RANDOM] = "at random",
        [SAMPLE_LOW_DISCREPANCY] = "of low discrepancy",
    };
    printf("%" PRIu64 " rows: %s", c->rows, samples[c->sample]);
    if (c->pruned > 0)
        printf("; %" PRIu64 " rows are pruned", c->pruned);
    puts("");
    for (size_t i = 0; i < c->factor_count; i++) {
        const factor *f = &c->factors[i];
        const bool drawn = f->kind == FACTOR_UNIFORM || f->kind == FACTOR_NORMAL;
        plain_print(stdout, "  %s: %" PRIu64 " %s%s", f->name, f->count,
                    drawn ? "draws" : "value", drawn || f->count == 1 ? "" : "s");
        if (f->pruned > 0)
            printf(", %" PRIu64 " pruned", f->pruned);
        puts("");
    }
}

/* Runs some rows from all parts of the campaign. Returns the seconds that one takes. */
static double try_rows(const campaign *c, rowtext *row)
{
    runner *r = runner_new(c, false);
    const uint64_t count = c->rows < TRIED_MAX ? c->rows : TRIED_MAX;
    const double start = now_seconds();
    double seconds = 0;
    uint64_t tried = 0;
    while (r && tried < count && seconds < TRIED_SECONDS) {
        rowtext_clear(row);
        (void)runner_row(r, c->rows / count * tried++, row);
        seconds = now_seconds() - start;
    }
    runner_free(r);
    return tried > 0 ? seconds / (double)tried : 0;
}

static void print_rows(const campaign *c)
{
    for (uint64_t i = 0; i < c->rows && i < FIRST_ROWS; i++) {
        choice choices[CAMPAIGN_FACTORS_MAX];
        printf("row %" PRIu64 ":", i);
        sample_choose(choices, c, i);
        for (size_t f = 0; f < c->factor_count; f++) {
            rowtext value = {.no_memory = false};
            sample_value(&value, &c->factors[f], &choices[f]);
            plain_print(stdout, " %s=%.*s", c->factors[f].name,
                        (int)buffer_length(&value.bytes), buffer_first(&value.bytes));
            rowtext_free(&value);
        }
        puts("");
    }
}

int campaign_plan(const campaign *c, unsigned jobs)
{
    rowtext row = {.no_memory = false};
    const unsigned processes = jobs > 0 ? jobs : pool_jobs_default();
    print_factors(c);
    print_rows(c);
    (void)fflush(stdout);
    const double each = try_rows(c, &row);
    rowtext_free(&row);
    printf("about %.3g s in %u process%s, %.3g us a row\n",
           each * (double)c->rows / processes, processes, processes == 1 ? "" : "es", each * 1e6);
    return CLI_OK;
}

/* ---- Show ------------------------------------------------------------------------------------ */

int campaign_show(const campaign *c, uint64_t number)
{
    choice choices[CAMPAIGN_FACTORS_MAX];
    rowtext text = {.no_memory = false};
    if (number >= c->rows) {
        plain_print(stderr,
                    "canwire campaign: there is no row %" PRIu64 ", the last one is %" PRIu64 "\n",
                    number, c->rows - 1);
        return CLI_BAD_INPUT;
    }
    sample_choose(choices, c, number);
    variant_text(&text, c, choices);
    (void)fwrite(buffer_first(&text.bytes), 1, buffer_length(&text.bytes), stdout);
    rowtext_free(&text);
    return text.no_memory ? CLI_BAD_INPUT : CLI_OK;
}
