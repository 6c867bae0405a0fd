/* SPDX-License-Identifier: MIT
 *
 * runner.h - runs the rows of a campaign, and writes them.
 *
 * Rows that only differ in seeds and in rules share a scenario. Rules are loaded once for each of
 * their values, and then put into the configuration. Several scenarios stay loaded.
 */
#ifndef CANWIRE_CAMPAIGN_RUNNER_H
#define CANWIRE_CAMPAIGN_RUNNER_H

#include "campaign/outcome.h"
#include "campaign/pool.h"
#include "campaign/space/sample.h"

typedef struct runner runner;

/* Makes a runner; the campaign must live longer. `reload` loads each scenario as a whole, which is
 * the reference. Returns NULL without memory. */
runner *runner_new(const campaign *c, bool reload);

void runner_free(runner *r);

/* Runs a row and writes it as a line. Returns its outcome. */
outcome runner_row(runner *r, uint64_t number, buffer *row);

/* Writes the begin of a row, up to before its outcome. */
void runner_begin(runner *r, uint64_t number, buffer *row);

/* Writes the begin of a row, up to the word for its outcome. */
void runner_head(runner *r, uint64_t number, buffer *row);

/* Writes the line of a row whose process has ended. */
outcome runner_lost(runner *r, uint64_t number, const pool_loss *loss, buffer *row);

/* Writes the messages about a row whose scenario is invalid, or has no result. */
void runner_explain(const campaign *c, uint64_t number, FILE *out);

#endif
