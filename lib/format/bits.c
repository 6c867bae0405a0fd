/* SPDX-License-Identifier: MIT
 *
 * bits.c - the wire bits of a frame by their positions (F1..F7).
 *
 * A bit's place is not stored: it follows from the number of bits before it that are not stuff
 * bits, and from the frame format.
 */
#include "format/bits.h"

#include "format/bitset.h"
#include "format/crc.h"
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

/* Adds the fixed stuff bits of an FD frame (D4). */
static void add_fixed(cw_stuffing *s, const cw_bits *bits)
{
    const unsigned begin = cw_bits_stuffed(bits), end = bits->length - CW_FD_TAIL_BITS;
    for (unsigned n = begin; n < end; n += CW_FIXED_STUFF_DISTANCE + 1)
        s->set[n / 64] |= UINT64_C(1) << (n % 64);
}

/* Finds bits that equal the four before them; the next bit is a stuff bit. The bus is recessive
 * before SOF, so older bits do not count. */
static cw_stuffing find_dynamic(const cw_bits *bits)
{
    const int stuffed = (int)cw_bits_stuffed(bits);
    cw_stuffing s = {.words = (bits->length + 63u) / 64};
    uint64_t level = 1ull << 63, two = 0, three = 0, five = 0;
    for (unsigned word = 0; word < s.words; word++) {
        const uint64_t l = bits->level[word];
        const uint64_t two_now = ~(l ^ (l << 1 | level >> 63));
        const uint64_t three_now = two_now & (two_now << 1 | two >> 63);
        const uint64_t five_now = three_now & (three_now << 2 | three >> 62);
        s.set[word] = (five_now << 1 | five >> 63) & lowest(stuffed - 64 * (int)word);
        level = l;
        two = two_now;
        three = three_now;
        five = five_now;
    }
    return s;
}

cw_stuffing cw_bits_stuffing(const cw_bits *bits)
{
    cw_stuffing s = find_dynamic(bits);
    if (cw_bits_is_fd(bits))
        add_fixed(&s, bits);
    return s;
}

/* ---- From wire bits to positions ------------------------------------------------------------- */

/* Returns the part that follows. IDE and FDF choose between the formats. */
static cw_part next_part(const cw_bits *bits, cw_part part)
{
    const bool level = part == CW_PART_IDE ? cw_bits_is_extended(bits) : cw_bits_is_fd(bits);
    return (cw_part)cw_parts[part].next[level];
}

/* Walks the table to the u-th bit that is not a stuff bit. */
static cw_place bits_find_place(const cw_bits *bits, unsigned u)
{
    const cw_form form = cw_bits_form(bits);
    cw_part part = CW_PART_SOF;
    for (unsigned length; u >= (length = cw_part_bits(part, &form)); u -= length)
        part = next_part(bits, part);
    return cw_part_place(part, u, cw_bits_is_extended(bits), form.fd);
}

/* Returns true when a wire bit is a fixed stuff bit, and its number. */
static bool is_fixed(const cw_bits *bits, unsigned n, unsigned *number)
{
    const unsigned begin = cw_bits_stuffed(bits);
    if (!cw_bits_is_fd(bits) || n < begin || n >= bits->length - CW_FD_TAIL_BITS)
        return false;
    *number = (n - begin) / (CW_FIXED_STUFF_DISTANCE + 1);
    return (n - begin) % (CW_FIXED_STUFF_DISTANCE + 1) == 0;
}

cw_place cw_bits_place(const cw_bits *bits, unsigned n)
{
    assert(n < bits->length);
    unsigned number;
    if (is_fixed(bits, n, &number))
        return (cw_place){.field = CW_FIELD_FIXED_STUFF, .index = (uint16_t)number, .stuff = true,
                          .extended = cw_bits_is_extended(bits)};
    const cw_stuffing stuffing = cw_bits_stuffing(bits);
    cw_place place = bits_find_place(bits, n - cw_bitset_count_upto(stuffing.set, n));
    place.stuff = cw_bitset_get(stuffing.set, n);
    return place;
}

bool cw_bits_is_at(const cw_bits *bits, unsigned n, cw_field field, unsigned index)
{
    unsigned found;
    return cw_bits_find(bits, &found, field, index) && found == n;
}

/* ---- From positions to wire bits ------------------------------------------------------------- */

unsigned cw_field_bits(cw_field field, bool fd)
{
    const unsigned formats = fd ? CW_FORMATS : cw_format(false, true);
    unsigned most = 0;
    switch ((unsigned)field) {
    case CW_FIELD_DATA:
        return 8 * (fd ? CW_FRAME_DATA_MAX : CW_CLASSICAL_DATA_MAX);
    case CW_FIELD_CRC:
        return fd ? CW_CRC21_BITS : CW_CRC15_BITS;
    case CW_FIELD_FIXED_STUFF:
        return fd ? CW_FD_CRC21_WIRE_BITS / (CW_FIXED_STUFF_DISTANCE + 1) + 1 : 0;
    case CW_FIELD_INTERMISSION:
        return CW_INTERMISSION_BITS;
    case CW_FIELD_SUSPEND:
        return CW_SUSPEND_BITS;
    default:
        for (unsigned format = 0; format < formats; format++)
            if (cw_field_spans[format][field].bits > most)
                most = cw_field_spans[format][field].bits;
        return most;
    }
}

