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

/* Says how an expectation stands, as if the run ended with these statistics. Returns false without
 * memory. The outcome is for expect_report_add() or expect_outcome_free() in any case. */
bool expect_look(const expect *x, size_t i, const cw_bus_stats *now, expect_outcome *out);

/* Adds the result of each expectation to a report; the run has ended with this bus. Returns false
 * without memory. */
bool expect_conclude(expect *x, expect_report *report, const cw_bus *bus);

/* An expectation that nothing to come can make met. The texts are NULL without memory. */
typedef struct expect_failure {
    size_t index;      /* of the expectation */
    uint64_t tick;     /* of the event, or up to which something would have had to come */
    const char *got;   /* up to then */
    const char *event; /* that it has failed by; "": by the time alone */
} expect_failure;

/* Reports the first failure of each expectation while the bus runs. That is an event, the end of a
 * window, or a gap that is too long. expect_conclude() finds the others. The function must not call
 * the judge. */
typedef void expect_failed(void *user, const expect_failure *failure);
void expect_watch(expect *x, expect_failed *failed, void *user);

/* Says that all events before this tick have come, where there may be none for long. */
void expect_pass(expect *x, uint64_t tick);

/* Lets an expectation go on with the findings about an equal one of another configuration. `from`
 * has the old node for each new one, see engine/reload.h. */
void expect_adopt(expect *x, size_t i, const expect *old, size_t k,
                  const uint8_t from[CW_NODES_MAX]);

/* Frees it. NULL is allowed. */
void expect_free(expect *x);

#endif
