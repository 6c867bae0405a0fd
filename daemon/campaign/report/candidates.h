/* SPDX-License-Identifier: MIT
 *
 * candidates.h - rows that stand for all rows of a class: one for each kind of failure.
 *
 * A kind is what has failed or is degraded, and how the first error was seen. The row that ends
 * first stands for its kind, of equal ones that with the lowest number. So the order of the rows
 * does not matter.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_CANDIDATES_H
#define CANWIRE_CAMPAIGN_REPORT_CANDIDATES_H

#include "base/text/buffer.h"
#include "campaign/report/row.h"

#define CANDIDATES_MAX 48u /* of a class */

typedef struct candidate {
    char *kind;
    char *expectation; /* the first that has failed; NULL: none has */
    char *repeat;
    unsigned degraded; /* DEGRADED_... as a set, of this class; otherwise 0 */
    uint64_t number; /* of the row, or its seed without a campaign */
    uint64_t seed;
    uint64_t end_ns;
} candidate;

/* In the order of their ends and numbers. All zeros is empty. */
typedef struct candidates {
    candidate list[CANDIDATES_MAX];
    size_t count;
} candidates;

/* Writes the kind of a row. */
void candidate_put_kind(buffer *kind, const report_row *row, const row_signs *signs);

/* Returns the first expectation that has failed and is not a sign; NULL: none has. */
const char *candidate_expectation(const report_row *row, const row_signs *signs);

/* Takes a row that stands for its kind, and copies its texts. */
void candidates_add(candidates *c, const candidate *one);

void candidates_free(candidates *c);

#endif
