/* SPDX-License-Identifier: MIT
 *
 * wide.h - unsigned numbers of 128 bits, for intermediate results that exceed 64 bits. They do not
 * depend on types of the compiler.
 */
#ifndef CANWIRE_BASE_WIDE_H
#define CANWIRE_BASE_WIDE_H

#include <stdint.h>

typedef struct wide {
    uint64_t high;
    uint64_t low;
} wide;

/* Returns the product, which never overflows. */
wide wide_product(uint64_t a, uint64_t b);

/* Returns the sum modulo 2^128. */
wide wide_sum(wide a, wide b);

/* Returns the quotient, rounded down, and the remainder in *rest; `by` is not 0. */
wide wide_divide(uint64_t *rest, wide number, uint64_t by);

static inline wide wide_of(uint64_t number)
{
    return (wide){.low = number};
}

#endif
