/* SPDX-License-Identifier: MIT
 *
 * bits.c - the wire bits of a frame by their positions (F1..F7).
 *
 * A bit's place is not stored: it follows from the number of bits before it that are not stuff
 * bits, and from the frame format.
 */
#include "format/bits.h"

#include "format/bitset.h"
#include "format/frame.h"
#include "format/tables.h"

#include <assert.h>

bool cw_bits_level(const cw_bits *bits, unsigned n)
{
    assert(n < bits->length);
    return cw_bitset_get(bits->level, n);
}

/* ---- Stuff bits ------------------------------------------------------------------------------ */

/* Returns the lowest n bits, none when n is negative. */
static inline uint64_t lowest(int n)
{
    if (n >= 64)
        return UINT64_MAX;
    return n > 0 ? ~(UINT64_MAX << n) : 0;
}

/* Finds bits that equal the four before them; the next bit is a stuff bit. The bus is recessive
 * before SOF, so older bits do not count. */
cw_stuffing cw_bits_stuffing(const cw_bits *bits)
{
    const uint64_t *l = bits->level;
    const int stuffed = (int)(bits->length - CW_TAIL_BITS);
    uint64_t two0 = ~(l[0] ^ (l[0] << 1 | 1));
    uint64_t two1 = ~(l[1] ^ (l[1] << 1 | l[0] >> 63));
    uint64_t two2 = ~(l[2] ^ (l[2] << 1 | l[1] >> 63));
    uint64_t three0 = two0 & two0 << 1;
    uint64_t three1 = two1 & (two1 << 1 | two0 >> 63);
    uint64_t three2 = two2 & (two2 << 1 | two1 >> 63);
    uint64_t five0 = three0 & three0 << 2;
    uint64_t five1 = three1 & (three1 << 2 | three0 >> 62);
    uint64_t five2 = three2 & (three2 << 2 | three1 >> 62);
    return (cw_stuffing){.set = {five0 << 1 & lowest(stuffed),
                                 (five1 << 1 | five0 >> 63) & lowest(stuffed - 64),
                                 (five2 << 1 | five1 >> 63) & lowest(stuffed - 128)}};
}

/* ---- From wire bits to positions ------------------------------------------------------------- */

/* Walks the table to the u-th bit that is no stuff bit. Only the IDE chooses the next part. */
static cw_place find_place(const cw_bits *bits, unsigned u)
{
    cw_part part = CW_PART_SOF;
    for (unsigned length; u >= (length = cw_part_bits(part, bits->data_bits)); u -= length)
        part = (cw_part)cw_parts[part].next[bits->extended];
    return cw_part_place(part, u, bits->extended);
}

cw_place cw_bits_place(const cw_bits *bits, unsigned n)
{
    assert(n < bits->length);
    const cw_stuffing stuffing = cw_bits_stuffing(bits);
    cw_place place = find_place(bits, n - cw_bitset_count_upto(stuffing.set, n));
    place.stuff = cw_bitset_get(stuffing.set, n);
    return place;
}

bool cw_bits_is_at(const cw_bits *bits, unsigned n, cw_field field, unsigned index)
{
    unsigned found;
    return cw_bits_find(bits, &found, field, index) && found == n;
}

/* ---- From positions to wire bits ------------------------------------------------------------- */

unsigned cw_field_bits(cw_field field)
{
    const unsigned base = cw_field_spans[0][field].bits;
    const unsigned extended = cw_field_spans[1][field].bits;
    if (field == CW_FIELD_DATA)
        return 8 * CW_FRAME_DATA_MAX;
    if (field == CW_FIELD_INTERMISSION)
        return CW_INTERMISSION_BITS;
    if (field == CW_FIELD_SUSPEND)
        return CW_SUSPEND_BITS;
    return base > extended ? base : extended;
}

/* Finds a position when stuff bits do not count. Returns false when the frame has none. */
static inline bool find_unstuffed(unsigned *u, bool extended, unsigned data_bits, cw_field field,
                                  unsigned index)
{
    const cw_field_span *span = &cw_field_spans[extended][field];
    if (index >= (field == CW_FIELD_DATA ? data_bits : span->bits))
        return false;
    *u = span->first + index;
    if (index >= span->split)
        *u += span->gap;
    if (span->behind_data)
        *u += data_bits;
    return true;
}

bool cw_frame_find(const cw_frame *frame, unsigned *n, cw_field field, unsigned index)
{
    return find_unstuffed(n, cw_frame_is_extended(frame), 8 * cw_frame_length(frame), field, index);
}

/* Adds one for each stuff bit at or before the bit. */
unsigned cw_wire_index(const cw_stuffing *stuffing, unsigned u)
{
    unsigned n = u;
    for (unsigned word = 0; word < CW_BIT_WORDS; word++)
        for (uint64_t rest = stuffing->set[word]; rest; rest &= rest - 1) {
            if (64 * word + (unsigned)__builtin_ctzll(rest) > n)
                return n;
            n++;
        }
    return n;
}

static bool find_stuff_bit(const cw_stuffing *stuffing, unsigned *n, unsigned index)
{
    for (unsigned word = 0; word < CW_BIT_WORDS; word++)
        for (uint64_t rest = stuffing->set[word]; rest; rest &= rest - 1)
            if (index-- == 0) {
                *n = 64 * word + (unsigned)__builtin_ctzll(rest);
                return true;
            }
    return false;
}

bool cw_bits_find(const cw_bits *bits, unsigned *n, cw_field field, unsigned index)
{
    *n = index;
    if (field == CW_FIELD_BIT)
        return index < bits->length;
    const cw_stuffing stuffing = cw_bits_stuffing(bits);
    if (field == CW_FIELD_STUFF)
        return find_stuff_bit(&stuffing, n, index);
    unsigned u;
    if (!find_unstuffed(&u, bits->extended, bits->data_bits, field, index))
        return false;
    *n = cw_wire_index(&stuffing, u);
    return true;
}
