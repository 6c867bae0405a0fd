/* SPDX-License-Identifier: MIT
 *
 * parts.h - the format of a frame: the one table of its parts, and which part follows which.
 *
 * A base and an extended frame are two paths through the table. The level of the last bit of a part
 * selects the next part; IDE chooses between the formats. A sender walks the table by the levels
 * that it sends (walk.h), and a controller by those that it samples (mac.c). The properties that
 * all frames of a format share are computed when canwire is built. For that generate/main.c walks
 * the table, too: layout.h has the numbers, tables.h the tables. No number of this table is written
 * elsewhere.
 *
 * The parts of CAN FD enter as follows (D1..D10):
 *  - FDF takes the place of r0 in a base frame and of r1 in an extended one. Its recessive
 *    successor leads to res, BRS and ESI. The r0 of an extended frame becomes a row of its own.
 *  - The stuff count and the CRC have bits = 0, as DATA has: the header says how many they are.
 *    They get a flag CW_PART_FIXED_STUFFED beside CW_PART_STUFFED.
 *  - CRC-17 and CRC-21 join CRC-15 in crc.h. CW_PART_IN_CRC becomes a flag for each of them: the
 *    two long ones take stuff bits and the stuff count, too.
 *  - ESI up to the CRC delimiter get a flag CW_PART_DATA_RATE, which counts when BRS was recessive.
 *  - The ACK slot of an FD frame is two rows, which both lead to the one ACK delimiter: the first
 *    has CW_PART_ACK, the effect CW_EFFECT_JUDGE_ACK stands at the end of the second (D7).
 */
#ifndef CANWIRE_FORMAT_PARTS_H
#define CANWIRE_FORMAT_PARTS_H

#include "canwire.h"

#define CW_STUFF_RUN 5u /* equal bits after which a stuff bit comes (F7) */

/* The gaps after a frame (F1, M8). */
#define CW_INTERMISSION_BITS 3u
#define CW_SUSPEND_BITS 8u

/* The most wire bits that so many bits to be stuffed can become. */
#define CW_STUFFED_BITS_MAX(bits) ((bits) + ((bits)-1) / (CW_STUFF_RUN - 1))

/* The order is that of the wire: a part leads to later parts only. */
typedef enum cw_part {
    CW_PART_SOF = 0,
    CW_PART_BASE_ID,
    CW_PART_SRR_RTR, /* RTR or SRR; only the IDE after it tells them apart (F5) */
    CW_PART_IDE,
    CW_PART_EXTENDED_ID,
    CW_PART_RTR,
    CW_PART_R1,
    CW_PART_R0,
    CW_PART_DLC,
    CW_PART_DATA,
    CW_PART_CRC,
    CW_PART_CRC_DELIMITER,
    CW_PART_ACK_SLOT,
    CW_PART_ACK_DELIMITER,
    CW_PART_EOF,      /* up to the bit after which a receiver accepts the frame (M7) */
    CW_PART_LAST_EOF, /* its last bit */
    CW_PART_COUNT,
    CW_PART_END = CW_PART_COUNT /* follows the last part */
} cw_part;

#define CW_PART_STUFFED 0x01u     /* stuff bits are inserted, also after its last bit (F7) */
#define CW_PART_MONITORED 0x02u   /* a transmitter that sees another level has a bit error (E1 a) */
#define CW_PART_IN_CRC 0x04u      /* the CRC covers it (F6) */
#define CW_PART_ARBITRATION 0x08u /* recessive sent and dominant seen: arbitration is lost (M2) */
#define CW_PART_RECESSIVE 0x10u   /* must be recessive (E4) */
#define CW_PART_ACK 0x20u         /* receivers drive it dominant (M5) */

/* The effect that the end of a part has on a controller. */
typedef enum cw_effect {
    CW_EFFECT_NONE = 0,
    CW_EFFECT_TAKE_ID,    /* its bits follow those of the identifier that are there already */
    CW_EFFECT_TAKE_RTR,
    CW_EFFECT_TAKE_IDE,
    CW_EFFECT_TAKE_DLC,
    CW_EFFECT_JUDGE_CRC,
    CW_EFFECT_JUDGE_ACK,  /* M5, R8 */
    CW_EFFECT_SIGNAL_CRC, /* a CRC error is signalled after it (E3) */
    CW_EFFECT_ACCEPT,     /* the frame is a receiver's (M7) */
    CW_EFFECT_FINISH,     /* the frame is the transmitter's (M7), and finished */
    CW_EFFECT_COUNT
} cw_effect;

typedef struct cw_part_info {
    uint8_t field;       /* cw_field */
    uint8_t first_index; /* index of its first bit in that field */
    uint8_t bits;        /* 0: the header says, see cw_part_bits() */
    uint8_t effect;      /* cw_effect */
    uint16_t flags;      /* CW_PART_* */
    uint8_t next[2];     /* cw_part that follows, by the level of its last bit */
} cw_part_info;

extern const cw_part_info cw_parts[CW_PART_COUNT];

/* Returns the bits of a part in a frame with so many bits of data. */
static inline unsigned cw_part_bits(cw_part part, unsigned data_bits)
{
    return cw_parts[part].bits ? cw_parts[part].bits : data_bits;
}

static inline bool cw_part_is(cw_part part, unsigned flag)
{
    return cw_parts[part].flags & flag;
}

/* Returns the public name of a bit; stuff is false. extended decides between SRR and RTR. */
cw_place cw_part_place(cw_part part, unsigned index, bool extended);

#endif
