/* SPDX-License-Identifier: MIT
 *
 * parts.c - the table of the parts of a frame (F1..F7, D1..D7, M2, M5, M7, E1, E3, E4).
 */
#include "format/parts.h"

#include "format/crc.h"

#define BASE_ID_BITS 11u
#define EXTENDED_ID_BITS 29u
#define DLC_BITS 4u
#define EOF_BITS 7u

#define HEADER (CW_PART_STUFFED | CW_PART_MONITORED | CW_PART_IN_CRC | CW_PART_IN_FD_CRC)
#define ARBITRATION (HEADER | CW_PART_ARBITRATION)
#define FAST (HEADER | CW_PART_DATA_RATE)
#define CRC (CW_PART_STUFFED | CW_PART_FIXED_STUFFED | CW_PART_MONITORED | CW_PART_DATA_RATE)
#define COUNT (CRC | CW_PART_IN_FD_CRC)
#define RECESSIVE CW_PART_RECESSIVE

#define ALWAYS(part) {CW_PART_##part, CW_PART_##part}
#define BY_LEVEL(dominant, recessive) {CW_PART_##dominant, CW_PART_##recessive}

#define ROW(part, field, index, bits, flags, effect, next)                                         \
    [CW_PART_##part] = {CW_FIELD_##field, index, bits, CW_EFFECT_##effect, flags, next}

/* The IDE belongs to the arbitration field of an extended frame alone. It is recessive there. In a
 * base frame it is dominant, so that no node can lose arbitration by it. Receivers take SRR, RRS,
 * r1 and r0 at either level (F5, D2). */
const cw_part_info cw_parts[CW_PART_COUNT] = {
    ROW(SOF, SOF, 0, 1, HEADER, NONE, ALWAYS(BASE_ID)),
    ROW(BASE_ID, ID, 0, BASE_ID_BITS, ARBITRATION, TAKE_ID, ALWAYS(SRR_RTR)),
    ROW(SRR_RTR, RTR, 0, 1, ARBITRATION, TAKE_RTR, ALWAYS(IDE)),
    ROW(IDE, IDE, 0, 1, ARBITRATION, TAKE_IDE, BY_LEVEL(R0, EXTENDED_ID)),
    ROW(EXTENDED_ID, ID, BASE_ID_BITS, EXTENDED_ID_BITS - BASE_ID_BITS, ARBITRATION, TAKE_ID,
        ALWAYS(RTR)),
    ROW(RTR, RTR, 0, 1, ARBITRATION, TAKE_RTR, ALWAYS(R1)),
    ROW(R1, R1, 0, 1, HEADER, TAKE_FDF, BY_LEVEL(EXTENDED_R0, RES)),
    ROW(EXTENDED_R0, R0, 0, 1, HEADER, NONE, ALWAYS(DLC)),
    ROW(R0, R0, 0, 1, HEADER, TAKE_FDF, BY_LEVEL(DLC, RES)),
    ROW(RES, RES, 0, 1, HEADER, TAKE_RES, ALWAYS(BRS)),
    ROW(BRS, BRS, 0, 1, HEADER, TAKE_BRS, ALWAYS(ESI)),
    ROW(ESI, ESI, 0, 1, FAST, TAKE_ESI, ALWAYS(DLC)),
    ROW(DLC, DLC, 0, DLC_BITS, FAST, TAKE_DLC, ALWAYS(DATA)),
    ROW(DATA, DATA, 0, 0, FAST, NONE, ALWAYS(STUFF_COUNT)),
    ROW(STUFF_COUNT, STUFF_COUNT, 0, 0, COUNT, JUDGE_STUFF_COUNT, ALWAYS(CRC)),
    ROW(CRC, CRC, 0, 0, CRC, JUDGE_CRC, ALWAYS(CRC_DELIMITER)),
    ROW(CRC_DELIMITER, CRC_DELIMITER, 0, 1, RECESSIVE, END_DATA_PHASE, ALWAYS(ACK_SLOT)),
    ROW(ACK_SLOT, ACK_SLOT, 0, 1, CW_PART_ACK, JUDGE_ACK, ALWAYS(SECOND_ACK)),
    ROW(SECOND_ACK, ACK_SLOT, 1, 0, 0, JUDGE_SECOND_ACK, ALWAYS(ACK_DELIMITER)),
    ROW(ACK_DELIMITER, ACK_DELIMITER, 0, 1, RECESSIVE, SIGNAL_CRC, ALWAYS(EOF)),
    ROW(EOF, EOF, 0, EOF_BITS - 1, RECESSIVE, ACCEPT, ALWAYS(LAST_EOF)),
    ROW(LAST_EOF, EOF, EOF_BITS - 1, 1, RECESSIVE, FINISH, ALWAYS(END)),
};

static unsigned crc_bits(const cw_form *form)
{
    if (!form->fd)
        return CW_CRC15_BITS;
    return form->data_bits <= 8 * CW_CRC17_BYTES_MAX ? CW_CRC17_BITS : CW_CRC21_BITS;
}

unsigned cw_part_bits(cw_part part, const cw_form *form)
{
    switch ((unsigned)part) {
    case CW_PART_DATA:
        return form->data_bits;
    case CW_PART_STUFF_COUNT:
        return form->fd && !form->non_iso ? CW_STUFF_COUNT_BITS : 0;
    case CW_PART_CRC:
        return crc_bits(form);
    case CW_PART_SECOND_ACK:
        return form->fd;
    default:
        return cw_parts[part].bits;
    }
}

cw_place cw_part_place(cw_part part, unsigned index, bool extended, bool fd)
{
    const cw_part_info *info = &cw_parts[part];
    cw_place place = {.field = (cw_field)info->field,
                      .index = (uint16_t)(info->first_index + index)};
    if (part == CW_PART_SRR_RTR && extended)
        place.field = CW_FIELD_SRR;
    if (info->effect == CW_EFFECT_TAKE_FDF && fd)
        place.field = CW_FIELD_FDF;
    place.extended = extended;
    return place;
}
