/* SPDX-License-Identifier: MIT
 *
 * codec.h - the parts of the frame format that encoder and controller share.
 */
#ifndef CANWIRE_CODEC_H
#define CANWIRE_CODEC_H

#include "canwire.h"

#define CW_STUFF_RUN 5u  /* equal bits after which a stuff bit comes (F7) */
#define CW_CRC_BITS 15u
#define CW_BASE_ID_BITS 11u
#define CW_EXTENDED_ID_BITS 29u
#define CW_EOF_BITS 7u
#define CW_INTERMISSION_BITS 3u
#define CW_FRAME_BITS_MIN 44u /* wire bits, SOF to EOF, of the shortest frame */

/* The parts of a frame in which nothing changes but the index. SRR_RTR is the bit after the first
 * eleven identifier bits: RTR in a base frame, SRR in an extended one, which only the IDE after it
 * tells (F5). */
typedef enum cw_step {
    CW_STEP_SOF = 0,
    CW_STEP_BASE_ID,
    CW_STEP_SRR_RTR,
    CW_STEP_IDE,
    CW_STEP_EXTENDED_ID,
    CW_STEP_RTR,
    CW_STEP_R1,
    CW_STEP_R0,
    CW_STEP_DLC,
    CW_STEP_DATA,
    CW_STEP_CRC,
    CW_STEP_CRC_DELIMITER,
    CW_STEP_ACK_SLOT,
    CW_STEP_ACK_DELIMITER,
    CW_STEP_EOF,
    CW_STEP_COUNT
} cw_step;

#define CW_STEP_STUFFED 0x1u     /* stuff bits are inserted; the transmitter monitors (E1 a) */
#define CW_STEP_IN_CRC 0x2u
#define CW_STEP_ARBITRATION 0x4u /* M2; for IDE see there */
#define CW_STEP_FIXED_FORM 0x8u  /* must be recessive (E4) */

typedef struct cw_step_info {
    uint8_t field;       /* cw_field */
    uint8_t first_index; /* index of its first bit in that field */
    uint8_t length;      /* bits; 0: follows from the DLC */
    uint8_t flags;
} cw_step_info;

extern const cw_step_info cw_steps[CW_STEP_COUNT];

/* The public name of a bit; stuff is false. extended decides between SRR and RTR. */
cw_place cw_step_place(cw_step step, unsigned index, bool extended);

/* One bit further with the CRC of F6. */
static inline uint16_t cw_crc_next(uint16_t crc, bool bit)
{
    bool feedback = bit != ((crc >> (CW_CRC_BITS - 1)) & 1);
    uint16_t shifted = (uint16_t)((unsigned)crc << 1);
    return (feedback ? shifted ^ 0x4599u : shifted) & 0x7FFFu;
}

/* The step and index of the u-th bit, from 0, of those that are no stuff bits. */
cw_step cw_bits_step(const cw_bits *bits, unsigned u, uint8_t *index);

/* The wire bit that is the u-th one, from 0, of those that are no stuff bits. */
unsigned cw_bits_wire_index(const cw_bits *bits, unsigned u);

/* Finds the wire bit that cw_bits_is_at() a position; false when the frame has none. */
bool cw_bits_find(const cw_bits *bits, unsigned *n, cw_field field, unsigned index);

/* The same without the frame's bits, for fields that do not depend on stuff bits: *n is where it
 * would be without them, so not behind where it is. */
bool cw_frame_find(const cw_frame *frame, unsigned *n, cw_field field, unsigned index);

/* As cw_bits_encode(), with some bits of the CRC sequence inverted. */
cw_status cw_bits_encode_crc(cw_bits *bits, const cw_frame *frame, uint16_t inverted);

/* Bytes in the data field of a frame with this DLC (F3, F4). */
static inline unsigned cw_dlc_length(unsigned dlc, bool remote)
{
    if (remote)
        return 0;
    return dlc < 8 ? dlc : 8;
}

#endif
