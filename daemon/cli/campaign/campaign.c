/* SPDX-License-Identifier: MIT
 *
 * campaign.c - `canwire campaign`: the command line.
 */
#include "base/options.h"
#include "base/text/plain.h"
#include "campaign/pool.h"
#include "cli/campaign/parts.h"
#include "cli/cli.h"

#include <getopt.h>
#include <stdio.h>
#include <string.h>

static const char usage[] =
    "usage: canwire campaign plan FILE [--jobs J]\n"
    "       canwire campaign run FILE [--out F] [--resume] [--shard K/N] [--jobs J] [--only N]\n"
    "       [--reload] [--work DIR] [--keep]\n"
    "       canwire campaign show FILE N\n"
    "       canwire campaign files FILE\n";

static const char help[] =
    "Runs a scenario with many values of what varies, as FILE says (canwire-campaign(7)). `plan`\n"
    "tells how many rows that makes, how long they will take, and the first ones. `run` writes a\n"
    "row of JSON for each. `show` prints the scenario of a row, `files` the paths of all files\n"
    "that are read. `report` says what the rows show.\n"
    "\n"
    "  --out F      write the rows into F, which appears when all are there; until then they are\n"
    "               in F.part. By default they go to standard output\n"
    "  --resume     go on behind the rows of a run that was ended; do nothing when F is there\n"
    "  --shard K/N  only this of N parts, 1/N to N/N; by default as SLURM_ARRAY_TASK_ID and\n"
    "               SLURM_ARRAY_TASK_COUNT of a whole array say, or JOB_COMPLETION_INDEX and\n"
    "               JOB_COMPLETIONS, or CI_NODE_INDEX and CI_NODE_TOTAL\n"
    "  --jobs J     so many processes, by default one a processor; the rows are the same\n"
    "  --only N     only this row\n"
    "  --work DIR   the folder for the files of programs (`ecu` in FILE), a folder for each row;\n"
    "               by default F.d, or FILE.d\n"
    "  --keep       keep those of rows that have passed, too\n"
    "  --reload     load the whole scenario for each row: slower, the same results\n";

static const char exit_status[] =
    "\n"
    "Exit status: 0, 1 a value or a file is bad, or a row is not a scenario, 2 wrong usage,\n"
    "3 (run) a row has not passed.\n";

typedef struct options {
    campaign_run_options run;
    bool has_shard;
} options;

static bool take_row(void *out, const char *option, const char *text)
{
    return !text_parse_uint(out, text) ||
           campaign_complain(option, text, "the number of a row, from 0 on");
}

static bool take_shard(void *out, const char *option, const char *text)
{
    return shard_parse(out, text) || campaign_complain(option, text, "K/N, such as 1/4");
}

/* The usage of `report` stands behind that of the others. */
static int campaign_refuse(const option_table *table)
{
    const int status = options_refuse(table);
    fputs(campaign_report_usage, stderr);
    return status;
}

static void campaign_print_help(FILE *out)
{
    fprintf(out, "%s\n%s\n%s%s", campaign_report_usage, help, campaign_report_help, exit_status);
}

/* Takes the shard from the environment when no option says it. */
static bool complete_shard(options *o)
{
    char problem[SHARD_PROBLEM_MAX];
    const bool good = o->has_shard || shard_find(&o->run.shard, problem);
    if (!good)
        plain_print(stderr, "canwire campaign: %s; give --shard K/N\n", problem);
    return good;
}

/* Loads the campaign and does what is asked with it. Of the words, `run` alone knows shards. */
static int run_part(options *o, const char *name, const char *file, const char *number)
{
    uint64_t row = 0;
    if (number && text_parse_uint(&row, number)) {
        (void)campaign_complain("row", number, "its number, from 0 on");
        return CLI_BAD_INPUT;
    }
    if (strcmp(name, "run") == 0 && !o->run.has_only && !complete_shard(o))
        return CLI_BAD_INPUT;
    campaign *c = campaign_load(file, stderr);
    if (!c)
        return CLI_BAD_INPUT;
    const int status = strcmp(name, "run") == 0     ? campaign_run(c, &o->run)
                       : strcmp(name, "plan") == 0  ? campaign_plan(c, o->run.jobs)
                       : strcmp(name, "files") == 0 ? campaign_files(c)
                                                    : campaign_show(c, row);
    campaign_free(c);
    return status;
}

/* Runs the part that the words name. Returns -1 when they name none, or one without the given
 * options. run: some of these belong to `run` alone. */
static int run_words(options *o, char **words, int count, bool run)
{
    const char *name = count > 0 ? words[0] : "";
    const bool shows = strcmp(name, "show") == 0;
    const bool plans = strcmp(name, "plan") == 0;
    const bool lists = strcmp(name, "files") == 0;
    const bool runs = strcmp(name, "run") == 0;
    if ((!shows && !plans && !lists && !runs) || count != (shows ? 3 : 2) ||
        ((shows || lists) && (run || o->run.jobs > 0)) || (plans && run))
        return -1;
    return run_part(o, name, words[1], shows ? words[2] : NULL);
}

int cli_campaign(int argc, char **argv)
{
    options o = {.run.shard = {.k = 1, .n = 1}};
    campaign_run_options *r = &o.run;
    const option_row rows[] = {
        {"out", .text = &r->out},
        {"resume", .flag = &r->resume},
        {"shard", .read = take_shard, .out = &r->shard, .flag = &o.has_shard},
        {"jobs", .read = campaign_take_jobs, .out = &r->jobs},
        {"only", .read = take_row, .out = &r->only, .flag = &r->has_only},
        {"reload", .flag = &r->reload},
        {"work", .text = &r->work},
        {"keep", .flag = &r->keep},
        {.name = NULL},
    };
    const option_table table = {
        .usage = usage, .help = "", .more = campaign_print_help, .rows = rows};
    if (argc > 1 && strcmp(argv[1], "report") == 0)
        return campaign_report(argc - 1, argv + 1);
    int status = options_read(&table, argc, argv);
    if (status == OPTIONS_WRONG_USAGE)
        fputs(campaign_report_usage, stderr);
    if (status >= 0)
        return status;
    const bool run = r->out || r->resume || o.has_shard || r->has_only || r->reload || r->work ||
                     r->keep;
    if (r->out && strcmp(r->out, "-") == 0)
        r->out = NULL;
    if (r->resume && !r->out) {
        fputs("canwire campaign: --resume needs --out F\n", stderr);
        return CLI_USAGE;
    }
    status = run_words(&o, argv + optind, argc - optind, run);
    return status < 0 ? campaign_refuse(&table) : status;
}
