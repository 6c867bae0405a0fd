/* SPDX-License-Identifier: MIT
 *
 * walk.h - a frame bit by bit, forward through the table of parts: slow, and easy to read.
 *
 * The caller adds stuff bits, and says so for the CRC of FD frames. A test compares the fast
 * encoders (encode.c, encode_fd.c) with this walk. The generator of layout.h and tables.h uses it.
 */
#ifndef CANWIRE_FORMAT_WALK_H
#define CANWIRE_FORMAT_WALK_H

#include "format/crc.h"
#include "format/frame.h"
#include "format/parts.h"

typedef struct cw_walk {
    const cw_frame *frame;
    cw_form form;
    cw_part part; /* CW_PART_END after the last bit */
    unsigned index;
    unsigned stuff_bits; /* dynamic ones so far */
    uint32_t crc; /* of the bits so far */
} cw_walk;

/* Begins the walk at SOF. */
static inline cw_walk cw_walk_begin(const cw_frame *frame)
{
    cw_walk w = {.frame = frame, .form = cw_frame_form(frame)};
    if (w.form.fd)
        w.crc = cw_crc_begin(cw_part_bits(CW_PART_CRC, &w.form), w.form.non_iso);
    return w;
}

/* Returns the bits of the present part in this frame; 0: the frame does not have the part. */
static inline unsigned cw_walk_bits(const cw_walk *w)
{
    return cw_part_bits(w->part, &w->form);
}

/* Returns the bits that a transmitter sends in a part other than DATA, STUFF_COUNT and CRC, as a
 * number with the last bit lowest. */
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
    case CW_PART_R1:
    case CW_PART_R0:
        return cw_frame_is_fd(frame);
    case CW_PART_BRS:
        return (frame->flags & CW_FRAME_BRS) != 0;
    case CW_PART_ESI:
        return (frame->flags & CW_FRAME_ESI) != 0;
    case CW_PART_DLC:
        return frame->dlc;
    default: /* SOF and reserved bits are dominant, delimiters, ACK slot and EOF recessive */
        return cw_part_is(part, CW_PART_MONITORED) ? 0 : UINT32_MAX;
    }
}

/* Returns the level that a transmitter sends. */
static inline bool cw_walk_level(const cw_walk *w)
{
    if (w->part == CW_PART_DATA)
        return (w->frame->data[w->index / 8] >> (7 - w->index % 8)) & 1u;
    uint32_t number = w->part == CW_PART_CRC           ? w->crc
                      : w->part == CW_PART_STUFF_COUNT ? cw_stuff_count(w->stuff_bits)
                                                       : cw_part_number(w->part, w->frame);
    return (number >> (cw_walk_bits(w) - 1 - w->index)) & 1u;
}

/* Adds a level to the CRC of the frame's format and length (F6, D6). */
static inline void cw_walk_add_to_crc(cw_walk *w, bool level)
{
    if (!w->form.fd)
        w->crc = cw_crc15_next((uint16_t)w->crc, level);
    else if (cw_part_bits(CW_PART_CRC, &w->form) == CW_CRC17_BITS)
        w->crc = cw_crc17_next(w->crc, level);
    else
        w->crc = cw_crc21_next(w->crc, level);
}

/* Takes a dynamic stuff bit, which the CRC of FD frames covers (D6). */
static inline void cw_walk_stuff(cw_walk *w, bool level)
{
    w->stuff_bits++;
    if (w->form.fd)
        cw_walk_add_to_crc(w, level);
}

/* Goes to the next bit. */
static inline void cw_walk_on(cw_walk *w)
{
    const bool level = cw_walk_level(w);
    if (cw_part_is(w->part, w->form.fd ? CW_PART_IN_FD_CRC : CW_PART_IN_CRC))
        cw_walk_add_to_crc(w, level);
    if (++w->index < cw_walk_bits(w))
        return;
    w->index = 0;
    do
        w->part = (cw_part)cw_parts[w->part].next[level];
    while (w->part != CW_PART_END && cw_walk_bits(w) == 0);
}

#endif
