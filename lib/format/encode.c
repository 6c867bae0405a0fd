/* SPDX-License-Identifier: MIT
 *
 * encode.c - frames to wire bits (F1..F7), a byte at a time.
 *
 * The bits of a frame are first laid out in whole bytes without stuff bits. A table has the wire
 * bits of each byte, given the bits before it. Five bytes become at most 50 bits. These are
 * collected in one word before they go to their place.
 */
#include "format/bits.h"
#include "format/frame.h"
#include "format/head.h"
#include "format/tables.h"

#include <assert.h>
#include <string.h>

#define PART_BYTES 5u
#define PLAIN_BYTES 16u /* one more than a frame can have */
#define LENGTHS_MASK 0xFFFu /* the bits of all bytes of a frame, in the sum of their entries */

/* The pad before SOF has so many bits that all stuffed bits, SOF to CRC, fill whole bytes with it.
 * Its bits alternate and end recessive, so they get no stuff bit; the CRC does not cover them. */
#define PAD_BITS(head_bits) (8 - ((head_bits) + CW_CRC_BITS) % 8)

_Static_assert(CW_CRC_TABLE_BYTES == PLAIN_BYTES - 1, "crc_of() names each byte");
_Static_assert(PAD_BITS(CW_BASE_HEAD_BITS) < 8 && PAD_BITS(CW_EXTENDED_HEAD_BITS) < 8,
               "encoding begins with a pad");
_Static_assert(CW_FRAME_BITS_MAX <= CW_BITS_MAX, "cw_bits has room for the longest frame");

/* A frame without stuff bits and CRC. */
typedef struct content {
    cw_head head;
    uint64_t data;   /* the last byte in the lowest bits */
    unsigned length; /* bytes of the data field */
    unsigned pad_bits;
} content;

/* The bytes in use stand at the end: pad, SOF to data, CRC. The bytes before them are zero. */
typedef struct plain_bytes {
    uint8_t bytes[PLAIN_BYTES];
    const uint8_t *first;
    unsigned count;
    unsigned pad_bits;
} plain_bytes;

/* Wire bits of up to PART_BYTES bytes. The last bit is bit 63; the lowest bits are not clean. */
typedef struct part {
    uint64_t level;
    uint64_t lengths; /* the number of bits in its lowest six bits */
    uint32_t state;   /* the state of the tables */
} part;

/* ---- Not stuffed ----------------------------------------------------------------------------- */

static inline uint64_t load_be(const uint8_t b[8])
{
    return (uint64_t)b[0] << 56 | (uint64_t)b[1] << 48 | (uint64_t)b[2] << 40 |
           (uint64_t)b[3] << 32 | (uint64_t)b[4] << 24 | (uint64_t)b[5] << 16 |
           (uint64_t)b[6] << 8 | b[7];
}

static inline void store_be(uint8_t b[8], uint64_t word)
{
#if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
    word = __builtin_bswap64(word);
#endif
    memcpy(b, &word, sizeof word);
}

static inline content content_of(const cw_frame *frame)
{
    const bool remote = cw_frame_is_remote(frame);
    content c = {.length = cw_dlc_length(frame->dlc, remote)};
    if (c.length > 0)
        c.data = load_be(frame->data) >> (64 - 8 * c.length);
    if (cw_frame_is_extended(frame)) {
        c.head = cw_extended_head(frame, remote, frame->dlc);
        c.pad_bits = PAD_BITS(CW_EXTENDED_HEAD_BITS);
    } else {
        c.head = cw_base_head(frame, remote, frame->dlc);
        c.pad_bits = PAD_BITS(CW_BASE_HEAD_BITS);
    }
    return c;
}

/* Returns the CRC of the bytes before it. Unused bytes are 0 and add nothing to it. */
static inline unsigned crc_of(const uint8_t bytes[PLAIN_BYTES])
{
    const uint16_t(*behind)[256] = cw_crc_table;
    unsigned crc = 0;
    crc ^= behind[14][bytes[1]] ^ behind[13][bytes[2]];
    crc ^= behind[12][bytes[3]] ^ behind[11][bytes[4]];
    crc ^= behind[10][bytes[5]] ^ behind[9][bytes[6]];
    crc ^= behind[8][bytes[7]] ^ behind[7][bytes[8]];
    crc ^= behind[6][bytes[9]] ^ behind[5][bytes[10]];
    crc ^= behind[4][bytes[11]] ^ behind[3][bytes[12]];
    crc ^= behind[2][bytes[13]] ^ behind[1][bytes[14]];
    return crc;
}

/* Lays out the bytes, with some bits of the CRC inverted. Returns the CRC. */
static inline unsigned lay_out(plain_bytes *plain, const content *c, unsigned inverted)
{
    const unsigned behind = 8 * c->length + CW_CRC_BITS; /* bits after the head */
    uint64_t low = c->data << CW_CRC_BITS;
    uint64_t high = c->data >> (64 - CW_CRC_BITS);
    low |= behind < 64 ? c->head.number << behind : 0;
    high |= behind < 64 ? c->head.number >> (64 - behind)
                         : c->head.number << (behind - 64);
    store_be(plain->bytes, high);
    store_be(plain->bytes + 8, low);
    unsigned crc = crc_of(plain->bytes) ^ inverted;
    plain->pad_bits = c->pad_bits;
    plain->count = (c->pad_bits + c->head.bits + behind) / 8;
    plain->first = plain->bytes + (PLAIN_BYTES - plain->count);
    plain->bytes[PLAIN_BYTES - plain->count] |= (uint8_t)(0x55u << (8 - c->pad_bits));
    plain->bytes[PLAIN_BYTES - 2] |= (uint8_t)(crc >> 8);
    plain->bytes[PLAIN_BYTES - 1] = (uint8_t)crc;
    return crc;
}

