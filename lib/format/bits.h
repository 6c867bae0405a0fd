/* SPDX-License-Identifier: MIT
 *
 * bits.h - the wire bits of a frame by their positions; see cw_bits in canwire.h.
 */
#ifndef CANWIRE_FORMAT_BITS_H
#define CANWIRE_FORMAT_BITS_H

#include "canwire.h"

#include "format/bitset.h"
#include "format/layout.h"
#include "format/parts.h"

/* The stuff bits of a frame, as a set of wire bits. They follow from its levels, so cw_bits does
 * not have them. */
typedef struct cw_stuffing {
    unsigned words; /* that the frame has */
    uint64_t set[CW_BIT_WORDS];
} cw_stuffing;

/* Finds the stuff bits of a frame: dynamic ones (F7), and fixed ones of an FD frame (D4). */
cw_stuffing cw_bits_stuffing(const cw_bits *bits);

/* Returns the wire bit that is the u-th one, from 0, of those that are not stuff bits. */
unsigned cw_wire_index(const cw_stuffing *stuffing, unsigned u);

/* Finds the wire bit at a position. Returns false when the frame has none. */
bool cw_bits_find(const cw_bits *bits, unsigned *n, cw_field field, unsigned index);

/* Does the same where the stuff bits of the frame are known; NULL: they are not. */
bool cw_bits_find_among(const cw_bits *bits, const cw_stuffing *stuffing, unsigned *n,
                        cw_field field, unsigned index);

/* Does the same without the frame's bits, for fields that do not depend on stuff bits. *n is the
 * bit without stuff bits before it, so at or before the wire bit. */
bool cw_frame_find(const cw_frame *frame, unsigned *n, cw_field field, unsigned index);

/* Does the same as cw_frame_wire_bits(), for a classical frame that is valid. */
unsigned cw_bits_measure_classical(const cw_frame *frame);

/* Returns the last wire bit before the ACK slot that begins with an edge to dominant, and finds the
 * length of such a frame. */
unsigned cw_bits_last_edge(const cw_frame *frame, unsigned *length);

/* Returns true when a frame has these bits, and they can deviate: CW_DEVIATES_*. */
bool cw_frame_can_deviate(const cw_frame *frame, unsigned deviations);

#define CW_DEVIATES_SHIFT 24u /* above the bits of all check sequences */
#define CW_CRC_MASK ((1u << CW_CRC_BITS) - 1)

/* Does the same as cw_bits_encode(), with some bits of the CRC sequence inverted, and the
 * deviations of a classical frame, moved by CW_DEVIATES_SHIFT. */
cw_status cw_bits_encode_crc(cw_bits *bits, const cw_frame *frame, unsigned inverted);

/* Wire bits of an FD frame. */
typedef struct cw_fd_length {
    uint16_t bits;      /* SOF to EOF */
    uint8_t behind_brs; /* number of the bit after BRS */
} cw_fd_length;

/* The same for a valid FD frame. */
void cw_bits_encode_fd(cw_bits *bits, const cw_frame *frame, unsigned inverted);
cw_fd_length cw_bits_measure_fd(const cw_frame *frame);

/* Returns the wire bits of the stuff count and the CRC of an FD frame, with fixed stuff bits. */
unsigned cw_fd_crc_wire_bits(const cw_form *form);

static inline bool cw_bits_is_fd(const cw_bits *bits)
{
    return bits->format & CW_BITS_FD;
}

static inline bool cw_bits_is_extended(const cw_bits *bits)
{
    return bits->format & CW_BITS_EXTENDED;
}

/* Returns the form of the frame, on which the lengths of some parts depend. */
static inline cw_form cw_bits_form(const cw_bits *bits)
{
    return (cw_form){.data_bits = (uint16_t)(8 * bits->bytes), .fd = cw_bits_is_fd(bits),
                     .non_iso = bits->format & CW_BITS_NON_ISO};
}

/* Returns the number of the first bits in which stuff bits follow from the levels. */
static inline unsigned cw_bits_stuffed(const cw_bits *bits)
{
    if (!cw_bits_is_fd(bits))
        return bits->length - CW_TAIL_BITS;
    const cw_form form = cw_bits_form(bits);
    return bits->length - CW_FD_TAIL_BITS - cw_fd_crc_wire_bits(&form);
}

#endif
