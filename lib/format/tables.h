/* SPDX-License-Identifier: MIT
 *
 * tables.h - what follows from the table of parts for every frame, worked out when canwire is built
 *            (generate/main.c): positions, and CRC and stuffing of whole bytes.
 */
#ifndef CANWIRE_FORMAT_TABLES_H
#define CANWIRE_FORMAT_TABLES_H

#include "format/layout.h"
#include "format/parts.h"

/* ---- Positions, counted without stuff bits and data ------------------------------------------ */

/* Where a part begins in a base frame [0] and in an extended one [1]. What stands behind the data
 * lies further back by its bits. */
extern const uint8_t cw_part_at[2][CW_PART_COUNT];

/* Where a field lies. The identifier of an extended frame is in two parts: bits from index split on
 * lie further back by gap. A field that the frame has not is 0 bits long. */
typedef struct cw_field_span {
    uint8_t first;
    uint8_t bits;
    uint8_t split;
    uint8_t gap;
    bool behind_data;
} cw_field_span;

extern const cw_field_span cw_field_spans[2][CW_FIELD_COUNT];

/* ---- Whole bytes ----------------------------------------------------------------------------- */

#define CW_STUFF_STATES 8

/* [n][b]: what the byte b brings to the CRC when n bytes are behind it (F6). The CRC is the
 * exclusive or of what all bytes bring. Its own bits end the last byte; they bring nothing. */
extern const uint16_t cw_crc_table[CW_CRC_TABLE_BYTES][256];

/* Stuffing (F7). What a byte becomes depends on the level of the bit before it and on how many
 * of that level were in a row, 1 to 4: a run of five is followed by its stuff bit at once. That
 * state is 256 * (4 * level + run - 1); both tables are indexed by state + byte. */
#define CW_STUFF_FIRST 0u /* one dominant bit: the pad that encoding begins with is not stuffed */

/* The wire bits, the last of them in bit 63, and how many they are, 8 to 10, in bits 0..3. */
extern const uint64_t cw_stuff_table[CW_STUFF_STATES * 256];

/* The state after the byte. */
extern const uint16_t cw_stuff_next[CW_STUFF_STATES * 256];

#endif
