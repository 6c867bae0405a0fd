/* SPDX-License-Identifier: MIT
 *
 * encode.c - frames to wire bits (F1..F7), a byte at a time.
 *
 * The bits of a frame, not stuffed, are laid out in whole bytes. A table tells what each becomes on
 * the wire, given the bits before it. Five bytes become at most 50 bits: these are collected in one
 * word before they go to their place. Where stuff bits are is seen afterwards: behind five equal
 * bits.
 */
#include "codec.h"
#include "codec_tables.h"

#include <assert.h>

#define BASE_HEAD_BITS 19u /* SOF to the DLC */
#define EXTENDED_HEAD_BITS 39u
#define PART_BYTES 5u
#define LENGTHS_MASK 0xFFFu /* of all bytes of a frame, in the sum of their entries */
#define TAIL_BITS (3u + CW_EOF_BITS) /* delimiter, ACK slot, delimiter, EOF: all recessive */

/* Before SOF come so many bits that the CRC ends with a byte. They alternate and end recessive, so
 * they get no stuff bit; they are no part of the CRC. */
#define BASE_PAD_BITS 6u
#define EXTENDED_PAD_BITS 2u
#define PAD_PATTERN UINT64_C(0x5555555555555555)

/* What is to be sent, not stuffed, but for the CRC. The first bit is the highest one. */
typedef struct content {
    uint64_t head; /* SOF to the DLC, the DLC in the lowest bits */
    uint64_t data; /* the last byte in the lowest bits */
    unsigned head_bits;
    unsigned pad_bits;
    unsigned length; /* bytes of the data field */
} content;

typedef struct plain_bytes {
    uint8_t bytes[24]; /* 15 at most; they are written eight at a time */
    unsigned count;
    unsigned pad_bits;
} plain_bytes;

/* Wire bits of up to PART_BYTES bytes. The last bit is bit 63; the lowest bits are not clean. */
typedef struct part {
    uint64_t level;
    uint64_t lengths; /* the number of bits in its lowest six bits */
    uint32_t state;   /* of the tables */
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
    b[0] = (uint8_t)(word >> 56);
    b[1] = (uint8_t)(word >> 48);
    b[2] = (uint8_t)(word >> 40);
    b[3] = (uint8_t)(word >> 32);
    b[4] = (uint8_t)(word >> 24);
    b[5] = (uint8_t)(word >> 16);
    b[6] = (uint8_t)(word >> 8);
    b[7] = (uint8_t)word;
}

/* SOF, the IDE of a base frame, r1 and r0 are dominant: 0. */
static inline content content_of(const cw_frame *frame)
{
    unsigned remote = (frame->flags & CW_FRAME_REMOTE) != 0;
    content c = {.length = cw_dlc_length(frame->dlc, remote)};
    if (c.length > 0)
        c.data = load_be(frame->data) >> (64 - 8 * c.length);
    c.head = remote << 6 | frame->dlc;
    if (frame->flags & CW_FRAME_EXTENDED) {
        c.head |= (uint64_t)(frame->id >> 18) << 27 | UINT64_C(3) << 25 /* SRR, IDE */ |
                  (uint64_t)(frame->id & 0x3FFFFu) << 7;
        c.head_bits = EXTENDED_HEAD_BITS;
        c.pad_bits = EXTENDED_PAD_BITS;
    } else {
        c.head |= (uint64_t)frame->id << 7;
        c.head_bits = BASE_HEAD_BITS;
        c.pad_bits = BASE_PAD_BITS;
    }
    return c;
}

/* Bytes that are not there are 0 and bring nothing to it. */
static inline unsigned crc_of(const content *c)
{
    unsigned crc = 0;
    const uint16_t(*behind)[256] = cw_crc_table;
    crc ^= behind[0][c->data & 0xFF] ^ behind[1][c->data >> 8 & 0xFF];
    crc ^= behind[2][c->data >> 16 & 0xFF] ^ behind[3][c->data >> 24 & 0xFF];
    crc ^= behind[4][c->data >> 32 & 0xFF] ^ behind[5][c->data >> 40 & 0xFF];
    crc ^= behind[6][c->data >> 48 & 0xFF] ^ behind[7][c->data >> 56];
    behind += c->length;
    crc ^= behind[0][c->head & 0xFF] ^ behind[1][c->head >> 8 & 0xFF];
    crc ^= behind[2][c->head >> 16 & 0xFF] ^ behind[3][c->head >> 24 & 0xFF];
    return crc ^ behind[4][c->head >> 32];
}

/* With its pad the head is one bit more than whole bytes, with which the data begins; the CRC's 15
 * bits make it whole again. */
