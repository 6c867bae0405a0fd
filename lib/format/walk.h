/* SPDX-License-Identifier: MIT
 *
 * walk.h - a frame bit by bit, forward through the table of parts: slow, and easy to read.
 *
 * The caller adds stuff bits. A test compares the fast encoder (encode.c) with this walk. The
 * generator of layout.h and tables.h uses it.
 */
#ifndef CANWIRE_FORMAT_WALK_H
#define CANWIRE_FORMAT_WALK_H

#include "format/crc.h"
#include "format/frame.h"
#include "format/parts.h"

typedef struct cw_walk {
    const cw_frame *frame;
    cw_part part; /* CW_PART_END after the last bit */
    unsigned index;
    uint16_t crc; /* of the bits so far */
} cw_walk;

/* Returns the bits of a part in this frame; 0: the frame does not have the part. */
static inline unsigned cw_walk_bits(const cw_walk *w)
{
    return cw_part_bits(w->part, 8 * cw_frame_length(w->frame));
}

/* Returns the bits that a transmitter sends in a part other than DATA and CRC, as a number with the
 * last bit lowest. */
static inline uint32_t cw_part_number(cw_part part, const cw_frame *frame)
{
    const bool extended = cw_frame_is_extended(frame), remote = cw_frame_is_remote(frame);
    switch ((unsigned)part) {
    case CW_PART_BASE_ID:
        return extended ? frame->id >> cw_parts[CW_PART_EXTENDED_ID].bits : frame->id;
    case CW_PART_SRR_RTR:
        return extended || remote;
    case CW_PART_IDE:
        return extended;
    case CW_PART_EXTENDED_ID:
        return frame->id & ((1u << cw_parts[CW_PART_EXTENDED_ID].bits) - 1);
    case CW_PART_RTR:
        return remote;
    case CW_PART_DLC:
        return frame->dlc;
    default: /* SOF and reserved bits are dominant, delimiters, ACK slot and EOF recessive */
        return cw_part_is(part, CW_PART_RECESSIVE | CW_PART_ACK) ? UINT32_MAX : 0;
    }
}

/* Returns the level that a transmitter sends. */
static inline bool cw_walk_level(const cw_walk *w)
{
    if (w->part == CW_PART_DATA)
        return (w->frame->data[w->index / 8] >> (7 - w->index % 8)) & 1u;
    uint32_t number = w->part == CW_PART_CRC ? w->crc : cw_part_number(w->part, w->frame);
    return (number >> (cw_walk_bits(w) - 1 - w->index)) & 1u;
}

/* Goes to the next bit. */
static inline void cw_walk_on(cw_walk *w)
{
    const bool level = cw_walk_level(w);
    if (cw_part_is(w->part, CW_PART_IN_CRC))
        w->crc = cw_crc15_next(w->crc, level);
    if (++w->index < cw_walk_bits(w))
        return;
    w->index = 0;
    do
        w->part = (cw_part)cw_parts[w->part].next[level];
    while (w->part != CW_PART_END && cw_walk_bits(w) == 0);
}

#endif
