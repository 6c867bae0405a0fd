/* SPDX-License-Identifier: MIT
 *
 * encode_fd.c - FD frames to wire bits (D1..D6), a byte at a time.
 *
 * The bits up to the data field have dynamic stuff bits, which the tables of classical frames know.
 * They follow from the frame alone. The CRC covers the stuffed bits, and what comes after them has
 * fixed stuff bits. So the length is known without the CRC.
 */
#include "format/bits.h"
#include "format/crc.h"
#include "format/frame.h"
#include "format/head.h"
#include "format/stuff.h"

#include <string.h>

#define PLAIN_BYTES ((CW_FD_EXTENDED_HEAD_BITS + 7) / 8 + CW_FRAME_DATA_MAX)
#define LENGTHS_MASK 0xFFFu /* the bits of all bytes of a frame, in the sum of their entries */

/* The pad before SOF has so many bits that the head fills whole bytes with it. Its bits alternate
 * and end recessive, so they get no stuff bit; the CRC does not cover them. */
#define PAD_BITS(head_bits) (8 - (head_bits) % 8)

_Static_assert(PAD_BITS(CW_FD_BASE_HEAD_BITS) < 8 && PAD_BITS(CW_FD_EXTENDED_HEAD_BITS) < 8,
               "encoding begins with a pad");
_Static_assert(CW_FRAME_BITS_MAX <= CW_BITS_MAX, "cw_bits has room for the longest frame");

/* Pad, SOF to data. */
typedef struct plain_bytes {
    uint8_t bytes[PLAIN_BYTES];
    unsigned count;
    unsigned pad_bits;
} plain_bytes;

/* ---- SOF to data ----------------------------------------------------------------------------- */

/* Returns the head with its pad before it, and the bits of the pad. */
static cw_head pad_head(const cw_frame *frame, unsigned *pad_bits)
{
    const bool extended = cw_frame_is_extended(frame);
    const cw_head head = cw_fd_head(frame);
    *pad_bits = extended ? PAD_BITS(CW_FD_EXTENDED_HEAD_BITS) : PAD_BITS(CW_FD_BASE_HEAD_BITS);
    const uint64_t pad = UINT64_C(0x55) & ((1u << *pad_bits) - 1);
    return (cw_head){.number = head.number | pad << head.bits, .bits = head.bits + *pad_bits};
}

/* Puts pad, header and data into whole bytes, without stuff bits. */
static plain_bytes lay_out(const cw_frame *frame)
{
    const unsigned length = cw_frame_length(frame);
    plain_bytes plain;
    const cw_head head = pad_head(frame, &plain.pad_bits);
    const unsigned head_bytes = head.bits / 8;
    const uint64_t padded = head.number;
    for (unsigned n = 0; n < head_bytes; n++)
        plain.bytes[n] = (uint8_t)(padded >> (8 * (head_bytes - 1 - n)));
    memcpy(plain.bytes + head_bytes, frame->data, length);
    plain.count = head_bytes + length;
    return plain;
}

static bool level_at(const uint64_t level[], unsigned n)
{
    return level[n / 64] >> (n % 64) & 1u;
}

/* Returns true when the last of some bits is a stuff bit. */
static bool ends_with_stuff_bit(const uint64_t level[], unsigned count)
{
    const bool before = level_at(level, count - 2);
    unsigned run = 1;
    while (run < CW_STUFF_RUN && level_at(level, count - 2 - run) == before)
        run++;
    return run == CW_STUFF_RUN && level_at(level, count - 1) != before;
}

/* Puts SOF to data. The first fixed stuff bit takes the place of a stuff bit at the end (D3).
 * Returns the number of bits. */
