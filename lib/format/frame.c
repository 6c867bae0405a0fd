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
    const unsigned known = CW_FRAME_EXTENDED | CW_FRAME_REMOTE;
    uint32_t max = cw_frame_is_extended(frame) ? CW_EXTENDED_ID_MAX : CW_BASE_ID_MAX;
    return frame->id <= max && frame->dlc < 1u << cw_parts[CW_PART_DLC].bits &&
           (frame->flags & ~known) == 0;
}

bool cw_frame_equal(const cw_frame *a, const cw_frame *b)
{
    return a->id == b->id && a->flags == b->flags && a->dlc == b->dlc &&
           memcmp(a->data, b->data, cw_frame_length(a)) == 0;
}

uint32_t cw_frame_can_id(const cw_frame *frame)
{
    return frame->id | (cw_frame_is_extended(frame) ? CW_FILTER_EXTENDED : 0) |
           (cw_frame_is_remote(frame) ? CW_FILTER_REMOTE : 0);
}
