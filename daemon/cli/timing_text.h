/* SPDX-License-Identifier: MIT
 *
 * timing_text.h - a bit timing as text and as JSON.
 */
#ifndef CANWIRE_CLI_TIMING_TEXT_H
#define CANWIRE_CLI_TIMING_TEXT_H

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

/* Prints the keys of the data phase with a comma before each. */
void timing_print_data_keys(FILE *out, const bit_timing *nominal, const bit_timing *data);

#endif
