/* SPDX-License-Identifier: MIT
 *
 * decimal.c - whole numbers of a small unit as decimal fractions of a larger one, exactly.
 */
#include "base/text/decimal.h"

#include <inttypes.h>
#include <stdio.h>

/* Prints without trailing zeros, and without a point when none is left behind it. */
static decimal_text print(const char *sign, uint64_t value, unsigned digits)
{
    decimal_text result;
    uint64_t one = 1;

    for (unsigned i = 0; i < digits; i++)
        one *= 10;
    while (digits > 0 && value % 10 == 0) {
        value /= 10;
        one /= 10;
        digits--;
    }
    if (digits == 0)
        snprintf(result.text, sizeof result.text, "%s%" PRIu64, sign, value);
    else
        snprintf(result.text, sizeof result.text, "%s%" PRIu64 ".%0*" PRIu64, sign, value / one,
                 (int)digits, value % one);
    return result;
}

decimal_text decimal(uint64_t value, unsigned digits)
{
    return print("", value, digits);
}

decimal_text decimal_signed(int64_t value, unsigned digits)
{
    return value < 0 ? print("-", 0 - (uint64_t)value, digits) : print("", (uint64_t)value, digits);
}
