/* SPDX-License-Identifier: MIT
 *
 * encode.c - classical frames to wire bits (F1..F7), a byte at a time.
 *
 * The bits of a frame are first laid out in whole bytes without stuff bits. A table has the wire
 * bits of each byte, given the bits before it.
 */
#include "format/bits.h"
#include "format/frame.h"
#include "format/head.h"
#include "format/stuff.h"

#include <assert.h>
#include <string.h>

#define PLAIN_BYTES 16u /* one more than a frame can have */
#define LENGTHS_MASK 0xFFFu /* the bits of all bytes of a frame, in the sum of their entries */

/* The pad before SOF has so many bits that all stuffed bits, SOF to CRC, fill whole bytes with it.
 * Its bits alternate and end recessive, so they get no stuff bit; the CRC does not cover them. */
#define PAD_BITS(head_bits) (8 - ((head_bits) + CW_CRC_BITS) % 8)

_Static_assert(CW_CRC_TABLE_BYTES == PLAIN_BYTES - 1, "crc_of() names each byte");
_Static_assert(PAD_BITS(CW_BASE_HEAD_BITS) < 8 && PAD_BITS(CW_EXTENDED_HEAD_BITS) < 8,
               "encoding begins with a pad");
_Static_assert(CW_CLASSICAL_FRAME_BITS_MAX <= 192, "cw_short_bits has room for the longest frame");

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

/* ---- Not stuffed ----------------------------------------------------------------------------- */

/* Returns the number that eight bytes are, the most significant one first. */
static inline uint64_t load_be(const uint8_t b[8])
{
    return (uint64_t)b[0] << 56 | (uint64_t)b[1] << 48 | (uint64_t)b[2] << 40 |
           (uint64_t)b[3] << 32 | (uint64_t)b[4] << 24 | (uint64_t)b[5] << 16 |
           (uint64_t)b[6] << 8 | b[7];
}

/* Stores a number in the same way. */
static inline void store_be(uint8_t b[8], uint64_t word)
{
#if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
    word = __builtin_bswap64(word);
#endif
    memcpy(b, &word, sizeof word);
}

/* Returns the header and the data of a frame as numbers, for whole bytes. */
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

