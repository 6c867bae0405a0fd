/* SPDX-License-Identifier: MIT
 *
 * prng.h - repeatable random streams, one for each fault rule.
 *
 * The generator is splitmix64 with one 64-bit state, for which every seed is a good one. A stream
 * depends on nothing but the seed of the run and its own name.
 */
#ifndef CANWIRE_PRNG_H
#define CANWIRE_PRNG_H

#include <stdint.h>

typedef struct cw_prng {
    uint64_t state;
} cw_prng;

/* The stream of that name under that seed. At most CW_RULE_NAME_MAX bytes of the name count. */
void cw_prng_init(cw_prng *prng, uint64_t seed, const char *name);

/* The next 64 random bits. */
uint64_t cw_prng_next(cw_prng *prng);

/* As if so many draws had been made. */
void cw_prng_skip(cw_prng *prng, uint64_t draws);

#endif
