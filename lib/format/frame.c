/* SPDX-License-Identifier: MIT
 *
 * frame.c - frames as their hosts see them: length, validity, equality (F3, F4, F8).
 */
#include "format/frame.h"

#include "format/parts.h"

#include <string.h>

unsigned cw_frame_length(const cw_frame *frame)
{
    return cw_dlc_length(frame->dlc, cw_frame_is_remote(frame));
}

bool cw_frame_valid(const cw_frame *frame)
{
    const unsigned base = cw_parts[CW_PART_BASE_ID].bits;
    const unsigned extended = base + cw_parts[CW_PART_EXTENDED_ID].bits;
    const unsigned known = CW_FRAME_EXTENDED | CW_FRAME_REMOTE;
    uint32_t ids = cw_frame_is_extended(frame) ? 1u << extended : 1u << base;
    return frame->id < ids && frame->dlc < 1u << cw_parts[CW_PART_DLC].bits &&
           (frame->flags & ~known) == 0;
}

bool cw_frame_equal(const cw_frame *a, const cw_frame *b)
{
    return a->id == b->id && a->flags == b->flags && a->dlc == b->dlc &&
           memcmp(a->data, b->data, cw_frame_length(a)) == 0;
}
