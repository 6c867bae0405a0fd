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
    cw_place place = find_place(bits, n - cw_bitset_count_upto(bits->stuff, n));
    place.stuff = cw_bitset_get(bits->stuff, n);
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
unsigned cw_bits_wire_index(const cw_bits *bits, unsigned u)
{
    unsigned n = u;
    for (unsigned word = 0; word < CW_BIT_WORDS; word++)
        for (uint64_t rest = bits->stuff[word]; rest; rest &= rest - 1) {
            if (64 * word + (unsigned)__builtin_ctzll(rest) > n)
                return n;
            n++;
        }
    return n;
}

static bool find_stuff_bit(const cw_bits *bits, unsigned *n, unsigned index)
{
    for (unsigned word = 0; word < CW_BIT_WORDS; word++)
        for (uint64_t rest = bits->stuff[word]; rest; rest &= rest - 1)
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
    if (field == CW_FIELD_STUFF)
        return find_stuff_bit(bits, n, index);
    unsigned u;
    if (!find_unstuffed(&u, bits->extended, bits->data_bits, field, index))
        return false;
    *n = cw_bits_wire_index(bits, u);
    return true;
}