/* Returns the bits of a field, where frames of one format differ. */
static unsigned bits_of(const cw_field_span *span, const cw_form *form, cw_field field)
{
    if (field == CW_FIELD_DATA)
        return form->data_bits;
    if (field == CW_FIELD_CRC)
        return cw_part_bits(CW_PART_CRC, form);
    if (field == CW_FIELD_STUFF_COUNT)
        return cw_part_bits(CW_PART_STUFF_COUNT, form);
    return span->bits;
}

/* Returns how much later a field begins than in a frame without data. */
static unsigned shift_of(const cw_field_span *span, const cw_form *form)
{
    unsigned shift = span->behind >= CW_BEHIND_DATA ? form->data_bits : 0;
    if (form->non_iso && span->behind >= CW_BEHIND_STUFF_COUNT)
        shift -= CW_STUFF_COUNT_BITS;
    if (form->fd && span->behind >= CW_BEHIND_CRC)
        shift += cw_part_bits(CW_PART_CRC, form) - CW_CRC17_BITS;
    return shift;
}

/* Finds a position when stuff bits do not count. Returns false when the frame has none. */
static inline bool find_unstuffed(unsigned *u, bool extended, const cw_form *form, cw_field field,
                                  unsigned index)
{
    const cw_field_span *span = &cw_field_spans[cw_format(extended, form->fd)][field];
    if (index >= bits_of(span, form, field))
        return false;
    *u = span->first + index + shift_of(span, form);
    if (index >= span->split)
        *u += span->gap;
    return true;
}

bool cw_frame_find(const cw_frame *frame, unsigned *n, cw_field field, unsigned index)
{
    const cw_form form = cw_frame_form(frame);
    return find_unstuffed(n, cw_frame_is_extended(frame), &form, field, index);
}

/* Adds one for each stuff bit at or before the bit. */
unsigned cw_wire_index(const cw_stuffing *stuffing, unsigned u)
{
    unsigned n = u;
    for (unsigned word = 0; word < stuffing->words; word++)
        for (uint64_t rest = stuffing->set[word]; rest; rest &= rest - 1) {
            if (64 * word + (unsigned)__builtin_ctzll(rest) > n)
                return n;
            n++;
        }
    return n;
}

/* Finds the wire bit of the index-th stuff bit. Returns false when the frame has fewer. */
static bool find_stuff_bit(const cw_stuffing *stuffing, unsigned *n, unsigned index)
{
    for (unsigned word = 0; word < stuffing->words; word++)
        for (uint64_t rest = stuffing->set[word]; rest; rest &= rest - 1)
            if (index-- == 0) {
                *n = 64 * word + (unsigned)__builtin_ctzll(rest);
                return true;
            }
    return false;
}

/* Finds a fixed stuff bit by its number. */
static bool find_fixed(const cw_bits *bits, unsigned *n, unsigned index)
{
    if (!cw_bits_is_fd(bits) || index >= bits->length) /* no product is too large */
        return false;
    *n = cw_bits_stuffed(bits) + index * (CW_FIXED_STUFF_DISTANCE + 1);
    return *n < bits->length - CW_FD_TAIL_BITS;
}

bool cw_bits_find_among(const cw_bits *bits, const cw_stuffing *stuffing, unsigned *n,
                        cw_field field, unsigned index)
{
    *n = index;
    if (field == CW_FIELD_BIT)
        return index < bits->length;
    if (field == CW_FIELD_FIXED_STUFF)
        return find_fixed(bits, n, index);
    if (field == CW_FIELD_STUFF) {
        const cw_stuffing dynamic = find_dynamic(bits);
        return find_stuff_bit(&dynamic, n, index);
    }
    unsigned u;
    const cw_form form = cw_bits_form(bits);
    if (!find_unstuffed(&u, cw_bits_is_extended(bits), &form, field, index))
        return false;
    cw_stuffing found;
    if (!stuffing) {
        found = cw_bits_stuffing(bits);
        stuffing = &found;
    }
    *n = cw_wire_index(stuffing, u);
    return true;
}

bool cw_bits_find(const cw_bits *bits, unsigned *n, cw_field field, unsigned index)
{
    return cw_bits_find_among(bits, NULL, n, field, index);
}

bool cw_bits_is_fast(const cw_bits *bits, unsigned n)
{
    unsigned brs;
    return cw_bits_find(bits, &brs, CW_FIELD_BRS, 0) &&
           cw_bits_level(bits, brs) == CW_RECESSIVE && n > brs &&
           n < bits->length - CW_FD_TAIL_BITS;
}
