/* SPDX-License-Identifier: MIT
 *
 * plan.c - `canwire campaign plan` and `show`: what a campaign will do.
 */
#include "base/text/counted.h"
#include "cli/campaign/parts.h"

#include "base/text/plain.h"
#include "campaign/pool.h"
#include "campaign/space/variant.h"
#include "cli/campaign/estimate.h"
#include "cli/cli.h"

#include <inttypes.h>

#define FIRST_ROWS 5u

/* Returns true, with a message, when a part of a text is missing. */
static bool lacks_memory(const buffer *text)
{
    if (text->no_memory)
        fputs("canwire campaign: out of memory\n", stderr);
    return text->no_memory;
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
