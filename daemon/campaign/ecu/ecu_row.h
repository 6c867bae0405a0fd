/* SPDX-License-Identifier: MIT
 *
 * ecu_row.h - the rows of a campaign with programs at its nodes.
 *
 * A row is made by canwired and the programs, in real time (ecu_keeper.h). Its journal then tells
 * what happened to the scenario, in the words of any other row.
 */
#ifndef CANWIRE_CAMPAIGN_ECU_ECU_ROW_H
#define CANWIRE_CAMPAIGN_ECU_ECU_ROW_H

#include "campaign/runner.h"

typedef struct ecu_rows ecu_rows;

/* Prepares the rows. Their files are in the folder `work`, which is made; those of rows that have
 * passed go, without `keep`. Says once on standard error when they have no network of their own.
 * Returns NULL after a message. */
ecu_rows *ecu_rows_new(const campaign *c, runner *r, const char *work, bool keep);

/* Frees it, and removes the folder when nothing is in it. NULL is allowed. */
void ecu_rows_free(ecu_rows *e);

/* Runs a row and writes it as a line. Returns its outcome. */
outcome ecu_row(ecu_rows *e, uint64_t number, buffer *row);

/* Returns the time that a row may take at most, with its start and end. */
int64_t ecu_rows_limit_ms(const campaign *c);

#endif
