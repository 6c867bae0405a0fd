/* SPDX-License-Identifier: MIT
 *
 * parts.h - the format of a frame: the one table of its parts, and which part follows which.
 *
 * Base and extended frames, classical and FD, are four paths through the table. The level of the
 * last bit of a part selects the next part; IDE and FDF choose between the formats. The lengths of
 * some parts follow from the header (cw_form): a classical frame has no bit of the stuff count. A
 * sender walks the table by the levels that it sends (walk.h), and a controller by those that it
 * samples (mac.c). The properties that all frames of a format share are computed when canwire is
 * built. For that generate/main.c walks the table, too: layout.h has the numbers, tables.h the
 * tables. No number of this table is written elsewhere.
 */
#ifndef CANWIRE_FORMAT_PARTS_H
#define CANWIRE_FORMAT_PARTS_H

#include "canwire.h"

#define CW_STUFF_RUN 5u /* equal bits after which a stuff bit comes (F7) */

#define CW_FIXED_STUFF_DISTANCE 4u /* bits that follow each fixed stuff bit (D4) */

/* The gaps after a frame (F1, M8). */
#define CW_INTERMISSION_BITS 3u
#define CW_SUSPEND_BITS 8u

/* The most wire bits that a number of bits to be stuffed can become. */
#define CW_STUFFED_BITS_MAX(bits) ((bits) + ((bits)-1) / (CW_STUFF_RUN - 1))

/* The order is that of the wire: a part leads to later parts only. */
typedef enum cw_part {
    CW_PART_SOF = 0,
    CW_PART_BASE_ID,
    CW_PART_SRR_RTR, /* RTR or SRR; only the IDE after it tells them apart (F5) */
    CW_PART_IDE,
    CW_PART_EXTENDED_ID,
    CW_PART_RTR,
    CW_PART_R1,          /* of an extended frame, r1 or FDF */
    CW_PART_EXTENDED_R0,
    CW_PART_R0,          /* of a base frame, r0 or FDF */
    CW_PART_RES,         /* res to ESI: of FD frames (D1) */
    CW_PART_BRS,
    CW_PART_ESI,
    CW_PART_DLC,
    CW_PART_DATA,
    CW_PART_STUFF_COUNT, /* of FD frames (D5) */
    CW_PART_CRC,
    CW_PART_CRC_DELIMITER,
    CW_PART_ACK_SLOT,
    CW_PART_SECOND_ACK,  /* of FD frames (D7) */
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
#define CW_PART_FIXED_STUFFED 0x40u /* in FD frames it has fixed stuff bits instead (D4) */
#define CW_PART_IN_FD_CRC 0x80u   /* the CRC of an FD frame covers it, with stuff bits (D6) */
#define CW_PART_DATA_RATE 0x100u  /* at the data rate, when BRS is recessive (D10) */

/* The effect that the end of a part has on a controller. */
typedef enum cw_effect {
    CW_EFFECT_NONE = 0,
    CW_EFFECT_TAKE_ID,    /* its bits follow those of the identifier that are there already */
    CW_EFFECT_TAKE_RTR,
    CW_EFFECT_TAKE_IDE,
    CW_EFFECT_TAKE_FDF,   /* a classical frame goes on at either level, unless it is an exception */
    CW_EFFECT_TAKE_RES,
    CW_EFFECT_TAKE_BRS,
    CW_EFFECT_TAKE_ESI,
    CW_EFFECT_TAKE_DLC,
    CW_EFFECT_JUDGE_STUFF_COUNT, /* D15 */
    CW_EFFECT_JUDGE_CRC,
    CW_EFFECT_END_DATA_PHASE,    /* D10 */
    CW_EFFECT_JUDGE_ACK,  /* M5, R8 */
    CW_EFFECT_JUDGE_SECOND_ACK,  /* D7 */
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

/* The lengths of parts, as far as the header tells. */
typedef struct cw_form {
    uint16_t data_bits;
    bool fd;
    bool non_iso; /* without stuff count */
} cw_form;

#define CW_CRC17_BYTES_MAX 16u /* of data, with the shorter CRC of FD frames (D6) */

/* Returns the bits of a part; 0: the frame does not have it. */
unsigned cw_part_bits(cw_part part, const cw_form *form);

/* Returns the number of the format in tables.h. */
static inline unsigned cw_format(bool extended, bool fd)
{
    return (extended ? 1u : 0u) + (fd ? 2u : 0u);
}

#define CW_FORMATS 4u

static inline bool cw_part_is(cw_part part, unsigned flag)
{
    return cw_parts[part].flags & flag;
}

/* Returns the public name of a bit; stuff is false. extended decides between SRR and RTR, fd
 * between reserved bits and FDF. */
cw_place cw_part_place(cw_part part, unsigned index, bool extended, bool fd);

#endif
