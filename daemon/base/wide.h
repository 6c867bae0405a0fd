/* SPDX-License-Identifier: MIT
 *
 * wide.h - unsigned numbers of 128 bits, for what leaves 64 on the way: also where compilers have
 * none of their own.
 */
#ifndef CANWIRE_BASE_WIDE_H
#define CANWIRE_BASE_WIDE_H

#include <stdint.h>

typedef struct wide {
    uint64_t high;
    uint64_t low;
} wide;

/* Never overflows. */
wide wide_product(uint64_t a, uint64_t b);

/* Modulo 2^128. */
wide wide_sum(wide a, wide b);

/* The quotient, rounded down, and what is left over; by is not 0. */
wide wide_divide(uint64_t *rest, wide number, uint64_t by);

static inline wide wide_of(uint64_t number)
{
    return (wide){.low = number};
}

#endif
