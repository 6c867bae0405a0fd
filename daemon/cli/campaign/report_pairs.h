/* SPDX-License-Identifier: MIT
 *
 * report_pairs.h - which pairs of values of two factors are the worst ones.
 */
#ifndef CANWIRE_CLI_CAMPAIGN_REPORT_PAIRS_H
#define CANWIRE_CLI_CAMPAIGN_REPORT_PAIRS_H

#include "cli/campaign/report_view.h"

#define REPORT_PAIRS_WORST 10u

/* A pair of values of the factors i < k, and the share of its rows by the measure. */
typedef struct worst_pair {
    size_t i;
    size_t k;
    const crosstab_cell *cell;
    share share;
} worst_pair;

/* Returns the measure for these rows, or NULL when all of them are well. */
const pair_measure *report_pair_measure(const report *r);

share report_measure_share(const report_view *v, const pair_measure *m, const class_counts *c);

/* Returns true when both factors have several values. Otherwise the pair only says what the table
 * of one of them says. */
bool report_pair_tells(const report *r, size_t i, size_t k);

/* Finds the pairs of values with the highest lower limits of the share's interval, so that few rows
 * count for little. Returns how many there are; those without such a row are left out. */
size_t report_worst_pairs(worst_pair out[REPORT_PAIRS_WORST], const report_view *v,
                          const pair_measure *m);

/* Returns "FACTOR VALUE, FACTOR VALUE", to be freed. */
char *report_pair_values(const report *r, size_t i, size_t k, uint32_t first, uint32_t second);

/* Returns how many pairs of factors have rows whose pairs of values are not told apart. */
size_t report_pairs_cut(const report *r);

#endif
