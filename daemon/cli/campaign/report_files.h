/* SPDX-License-Identifier: MIT
 *
 * report_files.h - files of a report: no output may replace an input or another output.
 */
#ifndef CANWIRE_CLI_CAMPAIGN_REPORT_FILES_H
#define CANWIRE_CLI_CAMPAIGN_REPORT_FILES_H

#include <stdbool.h>
#include <stddef.h>

#define REPORT_OUTPUTS 3u

/* Options that write a file. "-" is standard output, NULL none. */
typedef struct report_outputs {
    const char *option[REPORT_OUTPUTS]; /* such as "--json" */
    const char *name[REPORT_OUTPUTS];
} report_outputs;

/* Returns true when all outputs are different files. False: after a message. */
bool report_outputs_differ(const report_outputs *out);

/* Returns true when no output is this input; "-" is standard input, NULL none. False: after a
 * message. */
bool report_outputs_spare(const report_outputs *out, const char *input);

#endif
