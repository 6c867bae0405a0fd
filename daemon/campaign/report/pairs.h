/* SPDX-License-Identifier: MIT
 *
 * pairs.h - which values of two factors have met in a row, and the classes of these rows.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_PAIRS_H
#define CANWIRE_CAMPAIGN_REPORT_PAIRS_H

#include "campaign/campaign.h"
#include "campaign/report/crosstab.h"

#define PAIRS_VALUES_MAX 4096u /* of a factor; with more, it is not known how many have met */
#define PAIRS_BYTES_MAX (256u << 20) /* of all bits together */

/* Pairs of values whose classes are told apart. Rows of further ones are counted together. */
#define PAIRS_CELLS_MAX 65536u  /* of one pair of factors */
#define PAIRS_CELLS_EACH 65536u /* all pairs of factors have equal parts of these, */
#define PAIRS_CELLS_MORE 65536u /* and whoever comes first has these */

/* Of one pair of factors: a bit for each pair of their values, and the classes. */
typedef struct pair_cover {
    uint64_t *rows[PAIRS_VALUES_MAX]; /* by the value of the first factor; NULL: none has met */
    uint64_t met;
    bool over; /* a factor has too many values */
    crosstab classes;
} pair_cover;

/* All zeros has no factors. */
typedef struct pairs {
    size_t factors;
    pair_cover **list; /* of factors i < k, see pairs_of() */
    size_t bytes;
    size_t share; /* cells that each pair of factors may have */
    size_t more; /* cells beyond that, of all */
} pairs;

/* Begins for that many factors. */
void pairs_begin(pairs *p, size_t factors);

/* Takes the values of a row, by their numbers, and its class. */
void pairs_add(pairs *p, const uint32_t values[CAMPAIGN_FACTORS_MAX], row_class class);

/* Returns what has met of two factors, i < k. */
const pair_cover *pairs_of(const pairs *p, size_t i, size_t k);

void pairs_free(pairs *p);

#endif
