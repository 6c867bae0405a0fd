/* SPDX-License-Identifier: MIT
 *
 * bitset.h - small bit sets: of up to CW_BITS_MAX bits for the wire bits of a frame, words for
 * nodes.
 */
#ifndef CANWIRE_FORMAT_BITSET_H
#define CANWIRE_FORMAT_BITSET_H

#include "canwire.h"

static inline bool cw_bitset_get(const uint64_t set[CW_BIT_WORDS], unsigned n)
{
    return (set[n / 64] >> (n % 64)) & 1u;
}

/* Returns the set with that node alone. */
static inline uint64_t cw_node_bit(unsigned i)
{
    return UINT64_C(1) << i;
}

/* Returns the lowest node of a set that is not empty. */
static inline unsigned cw_lowest_node(uint64_t nodes)
{
    return (unsigned)__builtin_ctzll(nodes);
}

/* Returns the number of members of a word. */
unsigned cw_count_bits(uint64_t word);

/* Returns the number of members at or below n. */
unsigned cw_bitset_count_upto(const uint64_t set[CW_BIT_WORDS], unsigned n);

#endif
