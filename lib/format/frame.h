/* SPDX-License-Identifier: MIT
 *
 * frame.h - what is read off a frame before it has bits.
 */
#ifndef CANWIRE_FORMAT_FRAME_H
#define CANWIRE_FORMAT_FRAME_H

#include "canwire.h"

static inline bool cw_frame_is_extended(const cw_frame *frame)
{
    return frame->flags & CW_FRAME_EXTENDED;
}

static inline bool cw_frame_is_remote(const cw_frame *frame)
{
    return frame->flags & CW_FRAME_REMOTE;
}

/* Returns the bytes in the data field of a frame with this DLC (F3, F4). */
static inline unsigned cw_dlc_length(unsigned dlc, bool remote)
{
    if (remote)
        return 0;
    return dlc < CW_FRAME_DATA_MAX ? dlc : CW_FRAME_DATA_MAX;
}

#endif
