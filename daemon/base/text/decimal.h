/* SPDX-License-Identifier: MIT
 *
 * decimal.h - whole numbers of a small unit as decimal fractions of a larger one, exactly.
 */
#ifndef CANWIRE_BASE_DECIMAL_H
#define CANWIRE_BASE_DECIMAL_H

#include <stdint.h>

#define DECIMAL_TEXT_MAX 32 /* bytes of a decimal number with its final 0 */

typedef struct decimal_text {
    char text[DECIMAL_TEXT_MAX];
} decimal_text;

/* Returns value / 10^digits without zeros at the end; digits is at most 18. */
decimal_text decimal(uint64_t value, unsigned digits);
decimal_text decimal_signed(int64_t value, unsigned digits);

#endif
