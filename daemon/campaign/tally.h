/* SPDX-License-Identifier: MIT
 *
 * tally.h - counts the outcomes of scenarios.
 */
#ifndef CANWIRE_CAMPAIGN_TALLY_H
#define CANWIRE_CAMPAIGN_TALLY_H

#include "campaign/outcome.h"
#include "campaign/pool.h"

/* All zeros has counted nothing. */
typedef struct tally {
    uint64_t count[OUTCOME_COUNT];
    uint64_t noted; /* rows with notes */
} tally;

/* Returns the first note in a row, which ends with a quote; NULL: there is none. */
const char *tally_first_note(const char *row, size_t length);

/* Counts an outcome and its row, and shows the first one's first note. */
void tally_add(tally *t, const char *program, outcome o, const char *row, size_t length);

/* Returns the number of outcomes. */
uint64_t tally_total(const tally *t);

/* Returns true when one could not be run at all: broken or invalid. */
bool tally_has_bad(const tally *t);

/* Returns true when all have passed. */
bool tally_all_passed(const tally *t);

/* Prints "97 passed, 3 failed". */
void tally_print(FILE *out, const tally *t);

/* Writes the outcome of a scenario whose process has ended. */
outcome tally_lost(buffer *row, const pool_loss *loss);

#endif
