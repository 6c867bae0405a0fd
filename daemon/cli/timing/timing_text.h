/* SPDX-License-Identifier: MIT
 *
 * timing_text.h - a bit timing, and those of a configuration, as text and as JSON.
 */
#ifndef CANWIRE_CLI_TIMING_TEXT_H
#define CANWIRE_CLI_TIMING_TEXT_H

#include "base/text/buffer.h"
#include "config/config.h"
#include "timing/data_phase.h"

#include <stdio.h>

/* Prints the segments one to a line, with what they mean for this request. */
void timing_print_text(FILE *out, const bit_timing *t, const timing_request *request);

/* Prints those of the data phase, too. `limits` are those of the controller. */
void timing_print_data_text(FILE *out, const bit_timing *nominal, const bit_timing *data,
                            const timing_request *request, const timing_limits *limits);

/* Prints one object on one line. Sample point and tolerance are fractions with up to 9 decimals,
 * rounded down. `data` may be NULL. */
void timing_print_json(FILE *out, const bit_timing *t, const bit_timing *data,
                       const timing_limits *limits);

/* Puts brp and the segments; those of a data phase have a d before their keys. */
void timing_put_segments(buffer *out, const bit_timing *t, bool data);

/* Puts the keys of a data phase. */
void timing_put_data(buffer *out, const bit_timing *nominal, const bit_timing *data);

/* Puts parts of 10^9 as a fraction. */
void timing_put_fraction(buffer *out, const char *key, int64_t ppb);

/* Prints a line about the bus and a table with a row for each node of a configuration. The data
 * phases of CAN FD nodes have another table. */
void timing_table_print(FILE *out, const cfg *config);

/* Prints one object on one line. */
void timing_table_print_json(FILE *out, const cfg *config);

#endif
