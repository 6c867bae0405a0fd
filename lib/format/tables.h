/* SPDX-License-Identifier: MIT
 *
 * tables.h - tables that follow from the table of parts, computed when canwire is built
 * (generate/main.c): positions, and CRC and stuffing of whole bytes.
 */
#ifndef CANWIRE_FORMAT_TABLES_H
#define CANWIRE_FORMAT_TABLES_H

#include "format/layout.h"
#include "format/parts.h"
#include "format/spans.h"

/* ---- Positions, counted without stuff bits and data ------------------------------------------ */

/* The first bit of a part in a frame of each format, see cw_format(). Parts after the data field
 * begin later by the bits of the data, and those after the CRC by what the CRC is longer. */
extern const uint8_t cw_part_at[CW_FORMATS][CW_PART_COUNT];

extern const cw_field_span cw_field_spans[CW_FORMATS][CW_FIELD_COUNT];

/* ---- Whole bytes ----------------------------------------------------------------------------- */

#define CW_STUFF_STATES 8

/* [n][b]: the share of byte b in the CRC when n bytes follow it (F6). The CRC is the exclusive or
 * of all shares. The bits of the CRC itself end the last byte and have no share. */
extern const uint16_t cw_crc_table[CW_CRC_TABLE_BYTES][256];

/* The share of the CRC's low byte and the next wire bits in the CRC after them, for FD frames (D6).
 * All bits are reversed: the first one is the lowest. */
extern const uint32_t cw_crc17_table[256];
extern const uint32_t cw_crc21_table[256];

/* Stuffing (F7). The wire bits of a byte depend on the level of the bit before it and on the run of
 * equal bits that ends there. The run is 1 to 4 bits long, since a stuff bit follows five equal
 * bits at once. The state is 256 * (4 * level + run - 1); both tables are indexed by state +
 * byte. */
#define CW_STUFF_FIRST 0u /* one dominant bit: the pad that encoding begins with is not stuffed */

/* The wire bits, the last of them in bit 63, and their number, 8 to 10, in bits 0..3. */
extern const uint64_t cw_stuff_table[CW_STUFF_STATES * 256];

/* The state after the byte. */
extern const uint16_t cw_stuff_next[CW_STUFF_STATES * 256];

#endif
