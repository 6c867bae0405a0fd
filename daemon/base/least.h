/* SPDX-License-Identifier: MIT
 *
 * least.h - the lesser and the greater of two numbers, mostly ticks.
 */
#ifndef CANWIRE_BASE_LEAST_H
#define CANWIRE_BASE_LEAST_H

#include <stdint.h>

static inline uint64_t least(uint64_t a, uint64_t b)
{
    return a < b ? a : b;
}

static inline uint64_t most(uint64_t a, uint64_t b)
{
    return a > b ? a : b;
}

#endif
