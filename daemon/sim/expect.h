/* SPDX-License-Identifier: MIT
 *
 * expect.h - judges a run by the expectations of its configuration.
 *
 * It takes the events of the bus. Its memory depends only on the number of expectations.
 */
#ifndef CANWIRE_SIM_EXPECT_H
#define CANWIRE_SIM_EXPECT_H

#include "config/config.h"
#include "sim/expect_report.h"

typedef struct expect expect;

/* Begins to judge by config->expects; the configuration must live longer. `start` has the
 * statistics of the bus up to now. Returns NULL without memory. */
expect *expect_start(const cfg *config, const cw_bus_stats *start);

/* Takes every event, in order. */
void expect_event(expect *x, const cw_event *event);

/* Adds the result of each expectation to a report; the run has ended with this bus. Returns false
 * without memory. */
bool expect_conclude(expect *x, expect_report *report, const cw_bus *bus);

/* Frees it. NULL is allowed. */
void expect_free(expect *x);

#endif
