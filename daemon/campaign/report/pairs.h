/* SPDX-License-Identifier: MIT
 *
 * pairs.h - which values of two factors have met in a row.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_PAIRS_H
#define CANWIRE_CAMPAIGN_REPORT_PAIRS_H

#include "campaign/campaign.h"

#define PAIRS_VALUES_MAX 4096u /* of a factor; with more, its pairs are not counted */
#define PAIRS_BYTES_MAX (256u << 20) /* of all pairs together */

/* Of one pair of factors: a bit for each pair of their values. */
typedef struct pair_cover {
    uint64_t *rows[PAIRS_VALUES_MAX]; /* by the value of the first factor; NULL: none has met */
    uint64_t met;
    bool over; /* a factor has too many values */
} pair_cover;

/* All zeros has no factors. */
typedef struct pairs {
    size_t factors;
    pair_cover **list; /* of factors i < k, see pairs_of() */
    size_t bytes;
} pairs;

/* Begins for so many factors. */
void pairs_begin(pairs *p, size_t factors);

/* Takes the values of a row, by their numbers. */
void pairs_add(pairs *p, const uint32_t values[CAMPAIGN_FACTORS_MAX]);

/* Returns what has met of two factors, i < k. */
const pair_cover *pairs_of(const pairs *p, size_t i, size_t k);

void pairs_free(pairs *p);

#endif
