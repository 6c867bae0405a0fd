/* SPDX-License-Identifier: MIT
 *
 * timing_table.h - the bit timings of a configuration, one row per node, and what they leave.
 */
#ifndef CANWIRE_CLI_TIMING_TABLE_H
#define CANWIRE_CLI_TIMING_TABLE_H

#include "config/config.h"

#include <stdio.h>

/* Prints a line about the bus and a table, and another one of the data phase of CAN FD nodes. */
void timing_table_print(FILE *out, const cfg *config);

/* Prints one object on one line. */
void timing_table_print_json(FILE *out, const cfg *config);

#endif
