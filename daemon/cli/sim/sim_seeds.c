/* SPDX-License-Identifier: MIT
 *
 * sim_seeds.c - `canwire sim --seeds`: the same configuration with many seeds.
 */
#include "cli/sim/sim_seeds.h"

#include "base/text/counted.h"
#include "base/text/jsontext.h"
#include "base/text/plain.h"
#include "campaign/outcome.h"
#include "campaign/pool.h"
#include "campaign/shellword.h"
#include "campaign/tally.h"
#include "cli/cli.h"

#include <errno.h>
#include <inttypes.h>
#include <string.h>

#define NUMBER_MAX 32 /* bytes of a seed as text */

typedef struct seeds {
    const sim_seeds_options *options;
    scenario *scenario;
    buffer repeat;
    tally tally;
} seeds;

/* ---- Rows ------------------------------------------------------------------------------------ */

/* Writes the end of a row: the command that runs this seed alone. */
static void write_repeat(seeds *s, buffer *row, uint64_t seed)
{
    shellword_begin(&s->repeat, "canwire sim", s->options->file);
    buffer_print(&s->repeat, " --seed %" PRIu64, seed);
    if (s->options->until_text) {
        buffer_put(&s->repeat, " --until ");
        shellword_put(&s->repeat, s->options->until_text);
    }
    outcome_end_row(row, &s->repeat);
}

/* Runs the scenario with a seed, and writes its row. */
static unsigned char sim_seeds_make(void *user, uint64_t seed, buffer *row)
{
    seeds *s = user;
    buffer_put(row, "{");
    jsontext_number(row, "seed", seed);
    const outcome o = scenario_run(s->scenario, &seed) ? outcome_write(row, s->scenario)
                                                       : outcome_write_broken(row, s->scenario);
    write_repeat(s, row, seed);
    return (unsigned char)o;
}

/* Writes the row of a seed whose process has ended or took too long. */
static unsigned char sim_seeds_lose(void *user, uint64_t seed, const pool_loss *loss, buffer *row)
{
    seeds *s = user;
    buffer_put(row, "{");
    jsontext_number(row, "seed", seed);
    const outcome o = tally_lost(row, loss);
    write_repeat(s, row, seed);
    return (unsigned char)o;
}

/* Counts a row and prints it. Rows come in order of seeds. */
static bool sim_seeds_take(void *user, unsigned char code, const char *row, size_t length)
{
    seeds *s = user;
    tally_add(&s->tally, "canwire sim", (outcome)code, row, length);
    if (fwrite(row, 1, length, stdout) == length)
        return true;
    plain_print(stderr, "canwire sim: standard output: %s\n", strerror(errno));
    return false;
}

static void few(void *user, unsigned jobs, int error)
{
    (void)user;
    pool_tell_few("canwire sim", jobs, error);
}

/* ---- The run --------------------------------------------------------------------------------- */

/* Opens the scenario, which must have an end: nobody would interrupt each seed. */
static bool open_scenario(seeds *s)
{
    const sim_seeds_options *o = s->options;
    s->scenario = scenario_open(&(cfg_file){.name = o->file}, stderr);
    if (!s->scenario)
        return false;
    const char *wrong = o->until_text ? scenario_set_until(s->scenario, o->until) : NULL;
    if (wrong)
        plain_print(stderr, "canwire sim: --until: %s\n", wrong);
    for (size_t i = 0; i < s->scenario->count; i++)
        s->scenario->buses[i].run.step = o->step;
    return !wrong && scenario_ends(s->scenario, "give `count`, or --until TIME", stderr);
}

/* Runs all seeds in several processes. Returns false after a message, or when a row could not be
 * written. */
static bool sim_seeds_run(seeds *s)
{
    static const pool_calls calls = {
        .make = sim_seeds_make, .lose = sim_seeds_lose, .take = sim_seeds_take, .few = few};
    const sim_seeds_options *o = s->options;
    const pool_work work = {.calls = &calls,
                            .user = s,
                            .first = o->first,
                            .count = o->last - o->first + 1,
                            .jobs = o->jobs > 0 ? o->jobs : pool_jobs_default()};
    const bool good = pool_run(&work);
    if (!good && errno != 0)
        plain_print(stderr, "canwire sim: %s\n", strerror(errno));
    return good;
}

static void print_sum(const seeds *s)
{
    fprintf(stderr, "canwire sim: %s: ", counted(tally_total(&s->tally), "seed").text);
    tally_print(stderr, &s->tally);
    fputc('\n', stderr);
}

int sim_seeds_main(const sim_seeds_options *o)
{
    seeds s = {.options = o};
    const bool good = open_scenario(&s) && sim_seeds_run(&s);
    scenario_close(s.scenario);
    buffer_free(&s.repeat);
    if (!good)
        return CLI_BAD_INPUT;
    print_sum(&s);
    if (tally_has_bad(&s.tally))
        return CLI_BAD_INPUT;
    return tally_all_passed(&s.tally) ? CLI_OK : CLI_EXPECTATION;
}

/* ---- Options --------------------------------------------------------------------------------- */

/* Reads a number up to a "..", or to the end; *rest is then NULL. */
static bool read_seed(uint64_t *out, const char *text, const char **rest)
{
    char number[NUMBER_MAX];
    const char *dots = strstr(text, "..");
    const size_t length = dots ? (size_t)(dots - text) : strlen(text);
    *rest = dots ? dots + 2 : NULL;
    if (length >= sizeof number)
        return false;
    memcpy(number, text, length);
    number[length] = '\0';
    return !text_parse_uint(out, number);
}

bool sim_seeds_parse(sim_seeds_options *o, const char *text)
{
    const char *rest = NULL;
    bool good = read_seed(&o->first, text, &rest);
    o->last = o->first;
    if (good && rest)
        good = read_seed(&o->last, rest, &rest) && !rest;
    good = good && o->first <= o->last && o->last - o->first < UINT64_MAX;
    if (!good)
        plain_print(stderr, "canwire sim: --seeds %s: expected FIRST..LAST, such as 1..100\n",
                    text);
    return good;
}

bool sim_seeds_parse_jobs(unsigned *jobs, const char *command, const char *text)
{
    uint64_t number = 0;
    const bool good = !text_parse_uint(&number, text) && number >= 1 && number <= POOL_JOBS_MAX;
    *jobs = (unsigned)number;
    if (!good)
        plain_print(stderr, "%s: --jobs %s: a whole number from 1 to %u is expected\n", command,
                    text, POOL_JOBS_MAX);
    return good;
}
