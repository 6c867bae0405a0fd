/* SPDX-License-Identifier: MIT
 *
 * frame.c - frames as their hosts see them: length, validity, equality (F3, F4, F8).
 */
#include "format/frame.h"

#include "format/parts.h"

#include <string.h>

unsigned cw_fd_dlc_length(unsigned dlc)
{
    static const uint8_t longer[] = {12, 16, 20, 24, 32, 48, 64};
    const unsigned first = CW_CLASSICAL_DATA_MAX + 1, count = sizeof longer;
    if (dlc < first)
        return dlc;
    return dlc - first < count ? longer[dlc - first] : longer[count - 1]; /* also if not valid */
}

unsigned cw_fd_dlc(unsigned bytes)
{
    unsigned dlc = 0;
    while (cw_fd_dlc_length(dlc) < bytes)
        dlc++;
    return dlc;
}

unsigned cw_frame_length(const cw_frame *frame)
{
    return cw_frame_is_fd(frame) ? cw_fd_dlc_length(frame->dlc)
                                 : cw_dlc_length(frame->dlc, cw_frame_is_remote(frame));
}

/* Returns true when the flags go together: remote frames are classical, and the bits of the control
 * field of FD frames are in these alone. */
static bool flags_valid(unsigned flags)
{
    const unsigned of_fd = CW_FRAME_FD | CW_FRAME_BRS | CW_FRAME_ESI | CW_FRAME_NON_ISO;
    if ((flags & ~(CW_FRAME_EXTENDED | CW_FRAME_REMOTE)) == 0)
        return true;
    return (flags & CW_FRAME_FD) && (flags & ~(CW_FRAME_EXTENDED | of_fd)) == 0;
}

bool cw_frame_valid(const cw_frame *frame)
{
    const uint32_t max = cw_frame_is_extended(frame) ? CW_EXTENDED_ID_MAX : CW_BASE_ID_MAX;
    return frame->id <= max && frame->dlc < 1u << cw_parts[CW_PART_DLC].bits &&
           flags_valid(frame->flags);
}

bool cw_frame_equal(const cw_frame *a, const cw_frame *b)
{
    return a->id == b->id && a->flags == b->flags && a->dlc == b->dlc &&
           memcmp(a->data, b->data, cw_frame_length(a)) == 0;
}

bool cw_frame_is_refused(const cw_frame *frame, unsigned variants)
{
    const unsigned low_bits = cw_frame_is_extended(frame) ? 22 : 4; /* behind the first seven */
    const bool high = frame->id >> low_bits == 0x7F;
    const bool is_long = !cw_frame_is_fd(frame) && frame->dlc > CW_CLASSICAL_DATA_MAX;
    return ((variants & CW_VARIANT_NO_HIGH_IDS) && high) ||
           ((variants & CW_VARIANT_NO_LONG_DLC) && is_long);
}

uint32_t cw_frame_can_id(const cw_frame *frame)
{
    return frame->id | (cw_frame_is_extended(frame) ? CW_FILTER_EXTENDED : 0) |
           (cw_frame_is_remote(frame) ? CW_FILTER_REMOTE : 0);
}