static inline void lay_out(plain_bytes *plain, const content *c, unsigned crc)
{
    unsigned head_bits = c->pad_bits + c->head_bits;
    uint64_t head = PAD_PATTERN << c->head_bits | c->head;
    uint64_t data = c->length > 0 ? c->data << (64 - 8 * c->length) : 0;
    uint8_t *body = plain->bytes + head_bits / 8;
    store_be(plain->bytes, head << (64 - head_bits));
    store_be(body, head << 63 | data >> 1);
    body[8] = (uint8_t)(data << 7);
    body[c->length] |= (uint8_t)(crc >> 8);
    body[c->length + 1] = (uint8_t)crc;
    plain->count = head_bits / 8 + c->length + 2;
    plain->pad_bits = c->pad_bits;
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

/* A row of bits, the first one in the lowest bit, behind those that are there. Two shifts, since
 * one by 64 bits is not defined. */
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

/* All bits from SOF on. Returns how many of them are stuffed, those before the tail. */
static inline unsigned put_levels(uint64_t level[4], const plain_bytes *plain)
{
    part p = {.state = CW_STUFF_FIRST};
    unsigned at = 0, n = PART_BYTES;
    stuff_five(&p, plain->bytes);
    append_part(level, &at, &p, plain->pad_bits);
    for (; n + PART_BYTES <= plain->count; n += PART_BYTES) {
        stuff_five(&p, plain->bytes + n);
        append_part(level, &at, &p, 0);
    }
    p.level = p.lengths = 0;
    for (; n < plain->count; n++)
        stuff_byte(&p, plain->bytes[n]);
    if (p.lengths > 0)
        append_part(level, &at, &p, 0);
    unsigned stuffed = at;
    append(level, &at, (UINT64_C(1) << TAIL_BITS) - 1, TAIL_BITS);
    return stuffed;
}

/* The lowest n bits, none when n is negative. */
static inline uint64_t lowest(int n)
{
    if (n >= 64)
        return UINT64_MAX;
    return n > 0 ? ~(UINT64_MAX << n) : 0;
}

/* Set where a bit and the four before it are equal; before SOF the bus is recessive, and what was
 * five before that does not count. Then one further: the stuff bits. */
static inline void find_stuff(uint64_t stuff[3], const uint64_t level[3], unsigned stuffed)
{
    const uint64_t *l = level;
    uint64_t two0 = ~(l[0] ^ (l[0] << 1 | 1));
    uint64_t two1 = ~(l[1] ^ (l[1] << 1 | l[0] >> 63));
    uint64_t two2 = ~(l[2] ^ (l[2] << 1 | l[1] >> 63));
    uint64_t three0 = two0 & two0 << 1;
    uint64_t three1 = two1 & (two1 << 1 | two0 >> 63);
    uint64_t three2 = two2 & (two2 << 1 | two1 >> 63);
    uint64_t five0 = three0 & three0 << 2;
    uint64_t five1 = three1 & (three1 << 2 | three0 >> 62);
    uint64_t five2 = three2 & (three2 << 2 | three1 >> 62);
    stuff[0] = five0 << 1 & lowest((int)stuffed);
    stuff[1] = (five1 << 1 | five0 >> 63) & lowest((int)stuffed - 64);
    stuff[2] = (five2 << 1 | five1 >> 63) & lowest((int)stuffed - 128);
}

cw_status cw_bits_encode_crc(cw_bits *bits, const cw_frame *frame, uint16_t inverted)
{
    if (!cw_frame_valid(frame))
        return CW_INVALID;
    plain_bytes plain;
    uint64_t level[4] = {0}; /* one more than there are, so that appending need not look */
    const content c = content_of(frame);
    uint16_t crc = (uint16_t)(crc_of(&c) ^ inverted);
    lay_out(&plain, &c, crc);
    unsigned stuffed = put_levels(level, &plain);
    assert(stuffed + TAIL_BITS <= CW_BITS_MAX);
    *bits = (cw_bits){.level = {level[0], level[1], level[2]},
                      .crc = crc,
                      .length = (uint8_t)(stuffed + TAIL_BITS),
                      .data_bits = (uint8_t)(8 * c.length),
                      .extended = frame->flags & CW_FRAME_EXTENDED};
    find_stuff(bits->stuff, level, stuffed);
    return CW_OK;
}

cw_status cw_bits_encode(cw_bits *bits, const cw_frame *frame)
{
    return cw_bits_encode_crc(bits, frame, 0);
}

/* As stuff_byte(), but only how many bits they become. */
static inline uint64_t measure(const uint8_t *bytes, unsigned count, unsigned state)
{
    uint64_t lengths = 0;
    for (unsigned n = 0; n < count; n++) {
        unsigned entry = state + bytes[n];
        lengths += cw_stuff_table[entry];
        state = cw_stuff_next[entry];
    }
    return lengths;
}

/* Each look-up waits for the one before it: so there are two rows of them at a time, of which the
 * second one begins behind a byte after which the state is known. */
static inline unsigned measure_all(const plain_bytes *plain)
{
    unsigned half = plain->count / 2;
    while (half > 0 && cw_stuff_after[plain->bytes[half - 1]] == CW_STUFF_DEPENDS)
        half--;
    unsigned state = half > 0 ? cw_stuff_after[plain->bytes[half - 1]] : CW_STUFF_FIRST;
    uint64_t lengths = measure(plain->bytes, half, CW_STUFF_FIRST) +
                       measure(plain->bytes + half, plain->count - half, state);
    return (unsigned)(lengths & LENGTHS_MASK);
}

unsigned cw_frame_wire_bits(const cw_frame *frame)
{
    if (!cw_frame_valid(frame))
        return 0;
    plain_bytes plain;
    const content c = content_of(frame);
    lay_out(&plain, &c, crc_of(&c));
    return measure_all(&plain) - plain.pad_bits + TAIL_BITS;
}