/* ---- Stuffed --------------------------------------------------------------------------------- */

static inline void stuff_byte(part *p, uint8_t byte)
{
    uint64_t entry = cw_stuff_table[p->state + byte];
    p->level = p->level >> (entry & 63) | entry;
    p->lengths += entry;
    p->state = cw_stuff_next[p->state + byte];
}

static inline void stuff_five(part *p, const uint8_t bytes[PART_BYTES])
{
    p->level = p->lengths = 0;
    stuff_byte(p, bytes[0]);
    stuff_byte(p, bytes[1]);
    stuff_byte(p, bytes[2]);
    stuff_byte(p, bytes[3]);
    stuff_byte(p, bytes[4]);
}

/* Appends a row of bits, the first one in the lowest bit. Takes two shifts, since a shift by 64
 * bits is not defined. */
static inline void append(uint64_t level[4], unsigned *at, uint64_t row, unsigned length)
{
    unsigned word = *at / 64, shift = *at % 64;
    level[word] |= row << shift;
    level[word + 1] |= row >> 1 >> (63 - shift);
    *at += length;
}

static inline void append_part(uint64_t level[4], unsigned *at, const part *p, unsigned pad_bits)
{
    unsigned length = p->lengths & 63;
    append(level, at, p->level >> (64 - length) >> pad_bits, length - pad_bits);
}

/* Puts all bits from SOF on. Returns how many of them are stuffed, those before the tail. */
static inline unsigned put_levels(uint64_t level[4], const plain_bytes *plain)
{
    part p = {.state = CW_STUFF_FIRST};
    unsigned at = 0, n = PART_BYTES;
    stuff_five(&p, plain->first);
    append_part(level, &at, &p, plain->pad_bits);
    for (; n + PART_BYTES <= plain->count; n += PART_BYTES) {
        stuff_five(&p, plain->first + n);
        append_part(level, &at, &p, 0);
    }
    p.level = p.lengths = 0;
    for (; n < plain->count; n++)
        stuff_byte(&p, plain->first[n]);
    if (p.lengths > 0)
        append_part(level, &at, &p, 0);
    unsigned stuffed = at;
    append(level, &at, (UINT64_C(1) << CW_TAIL_BITS) - 1, CW_TAIL_BITS);
    return stuffed;
}

cw_status cw_bits_encode_crc(cw_bits *bits, const cw_frame *frame, uint16_t inverted)
{
    if (!cw_frame_valid(frame))
        return CW_INVALID;
    plain_bytes plain;
    uint64_t level[4] = {0}; /* one more than needed, so that append() need not look */
    const content c = content_of(frame);
    uint16_t crc = (uint16_t)lay_out(&plain, &c, inverted);
    unsigned stuffed = put_levels(level, &plain);
    assert(stuffed + CW_TAIL_BITS <= CW_BITS_MAX);
    *bits = (cw_bits){.level = {level[0], level[1], level[2]},
                      .crc = crc,
                      .length = (uint8_t)(stuffed + CW_TAIL_BITS),
                      .data_bits = (uint8_t)(8 * c.length),
                      .extended = cw_frame_is_extended(frame)};
    return CW_OK;
}

cw_status cw_bits_encode(cw_bits *bits, const cw_frame *frame)
{
    return cw_bits_encode_crc(bits, frame, 0);
}

/* Counts only the bits that stuff_byte() would make. */
static inline void measure_byte(part *p, uint8_t byte)
{
    p->lengths += cw_stuff_table[p->state + byte];
    p->state = cw_stuff_next[p->state + byte];
}

static inline void measure_five(part *p, const uint8_t bytes[PART_BYTES])
{
    measure_byte(p, bytes[0]);
    measure_byte(p, bytes[1]);
    measure_byte(p, bytes[2]);
    measure_byte(p, bytes[3]);
    measure_byte(p, bytes[4]);
}

unsigned cw_bits_measure(const cw_frame *frame)
{
    plain_bytes plain;
    part all = {.state = CW_STUFF_FIRST};
    const content c = content_of(frame);
    (void)lay_out(&plain, &c, 0);
    unsigned n = 0;
    for (; n + PART_BYTES <= plain.count; n += PART_BYTES)
        measure_five(&all, plain.first + n);
    for (; n < plain.count; n++)
        measure_byte(&all, plain.first[n]);
    return (unsigned)(all.lengths & LENGTHS_MASK) - plain.pad_bits + CW_TAIL_BITS;
}

unsigned cw_frame_wire_bits(const cw_frame *frame)
{
    return cw_frame_valid(frame) ? cw_bits_measure(frame) : 0;
}
