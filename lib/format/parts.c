/* SPDX-License-Identifier: MIT
 *
 * parts.c - the table of the parts of a frame (F1..F7, M2, M5, M7, E1, E3, E4).
 */
#include "format/parts.h"

#include "format/crc.h"

#define BASE_ID_BITS 11u
#define EXTENDED_ID_BITS 29u
#define DLC_BITS 4u
#define EOF_BITS 7u

#define HEADER (CW_PART_STUFFED | CW_PART_MONITORED | CW_PART_IN_CRC)
#define ARBITRATION (HEADER | CW_PART_ARBITRATION)
#define CRC (CW_PART_STUFFED | CW_PART_MONITORED)
#define RECESSIVE CW_PART_RECESSIVE

#define ALWAYS(part) {CW_PART_##part, CW_PART_##part}
#define BY_LEVEL(dominant, recessive) {CW_PART_##dominant, CW_PART_##recessive}

#define ROW(part, field, index, bits, flags, effect, next)                                         \
    [CW_PART_##part] = {CW_FIELD_##field, index, bits, CW_EFFECT_##effect, flags, next}

/* The IDE belongs to the arbitration field of an extended frame alone. It is recessive there. In a
 * base frame it is dominant, so that no node can lose arbitration by it. Receivers take SRR, r1 and
 * r0 at either level (F5). */
const cw_part_info cw_parts[CW_PART_COUNT] = {
    ROW(SOF, SOF, 0, 1, HEADER, NONE, ALWAYS(BASE_ID)),
    ROW(BASE_ID, ID, 0, BASE_ID_BITS, ARBITRATION, TAKE_ID, ALWAYS(SRR_RTR)),
    ROW(SRR_RTR, RTR, 0, 1, ARBITRATION, TAKE_RTR, ALWAYS(IDE)),
    ROW(IDE, IDE, 0, 1, ARBITRATION, TAKE_IDE, BY_LEVEL(R0, EXTENDED_ID)),
    ROW(EXTENDED_ID, ID, BASE_ID_BITS, EXTENDED_ID_BITS - BASE_ID_BITS, ARBITRATION, TAKE_ID,
        ALWAYS(RTR)),
    ROW(RTR, RTR, 0, 1, ARBITRATION, TAKE_RTR, ALWAYS(R1)),
    ROW(R1, R1, 0, 1, HEADER, NONE, ALWAYS(R0)),
    ROW(R0, R0, 0, 1, HEADER, NONE, ALWAYS(DLC)),
    ROW(DLC, DLC, 0, DLC_BITS, HEADER, TAKE_DLC, ALWAYS(DATA)),
    ROW(DATA, DATA, 0, 0, HEADER, NONE, ALWAYS(CRC)),
    ROW(CRC, CRC, 0, CW_CRC15_BITS, CRC, JUDGE_CRC, ALWAYS(CRC_DELIMITER)),
    ROW(CRC_DELIMITER, CRC_DELIMITER, 0, 1, RECESSIVE, NONE, ALWAYS(ACK_SLOT)),
    ROW(ACK_SLOT, ACK_SLOT, 0, 1, CW_PART_ACK, JUDGE_ACK, ALWAYS(ACK_DELIMITER)),
    ROW(ACK_DELIMITER, ACK_DELIMITER, 0, 1, RECESSIVE, SIGNAL_CRC, ALWAYS(EOF)),
    ROW(EOF, EOF, 0, EOF_BITS - 1, RECESSIVE, ACCEPT, ALWAYS(LAST_EOF)),
    ROW(LAST_EOF, EOF, EOF_BITS - 1, 1, RECESSIVE, FINISH, ALWAYS(END)),
};

cw_place cw_part_place(cw_part part, unsigned index, bool extended)
{
    const cw_part_info *info = &cw_parts[part];
    cw_place place = {.field = (cw_field)info->field,
                      .index = (uint8_t)(info->first_index + index)};
    if (part == CW_PART_SRR_RTR && extended)
        place.field = CW_FIELD_SRR;
    place.extended = extended;
    return place;
}
