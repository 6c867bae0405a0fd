/* SPDX-License-Identifier: MIT
 *
 * bitwise.h - frames to wire bits, one bit after the other along the table of parts: the reference
 *             for the library's encoder, which goes byte by byte.
 */
#ifndef CANWIRE_TEST_BITWISE_H
#define CANWIRE_TEST_BITWISE_H

#include "format/bitset.h"
#include "format/walk.h"

typedef struct bitwise_writer {
    cw_bits *bits;
    uint64_t *stuff; /* a set of wire bits */
    unsigned run;
    bool last;
} bitwise_writer;

static inline void add_to_set(uint64_t set[CW_BIT_WORDS], unsigned n)
{
    set[n / 64] |= UINT64_C(1) << (n % 64);
}

static inline void bitwise_put_raw(bitwise_writer *w, bool level)
{
    if (level)
        add_to_set(w->bits->level, w->bits->length);
    w->bits->length++;
}

static inline void bitwise_put_stuffed(bitwise_writer *w, bool level)
{
    bitwise_put_raw(w, level);
    w->run = level == w->last ? w->run + 1 : 1;
    w->last = level;
    if (w->run < CW_STUFF_RUN)
        return;
    add_to_set(w->stuff, w->bits->length);
    bitwise_put_raw(w, !level);
    w->last = !level;
    w->run = 1;
}

/* Encodes a valid frame as cw_bits_encode_crc() does, and adds its stuff bits to an empty set. */
static inline cw_bits bitwise_encode(const cw_frame *frame, uint16_t inverted,
                                     uint64_t stuff[CW_BIT_WORDS])
{
    cw_bits bits = {.length = 0};
    bitwise_writer writer = {.bits = &bits, .stuff = stuff, .run = 0, .last = CW_RECESSIVE};
    bits.format = cw_frame_is_extended(frame) ? CW_BITS_EXTENDED : 0;
    bits.bytes = (uint8_t)cw_frame_length(frame);
    for (cw_walk w = cw_walk_begin(frame); w.part != CW_PART_END; cw_walk_on(&w)) {
        if (w.part == CW_PART_CRC && w.index == 0)
            bits.crc = w.crc ^= inverted;
        if (cw_part_is(w.part, CW_PART_STUFFED))
            bitwise_put_stuffed(&writer, cw_walk_level(&w));
        else
            bitwise_put_raw(&writer, cw_walk_level(&w));
    }
    return bits;
}

#endif
