/* SPDX-License-Identifier: MIT
 *
 * prng.c - repeatable random streams, one for each fault rule.
 */
#include "rule/prng.h"

#include "canwire.h"

#define GAMMA UINT64_C(0x9E3779B97F4A7C15) /* step of the state; any number of the stream can be
                                              computed at once */

static uint64_t mix(uint64_t z)
{
    z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
    return z ^ (z >> 31);
}

uint64_t cw_prng_next(cw_prng *prng)
{
    prng->state += GAMMA;
    return mix(prng->state);
}

uint64_t cw_random(uint64_t seed, const char *name, uint64_t n)
{
    cw_prng prng;
    cw_prng_init(&prng, seed, name);
    prng.state += n * GAMMA;
    return cw_prng_next(&prng);
}

void cw_prng_skip(cw_prng *prng, uint64_t draws)
{
    prng->state += draws * GAMMA;
}

void cw_prng_init(cw_prng *prng, uint64_t seed, const char *name)
{
    uint64_t hash = UINT64_C(0xCBF29CE484222325); /* FNV-1a */
    for (unsigned i = 0; i < CW_RULE_NAME_MAX && name[i] != '\0'; i++)
        hash = (hash ^ (uint8_t)name[i]) * UINT64_C(0x100000001B3);
    prng->state = mix(seed ^ mix(hash));
}
