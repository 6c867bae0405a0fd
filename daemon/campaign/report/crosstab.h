/* SPDX-License-Identifier: MIT
 *
 * crosstab.h - the classes of rows, for each pair of values that two factors have in them.
 *
 * Only pairs that a row has take memory: some 100 bytes each. A lack of it ends the program.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_CROSSTAB_H
#define CANWIRE_CAMPAIGN_REPORT_CROSSTAB_H

#include "campaign/report/dimension.h"

/* The rows in which one factor has value `first`, and the other one `second`, by their numbers. */
typedef struct crosstab_cell {
    uint32_t first;
    uint32_t second;
    class_counts rows;
} crosstab_cell;

/* All zeros has no rows. */
typedef struct crosstab {
    crosstab_cell *cells; /* in the order of the rows */
    size_t count;
    size_t room;
    uint32_t *slots; /* hash table of cells, each with its number + 1; 0 is free */
    size_t slot_count; /* a power of two, more than twice the cells */
    class_counts other; /* rows of pairs without a cell */
} crosstab;

/* Returns the rows of a pair of values, or NULL when it has no cell. */
class_counts *crosstab_find(const crosstab *t, uint32_t first, uint32_t second);

/* Adds a cell for a pair that has none. Returns its rows, which the next call may move. */
class_counts *crosstab_add(crosstab *t, uint32_t first, uint32_t second);

/* Returns all cells by first value, then by second one. The caller frees the list alone. */
const crosstab_cell **crosstab_sorted(const crosstab *t);

void crosstab_free(crosstab *t);

#endif
