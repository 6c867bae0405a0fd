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

/* The bus, its nodes and their interfaces, as config/control.md tells. To be released by the
 * caller. */
json_t *status_json(const cfg *config, const cw_bus *bus, const report *beyond,
                    const status_errors *errors);

/* The rules that are on the bus. To be released by the caller. */
json_t *status_faults(const live *rules, const cw_bus *bus);

/* Prints what status_json() made as `ip -details -statistics link show` prints CAN devices. What
 * is missing counts as 0. */
void status_print(FILE *out, const json_t *status);

/* Prints what status_faults() made as a table. */
void status_print_faults(FILE *out, const json_t *faults);

#endif