static unsigned put_stuffed(uint64_t level[], const plain_bytes *plain)
{
    cw_stuffed p = {.state = CW_STUFF_FIRST};
    unsigned at = 0, pad_bits = plain->pad_bits, n = 0;
    for (; n + CW_STUFF_BYTES <= plain->count; n += CW_STUFF_BYTES, pad_bits = 0) {
        cw_stuff_five(&p, plain->bytes + n);
        cw_append_stuffed(level, &at, &p, pad_bits);
    }
    p.level = p.lengths = 0;
    for (; n < plain->count; n++)
        cw_stuff_byte(&p, plain->bytes[n]);
    if (p.lengths > 0)
        cw_append_stuffed(level, &at, &p, pad_bits);
    if (!ends_with_stuff_bit(level, at))
        return at;
    at--;
    level[at / 64] &= ~(UINT64_C(1) << (at % 64));
    return at;
}

/* ---- CRC ------------------------------------------------------------------------------------- */

/* The CRC with all bits reversed, and how it goes on by a byte. */
typedef struct reversed_crc {
    uint32_t crc;
    unsigned bits;
    const uint32_t *table;
} reversed_crc;

/* Returns the number with that many lowest bits in reverse order. */
static uint32_t reverse(uint32_t number, unsigned bits)
{
    uint32_t reversed = 0;
    for (unsigned n = 0; n < bits; n++)
        reversed |= (number >> n & 1u) << (bits - 1 - n);
    return reversed;
}

/* Begins the CRC of an FD frame (D6). Its bits are kept in reverse order. */
static reversed_crc begin_crc(const cw_form *form)
{
    reversed_crc c = {.bits = cw_part_bits(CW_PART_CRC, form)};
    c.table = c.bits == CW_CRC17_BITS ? cw_crc17_table : cw_crc21_table;
    c.crc = reverse(cw_crc_begin(c.bits, form->non_iso), c.bits);
    return c;
}

/* Adds up to eight bits, the first of them in the lowest bit. */
static void add_bits(reversed_crc *c, unsigned levels, unsigned count)
{
    const uint32_t polynomial = c->table[0x80]; /* of the last bit of a byte alone */
    for (unsigned n = 0; n < count; n++) {
        const bool feedback = (c->crc ^ (levels >> n)) & 1u;
        c->crc = c->crc >> 1 ^ (feedback ? polynomial : 0);
    }
}

/* Adds that many levels, from the first one on, to the CRC, a byte at a time. */
static void add_levels(reversed_crc *c, const uint64_t level[], unsigned count)
{
    unsigned n = 0;
    for (; n + 8 <= count; n += 8) {
        const unsigned byte = (unsigned)(level[n / 64] >> (n % 64)) & 0xFFu;
        c->crc = c->crc >> 8 ^ c->table[(c->crc ^ byte) & 0xFFu];
    }
    if (n < count)
        add_bits(c, (unsigned)(level[n / 64] >> (n % 64)), count - n);
}

/* ---- Stuff count and CRC --------------------------------------------------------------------- */

/* Appends a number, its highest bit first, with a fixed stuff bit before each fourth bit (D4). */
static void put_fixed(uint64_t level[], unsigned *at, uint32_t number, unsigned bits)
{
    for (unsigned n = 0; n < bits; n++) {
        if (n % CW_FIXED_STUFF_DISTANCE == 0)
            cw_append(level, at, !level_at(level, *at - 1), 1);
        cw_append(level, at, number >> (bits - 1 - n) & 1u, 1);
    }
}

