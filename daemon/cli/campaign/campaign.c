/* SPDX-License-Identifier: MIT
 *
 * campaign.c - `canwire campaign`: the command line.
 */
#include "cli/cli.h"

#include "base/text/plain.h"
#include "campaign/pool.h"
#include "cli/campaign/parts.h"

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
    "\n"
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
    "Exit status: 0, 1 a value or a file is bad, or a row is no scenario, 2 wrong usage, 3 (run)\n"
    "a row has not passed.\n";

typedef struct options {
    campaign_run_options run;
    bool has_shard;
    unsigned seen; /* options, as a set */
} options;

enum { SEEN_RUN = 1u, SEEN_JOBS = 2u };

static int campaign_refuse(void)
{
    fputs(usage, stderr);
    fputs(campaign_report_usage, stderr);
    return CLI_USAGE;
}

static bool campaign_complain(const char *option, const char *text, const char *expected)
{
    plain_print(stderr, "canwire campaign: %s %s: expected %s\n", option, text, expected);
    return false;
}

static bool take_jobs(options *o, const char *text)
{
    uint64_t number = 0;
    o->seen |= SEEN_JOBS;
    if (text_parse_uint(&number, text) || number < 1 || number > POOL_JOBS_MAX)
        return campaign_complain("--jobs", text, "a whole number from 1 to 256");
    o->run.jobs = (unsigned)number;
    return true;
}

/* Returns false after a message about a bad value. */
static bool campaign_take_option(options *o, int option)
{
    if (option == 'j')
        return take_jobs(o, optarg);
    o->seen |= SEEN_RUN;
    if (option == 'o')
        o->run.out = strcmp(optarg, "-") == 0 ? NULL : optarg;
    else if (option == 'r')
        o->run.resume = true;
    else if (option == 'R')
        o->run.reload = true;
    else if (option == 'w')
        o->run.work = optarg;
    else if (option == 'k')
        o->run.keep = true;
    else if (option == 'n') {
        o->run.has_only = true;
        return !text_parse_uint(&o->run.only, optarg) ||
               campaign_complain("--only", optarg, "the number of a row, from 0 on");
    } else {
        o->has_shard = true;
        return shard_parse(&o->run.shard, optarg) ||
               campaign_complain("--shard", optarg, "K/N, such as 1/4");
    }
    return true;
}

/* Returns -1 to go on, otherwise the exit status. */
static int campaign_parse_options(options *o, int argc, char **argv)
{
    static const struct option known[] = {
        {"out", required_argument, NULL, 'o'},   {"resume", no_argument, NULL, 'r'},
        {"shard", required_argument, NULL, 's'}, {"jobs", required_argument, NULL, 'j'},
        {"only", required_argument, NULL, 'n'},  {"reload", no_argument, NULL, 'R'},
        {"work", required_argument, NULL, 'w'},  {"keep", no_argument, NULL, 'k'},
        {"help", no_argument, NULL, 'h'},        {NULL, 0, NULL, 0},
    };
    int c;
    while ((c = getopt_long(argc, argv, "h", known, NULL)) != -1) {
        if (c == 'h') {
            fputs(usage, stdout);
            fputs(campaign_report_usage, stdout);
            fputs(help, stdout);
            fputs(campaign_report_help, stdout);
            fputs(exit_status, stdout);
            return CLI_OK;
        }
        if (c == '?')
            return campaign_refuse();
        if (!campaign_take_option(o, c))
            return CLI_BAD_INPUT;
    }
    if (o->run.resume && !o->run.out) {
        fputs("canwire campaign: --resume needs --out F\n", stderr);
        return CLI_USAGE;
    }
    return -1;
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

int cli_campaign(int argc, char **argv)
{
    options o = {.run.shard = {.k = 1, .n = 1}};
    if (argc > 1 && strcmp(argv[1], "report") == 0)
        return campaign_report(argc - 1, argv + 1);
    const int status = campaign_parse_options(&o, argc, argv);
    if (status >= 0)
        return status;
    const int words = argc - optind;
    const char *name = words > 0 ? argv[optind] : "";
    const bool shows = strcmp(name, "show") == 0;
    const bool plans = strcmp(name, "plan") == 0;
    const bool lists = strcmp(name, "files") == 0;
    const bool runs = strcmp(name, "run") == 0;
    if ((!shows && !plans && !lists && !runs) || words != (shows ? 3 : 2) ||
        ((shows || lists) && o.seen) || (plans && (o.seen & SEEN_RUN)))
        return campaign_refuse();
    return run_part(&o, name, argv[optind + 1], shows ? argv[optind + 2] : NULL);
}
