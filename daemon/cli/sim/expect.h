/* SPDX-License-Identifier: MIT
 *
 * expect.h - judges a run by what its configuration expects of it.
 *
 * Fed with the events of the bus. Memory depends on the number of expectations alone.
 */
#ifndef CANWIRE_CLI_SIM_EXPECT_H
#define CANWIRE_CLI_SIM_EXPECT_H

#include "cli/sim/expect_report.h"
#include "config/config.h"

typedef struct expect expect;

/* Begins to judge by config->expects; the configuration must live longer. `start` is what the bus
 * has counted up to now. NULL: no memory. */
expect *expect_start(const cfg *config, const cw_bus_stats *start);

/* Every event, in order. */
void expect_event(expect *x, const cw_event *event);

/* Adds the outcome of each expectation to a report; the run is over, the bus is where it ended.
 * False when there is no memory. */
bool expect_conclude(expect *x, expect_report *report, const cw_bus *bus);

/* NULL is fine. */
void expect_free(expect *x);

#endif
