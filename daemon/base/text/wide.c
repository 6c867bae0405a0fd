/* SPDX-License-Identifier: MIT
 *
 * wide.c - unsigned numbers of 128 bits, for intermediate results that exceed 64 bits.
 */
#include "base/text/wide.h"

#include <stdbool.h>

#define HALF UINT32_MAX

wide wide_product(uint64_t a, uint64_t b)
{
    uint64_t low = (a & HALF) * (b & HALF);
    uint64_t cross = (a >> 32) * (b & HALF) + (low >> 32);
    uint64_t other = (a & HALF) * (b >> 32) + (cross & HALF);
    return (wide){
        .high = (a >> 32) * (b >> 32) + (cross >> 32) + (other >> 32),
        .low = other << 32 | (low & HALF),
    };
}

wide wide_sum(wide a, wide b)
{
    uint64_t low = a.low + b.low;
    return (wide){.high = a.high + b.high + (low < a.low), .low = low};
}

/* Divides the high half first, then the low half bit by bit, as in long division. */
wide wide_divide(uint64_t *rest, wide number, uint64_t by)
{
    wide quotient = {.high = number.high / by};
    uint64_t left = number.high % by;

    if (left == 0) { /* nearly always */
        *rest = number.low % by;
        quotient.low = number.low / by;
        return quotient;
    }
    for (int i = 63; i >= 0; i--) {
        bool carry = left >> 63;
        left = left << 1 | (number.low >> i & 1u);
        if (carry || left >= by) {
            left -= by;
            quotient.low |= UINT64_C(1) << i;
        }
    }
    *rest = left;
    return quotient;
}
