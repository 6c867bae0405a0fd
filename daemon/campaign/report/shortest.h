/* SPDX-License-Identifier: MIT
 *
 * shortest.h - the shortest scenarios of each class of failures.
 *
 * Short is few rules and entries of traffic, then little bus time, then a low number of the row.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_SHORTEST_H
#define CANWIRE_CAMPAIGN_REPORT_SHORTEST_H

#include "campaign/report/minimise.h"
#include "campaign/report/report.h"

#define SHORTEST_OF_CLASS 10u
#define SHORTEST_MAX (SHORTEST_OF_CLASS * CLASS_COUNT)

typedef struct shortest_scenario {
    row_class class;
    uint64_t number; /* of the row, or its seed without a campaign */
    uint64_t seed;
    unsigned degraded; /* DEGRADED_... as a set, of this class; otherwise 0 */
    char *expectation; /* that fails; NULL: none */
    char *repeat;      /* the command of the row */
    minimised found;
} shortest_scenario;

typedef struct shortest {
    shortest_scenario list[SHORTEST_MAX]; /* class by class, the shortest ones first */
    size_t count;
    char *why; /* there are none; NULL: there may be some */
    unsigned others; /* rows that do not do the same again */
} shortest;

/* Finds them in at most so much real time. */
void shortest_find(shortest *s, const report *r, int64_t time_ns);

void shortest_free(shortest *s);

#endif
