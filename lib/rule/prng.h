/* SPDX-License-Identifier: MIT
 *
 * prng.h - repeatable random streams, one for each fault rule.
 *
 * The generator is splitmix64: one 64-bit state, and every seed is good. A stream depends only on
 * the seed of the run and its own name.
 */
#ifndef CANWIRE_PRNG_H
#define CANWIRE_PRNG_H

#include <stdint.h>

typedef struct cw_prng {
    uint64_t state;
} cw_prng;

/* Begins the stream of that name under that seed. At most CW_RULE_NAME_MAX bytes of the name
 * count. */
void cw_prng_init(cw_prng *prng, uint64_t seed, const char *name);

/* Returns the next 64 random bits. */
uint64_t cw_prng_next(cw_prng *prng);

/* Skips that many draws. */
void cw_prng_skip(cw_prng *prng, uint64_t draws);

#endif
