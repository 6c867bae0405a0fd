/* SPDX-License-Identifier: MIT
 *
 * parts.h - the commands of `canwire campaign`. Each returns the exit status.
 */
#ifndef CANWIRE_CLI_CAMPAIGN_PARTS_H
#define CANWIRE_CLI_CAMPAIGN_PARTS_H

#include "campaign/campaign.h"
#include "campaign/shard.h"

#include <stdbool.h>

typedef struct campaign_run_options {
    const char *out; /* NULL: standard output */
    shard shard;
    unsigned jobs;   /* 0: one a processor */
    bool resume;
    bool reload;
    bool has_only;
    uint64_t only; /* the number of one row */
    const char *work; /* the folder of rows with programs; NULL: next to `out` */
    bool keep;        /* ... also of those that have passed */
} campaign_run_options;

int campaign_run(const campaign *c, const campaign_run_options *o);
int campaign_plan(const campaign *c, unsigned jobs);
int campaign_show(const campaign *c, uint64_t number);
int campaign_files(const campaign *c);

/* Has a command line of its own; argv[0] is `report`. */
int campaign_report(int argc, char **argv);

/* Complains about the value of an option. Returns false. */
bool campaign_complain(const char *option, const char *text, const char *expected);

/* Takes the value of --jobs into an unsigned, see option_row. */
bool campaign_take_jobs(void *out, const char *option, const char *text);

/* Parts of --help. */
extern const char campaign_report_usage[];
extern const char campaign_report_help[];

#endif
