/* SPDX-License-Identifier: MIT
 *
 * digest.h - what a report takes of a row, as bytes that another process can write.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_DIGEST_H
#define CANWIRE_CAMPAIGN_REPORT_DIGEST_H

#include "campaign/report/report.h"

/* Appends the digest of a row to bytes, for a report that has begun. */
void row_digest_write(buffer *out, const report_row *row, const report *r);

/* Reads the number of the row, or its seed if it has none. */
uint64_t row_digest_number(const char *digest);

/* Adds the row of a digest to its report. */
void row_digest_add(report *r, const char *digest);

#endif
