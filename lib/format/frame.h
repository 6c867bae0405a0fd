/* SPDX-License-Identifier: MIT
 *
 * frame.h - what is read off a frame before it has bits.
 */
#ifndef CANWIRE_FORMAT_FRAME_H
#define CANWIRE_FORMAT_FRAME_H

#include "canwire.h"
#include "format/parts.h"

#include <string.h>

static inline bool cw_frame_is_extended(const cw_frame *frame)
{
    return frame->flags & CW_FRAME_EXTENDED;
}

static inline bool cw_frame_is_remote(const cw_frame *frame)
{
    return frame->flags & CW_FRAME_REMOTE;
}

static inline bool cw_frame_is_fd(const cw_frame *frame)
{
    return frame->flags & CW_FRAME_FD;
}

/* Marks an FD frame of which only the short form is there. It is no longer valid. */
static inline void cw_frame_cut(cw_frame *frame)
{
    frame->flags = (uint8_t)((frame->flags & ~CW_FRAME_FD) | CW_FRAME_CUT);
    if (frame->dlc > CW_CLASSICAL_DATA_MAX)
        frame->dlc = CW_CLASSICAL_DATA_MAX;
}

/* Returns the bytes in the data field of a classical frame with this DLC (F3, F4). */
static inline unsigned cw_dlc_length(unsigned dlc, bool remote)
{
    if (remote)
        return 0;
    return dlc < CW_CLASSICAL_DATA_MAX ? dlc : CW_CLASSICAL_DATA_MAX;
}

/* Returns the same of an FD frame (D2). */
unsigned cw_fd_dlc_length(unsigned dlc);

/* Returns the form of the frame, on which the lengths of some parts depend. */
static inline cw_form cw_frame_form(const cw_frame *frame)
{
    return (cw_form){.data_bits = (uint16_t)(8 * cw_frame_length(frame)),
                     .fd = cw_frame_is_fd(frame),
                     .non_iso = frame->flags & CW_FRAME_NON_ISO};
}

/* Returns the bytes of an entry that ends with a frame, which begins at an offset: whole words. fd:
 * the frame may be an FD frame. */
static inline size_t cw_frame_entry_size(size_t offset, bool fd)
{
    const size_t word = sizeof(uint64_t);
    const size_t end = offset + (fd ? sizeof(cw_frame) : sizeof(cw_short_frame));
    return (end + word - 1) / word * word;
}

/* Copies a frame, a classical one in its short form. */
static inline void cw_frame_copy(cw_frame *to, const cw_frame *from)
{
    memcpy(to, from, sizeof(cw_short_frame));
    if (cw_frame_is_fd(from))
        memcpy((unsigned char *)to + sizeof(cw_short_frame),
               (const unsigned char *)from + sizeof(cw_short_frame),
               sizeof(cw_frame) - sizeof(cw_short_frame));
}

#endif
