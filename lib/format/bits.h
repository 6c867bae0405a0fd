/* SPDX-License-Identifier: MIT
 *
 * bits.h - the wire bits of a frame by their positions; see cw_bits in canwire.h.
 */
#ifndef CANWIRE_FORMAT_BITS_H
#define CANWIRE_FORMAT_BITS_H

#include "canwire.h"

#include "format/bitset.h"

/* The stuff bits of a frame, as a set of wire bits. They follow from its levels, so cw_bits does
 * not have them. */
typedef struct cw_stuffing {
    uint64_t set[CW_BIT_WORDS];
} cw_stuffing;

cw_stuffing cw_bits_stuffing(const cw_bits *bits);

/* Returns the wire bit that is the u-th one, from 0, of those that are no stuff bits. */
unsigned cw_wire_index(const cw_stuffing *stuffing, unsigned u);

/* Finds the wire bit at a position. Returns false when the frame has none. */
bool cw_bits_find(const cw_bits *bits, unsigned *n, cw_field field, unsigned index);

/* Does the same without the frame's bits, for fields that do not depend on stuff bits. *n is the
 * bit without stuff bits before it, so at or before the wire bit. */
bool cw_frame_find(const cw_frame *frame, unsigned *n, cw_field field, unsigned index);

/* Does the same as cw_frame_wire_bits(), for a frame that is valid. */
unsigned cw_bits_measure(const cw_frame *frame);

/* Does the same as cw_bits_encode(), with some bits of the CRC sequence inverted. */
cw_status cw_bits_encode_crc(cw_bits *bits, const cw_frame *frame, uint16_t inverted);

#endif
