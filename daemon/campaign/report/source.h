/* SPDX-License-Identifier: MIT
 *
 * source.h - where rows come from: the command that repeats one.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_SOURCE_H
#define CANWIRE_CAMPAIGN_REPORT_SOURCE_H

#include "campaign/report/row.h"

typedef struct row_source {
    bool is_campaign; /* canwire campaign run FILE, otherwise canwire sim FILE */
    char *file;
    char *until; /* of canwire sim; NULL: there is none */
} row_source;

/* Reads the `repeat` of a row. Returns false for another command. */
bool row_source_read(row_source *out, const report_row *row);

/* Returns true when two rows come from one command. */
bool row_source_equals(const row_source *a, const row_source *b);

void row_source_free(row_source *s);

#endif
