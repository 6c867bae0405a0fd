/* SPDX-License-Identifier: MIT
 *
 * number_text.h - decimal numbers with a unit, exactly: -50, 0.875, 12.5us, 60%.
 */
#ifndef CANWIRE_CAMPAIGN_NUMBER_TEXT_H
#define CANWIRE_CAMPAIGN_NUMBER_TEXT_H

#include <stdbool.h>
#include <stdint.h>

#define NUMBER_TEXT_UNIT_MAX 8
#define NUMBER_TEXT_DECIMALS_MAX 9u
#define NUMBER_TEXT_MAX 40 /* bytes of a printed number with its final 0 */

/* mantissa / 10^decimals unit */
typedef struct number_text {
    int64_t mantissa;
    unsigned decimals;
    char unit[NUMBER_TEXT_UNIT_MAX];
} number_text;

/* Reads one. Returns false for another text, and beyond 10^15 with all decimals. */
bool number_text_parse(number_text *out, const char *text);

/* Brings numbers to the same decimals. Times get the smallest of their units (ns, us, ms, s).
 * Returns false when that exceeds the limits, or other units differ; 0 takes any unit. */
bool number_text_align(number_text *const list[], unsigned count);

/* Prints the number as JSON: in quotes when it has a unit. */
void number_text_print(char out[NUMBER_TEXT_MAX], const number_text *n);

#endif
