/* SPDX-License-Identifier: MIT
 *
 * resume.h - the rows that an earlier run has left: are they those of this campaign?
 *
 * Each row must have the number and the values of the campaign. That says nothing about the
 * scenario, its profiles and its logs. So the first and the last row are made again, and of many
 * rows some that are evenly spread among them.
 */
#ifndef CANWIRE_CLI_CAMPAIGN_RESUME_H
#define CANWIRE_CLI_CAMPAIGN_RESUME_H

#include "campaign/runner.h"
#include "campaign/tally.h"

#define RESUME_SPREAD 16u /* rows that are made again, and the last one */
#define RESUME_STEP 64u   /* rows from one of them to the next, at least */

typedef struct resume_row {
    uint64_t number;
    buffer line; /* "": there is none */
} resume_row;

/* All zeros, but for the first members, has no row. */
typedef struct resume {
    const campaign *campaign;
    runner *runner;
    uint64_t first; /* number of the first row */
    uint64_t count; /* of the rows that there may be */
    uint64_t there; /* of these, rows that there are */
    uint64_t bad;   /* the first row of these that could not be run; UINT64_MAX: none */
    tally tally;
    uint64_t repeatable;   /* of the rows that there are, those that can be made again */
    uint64_t step;         /* of these, those from one of spread[] to the next */
    unsigned spread_count;
    resume_row spread[RESUME_SPREAD];
    resume_row last;       /* that can be made again; none when it is the first one, too */
} resume;

/* Takes the next row that is there. Returns false when it differs. */
bool resume_take(resume *r, const char *line, size_t length);

/* Makes rows again that are there, and says so on standard error. Returns false after a message
 * when they differ. `file` is the name of their file. */
bool resume_check(resume *r, const char *file);

void resume_free(resume *r);

#endif
