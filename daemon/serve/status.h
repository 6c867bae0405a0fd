/* SPDX-License-Identifier: MIT
 *
 * status.h - a running bus as JSON, and that JSON as text for people.
 */
#ifndef CANWIRE_SERVE_STATUS_H
#define CANWIRE_SERVE_STATUS_H

#include "engine/report.h"
#include "run/live.h"

#include <jansson.h>
#include <stdio.h>

/* Errors that nodes detected as receivers and as transmitters; starts all zero. */
typedef struct status_errors {
    uint64_t rx[CW_NODES_MAX];
    uint64_t tx[CW_NODES_MAX];
} status_errors;

/* Counts an event if it is an error. */
void status_count(status_errors *errors, const cw_event *event);

/* Returns the bus, its nodes and their interfaces as in canwire-control(7), to be released by the
 * caller. */
json_t *status_json(const cfg *config, const cw_bus *bus, const report *beyond,
                    const status_errors *errors);

/* Returns the rules of the bus, to be released by the caller. */
json_t *status_faults(const live *rules, const cw_bus *bus);

/* Prints the result of status_json() as `ip -details -statistics link show` prints CAN devices. A
 * missing value counts as 0. */
void status_print(FILE *out, const json_t *status);

/* Prints the result of status_faults() as a table. */
void status_print_faults(FILE *out, const json_t *faults);

#endif