void cw_bits_encode_fd(cw_bits *bits, const cw_frame *frame, unsigned inverted)
{
    uint64_t level[CW_BIT_WORDS + 1] = {0}; /* so that cw_append() need not look */
    const cw_form form = cw_frame_form(frame);
    const plain_bytes plain = lay_out(frame);
    const unsigned stuff_count_bits = cw_part_bits(CW_PART_STUFF_COUNT, &form);
    unsigned at = put_stuffed(level, &plain);
    const unsigned count = cw_stuff_count(at - (8 * plain.count - plain.pad_bits));
    reversed_crc c = begin_crc(&form);
    add_levels(&c, level, at);
    if (stuff_count_bits)
        add_bits(&c, reverse(count, stuff_count_bits), stuff_count_bits);
    bits->crc = reverse(c.crc, c.bits) ^ inverted;
    put_fixed(level, &at, count, stuff_count_bits);
    put_fixed(level, &at, bits->crc, c.bits);
    cw_append(level, &at, (UINT64_C(1) << CW_FD_TAIL_BITS) - 1, CW_FD_TAIL_BITS);
    bits->length = (uint16_t)at;
    bits->bytes = (uint8_t)(form.data_bits / 8);
    bits->format = (uint8_t)(CW_BITS_FD | (cw_frame_is_extended(frame) ? CW_BITS_EXTENDED : 0) |
                             (form.non_iso ? CW_BITS_NON_ISO : 0));
    memcpy(bits->level, level, sizeof bits->level);
}

/* ---- Length ---------------------------------------------------------------------------------- */

unsigned cw_fd_crc_wire_bits(const cw_form *form)
{
    const bool longer = cw_part_bits(CW_PART_CRC, form) == CW_CRC21_BITS;
    if (form->non_iso)
        return longer ? CW_NON_ISO_CRC21_WIRE_BITS : CW_NON_ISO_CRC17_WIRE_BITS;
    return longer ? CW_FD_CRC21_WIRE_BITS : CW_FD_CRC17_WIRE_BITS;
}

/* Returns true when the stuffing of the last byte ends with a stuff bit. The entry has the wire
 * bits with the last one in bit 63. */
static bool entry_ends_with_stuff_bit(uint32_t state, uint8_t byte)
{
    const uint32_t next = cw_stuff_next[state + byte];
    const uint64_t entry = cw_stuff_table[state + byte];
    const bool after_change = next / 256 % 4 == 0; /* a run of one */
    return after_change && (entry >> 63) == (byte & 1u ? 0u : 1u);
}

static unsigned measured(const cw_stuffed *all)
{
    return (unsigned)(all->lengths & LENGTHS_MASK);
}

/* Adds the stuffed lengths of some bytes. */
static void measure_bytes(cw_stuffed *all, const uint8_t bytes[], unsigned count)
{
    unsigned n = 0;
    for (; n + CW_STUFF_BYTES <= count; n += CW_STUFF_BYTES)
        cw_measure_five(all, bytes + n);
    for (; n < count; n++)
        cw_measure_byte(all, bytes[n]);
}

/* Measures the bytes of a head but the last one, from the number, which needs no memory. */
static void measure_head(cw_stuffed *all, cw_head head)
{
    for (unsigned shift = head.bits - 8; shift > 0; shift -= 8)
        cw_measure_byte(all, (uint8_t)(head.number >> shift));
}

/* The last byte of the head begins with FDF, res and BRS, which never get a stuff bit between them.
 * Not inlined, so that it does not keep the measuring of classical frames from being inlined. */
__attribute__((noinline)) cw_fd_length cw_bits_measure_fd(const cw_frame *frame)
{
    const cw_form form = cw_frame_form(frame);
    const unsigned length = cw_frame_length(frame);
    unsigned pad_bits;
    const cw_head head = pad_head(frame, &pad_bits);
    cw_stuffed all = {.state = CW_STUFF_FIRST};
    uint8_t last = (uint8_t)head.number;
    measure_head(&all, head);
    const unsigned behind_brs = measured(&all) - pad_bits + 3;
    if (length > 0) {
        cw_measure_byte(&all, last);
        measure_bytes(&all, frame->data, length - 1);
        last = frame->data[length - 1];
    }
    const bool drops = entry_ends_with_stuff_bit(all.state, last);
    cw_measure_byte(&all, last);
    return (cw_fd_length){
        .behind_brs = (uint8_t)behind_brs,
        .bits = (uint16_t)(measured(&all) - pad_bits - drops + cw_fd_crc_wire_bits(&form) +
                           CW_FD_TAIL_BITS)};
}
