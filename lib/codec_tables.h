/* SPDX-License-Identifier: MIT
 *
 * codec_tables.h - CRC and stuffing of whole bytes, for the encoder.
 */
#ifndef CANWIRE_CODEC_TABLES_H
#define CANWIRE_CODEC_TABLES_H

#include <stdint.h>

#define CW_CRC_TABLE_BYTES 15 /* of the longest frame, SOF to CRC: 39 bits, 8 bytes, 15 bits */
#define CW_STUFF_STATES 8

/* [n][b]: what the byte b brings to the CRC when n bytes are behind it, the CRC's own bits, which
 * end the last byte, being 0 (F6). The CRC is the exclusive or of what all bytes bring. */
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
