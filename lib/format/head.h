/* SPDX-License-Identifier: MIT
 *
 * head.h - SOF to the DLC as one number: whole fields at once, where the walk has single bits.
 */
#ifndef CANWIRE_FORMAT_HEAD_H
#define CANWIRE_FORMAT_HEAD_H

#include "format/frame.h"
#include "format/layout.h"

_Static_assert(CW_BASE_ID_MAX == (1u << CW_BASE_ID_BITS) - 1, "as the table of parts has it");
_Static_assert(CW_EXTENDED_ID_MAX == (1u << (CW_BASE_ID_BITS + CW_EXTENDED_ID_BITS)) - 1,
               "as the table of parts has it");

/* Dominant bits are 0: SOF, the IDE of a base frame, RRS, r1 and r0, res. The DLC is in the lowest
 * bits. */
typedef struct cw_head {
    uint64_t number;
    unsigned bits;
} cw_head;

/* Return SOF to DLC of a base and of an extended frame as a number, the last bit lowest (F1,
 * F2). */
static inline cw_head cw_base_head(const cw_frame *frame, bool remote, unsigned dlc)
{
    return (cw_head){.number = (uint64_t)frame->id << CW_BASE_SHIFT_BASE_ID |
                               (uint64_t)remote << CW_BASE_SHIFT_SRR_RTR | dlc,
                     .bits = CW_BASE_HEAD_BITS};
}

/* SRR and IDE are recessive; RTR stands behind the identifier (F2). */
static inline cw_head cw_extended_head(const cw_frame *frame, bool remote, unsigned dlc)
{
    const uint64_t high = frame->id >> CW_EXTENDED_ID_BITS;
    const uint64_t low = frame->id & ((1u << CW_EXTENDED_ID_BITS) - 1);
    return (cw_head){.number = high << CW_EXTENDED_SHIFT_BASE_ID |
                               UINT64_C(1) << CW_EXTENDED_SHIFT_SRR_RTR |
                               UINT64_C(1) << CW_EXTENDED_SHIFT_IDE |
                               low << CW_EXTENDED_SHIFT_EXTENDED_ID |
                               (uint64_t)remote << CW_EXTENDED_SHIFT_RTR | dlc,
                     .bits = CW_EXTENDED_HEAD_BITS};
}

/* Returns the head of an FD frame (D1). */
static inline cw_head cw_fd_head(const cw_frame *frame)
{
    const uint64_t brs = (frame->flags & CW_FRAME_BRS) != 0;
    const uint64_t esi = (frame->flags & CW_FRAME_ESI) != 0;
    const uint64_t high = frame->id >> CW_EXTENDED_ID_BITS;
    const uint64_t low = frame->id & ((1u << CW_EXTENDED_ID_BITS) - 1);
    if (!cw_frame_is_extended(frame))
        return (cw_head){.number = (uint64_t)frame->id << CW_FD_BASE_SHIFT_BASE_ID |
                                   UINT64_C(1) << CW_FD_BASE_SHIFT_R0 |
                                   brs << CW_FD_BASE_SHIFT_BRS |
                                   esi << CW_FD_BASE_SHIFT_ESI | frame->dlc,
                         .bits = CW_FD_BASE_HEAD_BITS};
    return (cw_head){.number = high << CW_FD_EXTENDED_SHIFT_BASE_ID |
                               UINT64_C(1) << CW_FD_EXTENDED_SHIFT_SRR_RTR |
                               UINT64_C(1) << CW_FD_EXTENDED_SHIFT_IDE |
                               low << CW_FD_EXTENDED_SHIFT_EXTENDED_ID |
                               UINT64_C(1) << CW_FD_EXTENDED_SHIFT_R1 |
                               brs << CW_FD_EXTENDED_SHIFT_BRS |
                               esi << CW_FD_EXTENDED_SHIFT_ESI | frame->dlc,
                     .bits = CW_FD_EXTENDED_HEAD_BITS};
}

/* Returns the arbitration field with RTR at this level, as a number; the lower one wins. Bit 31 - n
 * is the bit that the SJA1000 counts as n. */
static inline uint32_t cw_key_with_rtr(const cw_frame *frame, bool rtr)
{
    if (cw_frame_is_extended(frame))
        return (uint32_t)(cw_extended_head(frame, rtr, 0).number >>
                          (CW_EXTENDED_HEAD_BITS - CW_EXTENDED_ARBITRATION_END));
    return (uint32_t)(cw_base_head(frame, rtr, 0).number
                      << (CW_EXTENDED_ARBITRATION_END - CW_BASE_HEAD_BITS));
}

/* Returns a number that is lower for the frame that wins arbitration (M3). */
static inline uint32_t cw_arbitration_key(const cw_frame *frame)
{
    return cw_key_with_rtr(frame, cw_frame_is_remote(frame));
}

#endif
