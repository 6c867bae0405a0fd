/* SPDX-License-Identifier: MIT
 *
 * frametext.h - frames, filters and positions in frames as people write them: parsing and printing.
 *
 * Parsers return NULL on success. Otherwise they return a constant or per-call message without
 * position that says what is allowed; *out is then unchanged.
 */
#ifndef CANWIRE_TRACE_FRAMETEXT_H
#define CANWIRE_TRACE_FRAMETEXT_H

#include "canwire.h"

#define FRAME_TEXT_MAX 144 /* bytes of a printed frame with its final 0 */
#define FILTER_TEXT_MAX 24 /* bytes of a printed filter with its final 0 */

/* Reads can-utils notation: 123#DEADBEEF, 12345678#, 123#R4, 123#1122334455667788_F. Dots may
 * separate bytes. 123##1DEADBEEF is a CAN FD frame. Behind ## is a digit of flags, 1 BRS and 2 ESI.
 * The flags 4 and 8 are ignored, as the kernel sets 4 in all FD frames. Zero bytes are added up to
 * a length that FD frames can have (D2). Identifiers out of range are refused. */
const char *text_parse_frame(cw_frame *out, const char *text);

/* Prints the same notation in upper case. Invalid frames are printed, too (a bad identifier with 8
 * digits), and of a frame with CW_FRAME_CUT the bytes that are there. */
char *text_print_frame(char out[FRAME_TEXT_MAX], const cw_frame *frame);

/* Reads can-utils filter text: "123" (exact, base), "12345678" (exact, extended), "ID:MASK",
 * "ID~MASK" (inverted), and "~" with one of the first three (inverted, too). Commas separate
 * several filters. *count is the number written, at most max. */
const char *text_parse_filters(cw_filter *out, unsigned *count, unsigned max, const char *text);

/* Prints one filter in the same notation. */
void text_print_filter(char out[FILTER_TEXT_MAX], const cw_filter *filter);

/* Reads an error filter of can-utils, "#MASK", which selects classes of linux/can/error.h. */
const char *text_parse_error_mask(uint32_t *mask, const char *text);

/* Reads an identifier alone, 3 digits (base) or 8 (extended); *flags is 0 or CW_FRAME_EXTENDED. */
const char *text_parse_id(uint32_t *id, uint8_t *flags, const char *text);

/* Data bytes with wildcards, "DEAD..EF" or "DE AD x1", 1 to 8 bytes, with fd up to 64. Each
 * hexadecimal digit may be the wildcard '.' or 'x'. Blanks may separate bytes. */
typedef struct text_bytes {
    uint8_t length;
    uint8_t mask[CW_FRAME_DATA_MAX];  /* 1 where the bit is given */
    uint8_t value[CW_FRAME_DATA_MAX]; /* 0 where it is not */
} text_bytes;

const char *text_parse_bytes(text_bytes *out, const char *text, bool fd);

/* Consecutive levels of bits, "10x1": 1 recessive, 0 dominant, x unchanged. There are 1 to
 * CW_PATTERN_MAX bits, not all of them x. */
typedef struct text_levels {
    uint16_t bits;
    uint64_t level; /* bit i is the i-th level */
    uint64_t mask;  /* 1 where it is given */
} text_levels;

const char *text_parse_levels(text_levels *out, const char *text);

/* Reads a fault position: "crc[3]", "data[2.7]", "ack-slot", "stuff[1]", "bit[17]"; with fd also
 * those of CAN FD frames alone, "brs", "fixed-stuff[2]". The ack-slot of these has two bits: the
 * name alone is the first one. */
const char *text_parse_position(cw_field *field, uint16_t *index, const char *text, bool fd);

#endif
