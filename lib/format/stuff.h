/* SPDX-License-Identifier: MIT
 *
 * stuff.h - whole bytes of a frame with their stuff bits (F7), by the tables.
 *
 * Five bytes become at most 50 bits. These are collected in one word before they go to their place.
 */
#ifndef CANWIRE_FORMAT_STUFF_H
#define CANWIRE_FORMAT_STUFF_H

#include "format/tables.h"

#define CW_STUFF_BYTES 5u

/* Wire bits of some bytes. The last one is bit 63, the lowest ones are not clean. */
typedef struct cw_stuffed {
    uint64_t level;
    uint64_t lengths; /* the number of bits in its lowest six bits */
    uint32_t state;   /* the state of the tables */
} cw_stuffed;

/* Stuffs one byte: its levels come behind those before it. */
static inline void cw_stuff_byte(cw_stuffed *p, uint8_t byte)
{
    uint64_t entry = cw_stuff_table[p->state + byte];
    p->level = p->level >> (entry & 63) | entry;
    p->lengths += entry;
    p->state = cw_stuff_next[p->state + byte];
}

/* Stuffs five bytes, which are at most 50 levels and so fit into a word. */
static inline void cw_stuff_five(cw_stuffed *p, const uint8_t bytes[CW_STUFF_BYTES])
{
    p->level = p->lengths = 0;
    cw_stuff_byte(p, bytes[0]);
    cw_stuff_byte(p, bytes[1]);
    cw_stuff_byte(p, bytes[2]);
    cw_stuff_byte(p, bytes[3]);
    cw_stuff_byte(p, bytes[4]);
}

/* Appends a row of bits, the first one in the lowest bit. Takes two shifts, since a shift by 64
 * bits is not defined. */
static inline void cw_append(uint64_t level[], unsigned *at, uint64_t row, unsigned length)
{
    unsigned word = *at / 64, shift = *at % 64;
    level[word] |= row << shift;
    level[word + 1] |= row >> 1 >> (63 - shift);
    *at += length;
}

/* Appends what has been stuffed to some levels, without the pad before it. */
static inline void cw_append_stuffed(uint64_t level[], unsigned *at, const cw_stuffed *p,
                                     unsigned pad_bits)
{
    unsigned length = p->lengths & 63;
    cw_append(level, at, p->level >> (64 - length) >> pad_bits, length - pad_bits);
}

/* Counts only the bits that cw_stuff_byte() would make. */
static inline void cw_measure_byte(cw_stuffed *p, uint8_t byte)
{
    p->lengths += cw_stuff_table[p->state + byte];
    p->state = cw_stuff_next[p->state + byte];
}

/* Does the same without levels, for the length alone. */
static inline void cw_measure_five(cw_stuffed *p, const uint8_t bytes[CW_STUFF_BYTES])
{
    cw_measure_byte(p, bytes[0]);
    cw_measure_byte(p, bytes[1]);
    cw_measure_byte(p, bytes[2]);
    cw_measure_byte(p, bytes[3]);
    cw_measure_byte(p, bytes[4]);
}

#endif
