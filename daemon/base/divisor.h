/* SPDX-License-Identifier: MIT
 *
 * divisor.h - the greatest common divisor of two numbers.
 */
#ifndef CANWIRE_BASE_DIVISOR_H
#define CANWIRE_BASE_DIVISOR_H

#include <stdint.h>

/* Takes two numbers that are not both 0. */
static inline uint64_t common_divisor(uint64_t a, uint64_t b)
{
    while (b > 0) {
        const uint64_t rest = a % b;
        a = b;
        b = rest;
    }
    return a;
}

#endif