/* Changes the level of bits of the head (F5). Not inlined, since few frames deviate. */
__attribute__((noinline)) static void deviate(content *c, bool extended, unsigned deviations)
{
    if (deviations & CW_DEVIATES_SRR)
        c->head.number &= ~(UINT64_C(1) << CW_EXTENDED_SHIFT_SRR_RTR);
    if (deviations & CW_DEVIATES_R1)
        c->head.number |= UINT64_C(1) << CW_EXTENDED_SHIFT_R1;
    if (deviations & CW_DEVIATES_R0)
        c->head.number |= UINT64_C(1) << (extended ? CW_EXTENDED_SHIFT_R1 - 1 : CW_BASE_SHIFT_R0);
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

/* Puts all bits from SOF on. Returns how many of them are stuffed, those before the tail. */
static inline unsigned put_levels(uint64_t level[4], const plain_bytes *plain)
{
    cw_stuffed p = {.state = CW_STUFF_FIRST};
    unsigned at = 0, n = CW_STUFF_BYTES;
    cw_stuff_five(&p, plain->first);
    cw_append_stuffed(level, &at, &p, plain->pad_bits);
    for (; n + CW_STUFF_BYTES <= plain->count; n += CW_STUFF_BYTES) {
        cw_stuff_five(&p, plain->first + n);
        cw_append_stuffed(level, &at, &p, 0);
    }
    p.level = p.lengths = 0;
    for (; n < plain->count; n++)
        cw_stuff_byte(&p, plain->first[n]);
    if (p.lengths > 0)
        cw_append_stuffed(level, &at, &p, 0);
    unsigned stuffed = at;
    cw_append(level, &at, (UINT64_C(1) << CW_TAIL_BITS) - 1, CW_TAIL_BITS);
    return stuffed;
}

/* Encodes a classical frame. inverted: bits of the CRC sequence, and deviations moved by
 * CW_DEVIATES_SHIFT. */
static void encode(cw_bits *bits, const cw_frame *frame, unsigned inverted)
{
    plain_bytes plain;
    uint64_t level[4] = {0}; /* one more than needed, so that cw_append() need not look */
    content c = content_of(frame);
    if (inverted >> CW_DEVIATES_SHIFT)
        deviate(&c, cw_frame_is_extended(frame), inverted >> CW_DEVIATES_SHIFT);
    bits->crc = lay_out(&plain, &c, inverted & CW_CRC_MASK);
    bits->length = (uint16_t)(put_levels(level, &plain) + CW_TAIL_BITS);
    bits->bytes = (uint8_t)c.length;
    bits->format = cw_frame_is_extended(frame) ? CW_BITS_EXTENDED : 0;
    bits->level[0] = level[0];
    bits->level[1] = level[1];
    bits->level[2] = level[2];
}

cw_status cw_bits_encode_crc(cw_bits *bits, const cw_frame *frame, unsigned inverted)
{
    if (!cw_frame_valid(frame))
        return CW_INVALID;
    if (cw_frame_is_fd(frame))
        cw_bits_encode_fd(bits, frame, inverted);
    else
        encode(bits, frame, inverted);
    return CW_OK;
}

bool cw_frame_can_deviate(const cw_frame *frame, unsigned deviations)
{
    const unsigned possible = CW_DEVIATES_R0 | (cw_frame_is_extended(frame)
                                                    ? CW_DEVIATES_SRR | CW_DEVIATES_R1 : 0);
    return !cw_frame_is_fd(frame) && (deviations & ~possible) == 0;
}

cw_status cw_bits_encode_deviant(cw_bits *bits, const cw_frame *frame, unsigned deviations)
{
    if (!cw_frame_can_deviate(frame, deviations))
        return CW_INVALID;
    return cw_bits_encode_crc(bits, frame, deviations << CW_DEVIATES_SHIFT);
}

cw_status cw_bits_encode(cw_bits *bits, const cw_frame *frame)
{
    return cw_bits_encode_crc(bits, frame, 0);
}

unsigned cw_bits_measure_classical(const cw_frame *frame)
{
    plain_bytes plain;
    cw_stuffed all = {.state = CW_STUFF_FIRST};
    const content c = content_of(frame);
    (void)lay_out(&plain, &c, 0);
    unsigned n = 0;
    for (; n + CW_STUFF_BYTES <= plain.count; n += CW_STUFF_BYTES)
        cw_measure_five(&all, plain.first + n);
    for (; n < plain.count; n++)
        cw_measure_byte(&all, plain.first[n]);
    return (unsigned)(all.lengths & LENGTHS_MASK) - plain.pad_bits + CW_TAIL_BITS;
}

/* In the last two bytes are at least 16 wire bits. Rows of equal bits have at most five, so that an
 * edge to dominant is among the last eleven. */
unsigned cw_bits_last_edge(const cw_frame *frame, unsigned *length)
{
    plain_bytes plain;
    cw_stuffed all = {.state = CW_STUFF_FIRST};
    const content c = content_of(frame);
    (void)lay_out(&plain, &c, 0);
    for (unsigned n = 0; n + 2 < plain.count; n++)
        cw_measure_byte(&all, plain.first[n]);
    cw_stuff_byte(&all, plain.first[plain.count - 2]);
    cw_stuff_byte(&all, plain.first[plain.count - 1]);
    const unsigned stuffed = (unsigned)(all.lengths & LENGTHS_MASK) - plain.pad_bits;
    *length = stuffed + CW_TAIL_BITS;
    return stuffed - 1 - (unsigned)__builtin_clzll(~all.level & all.level << 1);
}

unsigned cw_frame_wire_bits(const cw_frame *frame)
{
    if (!cw_frame_valid(frame))
        return 0;
    return cw_frame_is_fd(frame) ? cw_bits_measure_fd(frame).bits
                                 : cw_bits_measure_classical(frame);
}

unsigned cw_frame_id_stuff_bits(const cw_frame *frame)
{
    const unsigned bits = (cw_frame_is_extended(frame) ? CW_EXTENDED_ARBITRATION_END - 1
                                                       : 1 + CW_BASE_ID_BITS);
    const uint32_t key = cw_arbitration_key(frame);
    unsigned stuff = 0, run = 1;
    bool last = CW_DOMINANT; /* SOF */
    for (unsigned n = 1; n < bits; n++) {
        const bool level = key >> (32u - n) & 1u;
        run = level == last ? run + 1 : 1;
        last = level;
        if (run == CW_STUFF_RUN) { /* the stuff bit is the first of another run */
            stuff++;
            last = !last;
            run = 1;
        }
    }
    return stuff;
}
