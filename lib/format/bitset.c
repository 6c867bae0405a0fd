/* SPDX-License-Identifier: MIT
 *
 * bitset.c - small bit sets of up to 192 bits, for the wire bits of a frame.
 */
#include "format/bitset.h"

/* Has its own population count: the compiler's builtin may call into libgcc, and lib needs no
 * library. */
unsigned cw_count_bits(uint64_t w)
{
    w -= (w >> 1) & UINT64_C(0x5555555555555555);
    w = (w & UINT64_C(0x3333333333333333)) + ((w >> 2) & UINT64_C(0x3333333333333333));
    w = (w + (w >> 4)) & UINT64_C(0x0F0F0F0F0F0F0F0F);
    return (unsigned)((w * UINT64_C(0x0101010101010101)) >> 56);
}

unsigned cw_bitset_count_upto(const uint64_t set[CW_BIT_WORDS], unsigned n)
{
    unsigned count = 0;
    for (unsigned word = 0; word < n / 64; word++)
        count += cw_count_bits(set[word]);
    return count + cw_count_bits(set[n / 64] & (UINT64_MAX >> (63 - n % 64)));
}
