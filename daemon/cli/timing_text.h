/* SPDX-License-Identifier: MIT
 *
 * timing_text.h - a bit timing as text and as JSON.
 */
#ifndef CANWIRE_CLI_TIMING_TEXT_H
#define CANWIRE_CLI_TIMING_TEXT_H

#include "timing/request.h"

#include <stdio.h>

/* Prints the segments one to a line, with what they mean for this request. */
void timing_print_text(FILE *out, const bit_timing *t, const timing_request *request);

/* Prints one object on one line. Sample point and tolerance are fractions with up to 9 decimals,
 * rounded down. */
void timing_print_json(FILE *out, const bit_timing *t);

#endif
