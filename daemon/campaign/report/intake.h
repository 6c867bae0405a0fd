/* SPDX-License-Identifier: MIT
 *
 * intake.h - reads files of rows into a report, and refuses rows that do not belong together.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_INTAKE_H
#define CANWIRE_CAMPAIGN_REPORT_INTAKE_H

#include "campaign/report/report.h"
#include "campaign/runner.h"

typedef struct intake {
    const char *campaign_file; /* NULL: that of the rows, if it is there */
    bool partial;              /* rows may be missing */
    uint64_t ftti_ns;          /* the limit of latencies; 0: that of the campaign */
    unsigned jobs;             /* processes that read large files */
    report report;
    jsonread reader;
    char *command;      /* of all rows up to the number, and behind it; NULL: not known */
    size_t command_length;
    char *command_end;
    buffer head;        /* of a row, as it should be */
    buffer digest;      /* ... and what the report takes of it */
    campaign *campaign; /* owned; NULL: there is none */
    runner *runner;     /* of the campaign: the start of rows */
    const char *file;   /* that is being read */
    uint64_t line;
} intake;

/* Reads a file, "-" is standard input. All files are parts of one campaign. Returns false after a
 * message. */
bool intake_read(intake *in, const char *file);

/* Ends after the last file. Returns false after a message about missing rows. */
bool intake_end(intake *in);

void intake_free(intake *in);

#endif
