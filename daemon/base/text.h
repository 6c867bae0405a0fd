/* SPDX-License-Identifier: MIT
 *
 * text.h - frames, filters, times and bus time as people write them: parsing and printing.
 *
 * Parsers return NULL on success, else a constant or per-call message without position that says
 * what is allowed; *out is then unchanged.
 */
#ifndef CANWIRE_BASE_TEXT_H
#define CANWIRE_BASE_TEXT_H

#include "canwire.h"

#define FRAME_TEXT_MAX 64  /* bytes of a printed frame with its final 0 */
#define FILTER_TEXT_MAX 24 /* bytes of a printed filter with its final 0 */
#define TIME_TEXT_MAX 32   /* bytes of a printed bus time with its final 0 */

/* A span of time as configured. Kept exactly: nanoseconds plus bit times. */
typedef struct cfg_time {
    uint64_t ns;
    uint64_t bits;
} cfg_time;

/* can-utils notation: 123#DEADBEEF, 12345678#, 123#R4, 123#1122334455667788_F, bytes may be
 * separated by dots. FD frames (##) and identifiers out of range are refused. */
const char *text_parse_frame(cw_frame *out, const char *text);

/* The same notation, upper case. Prints invalid frames too (a bad identifier with 8 digits). */
char *text_print_frame(char out[FRAME_TEXT_MAX], const cw_frame *frame);

/* can-utils filter text: "123" (exact, base), "12345678" (exact, extended), "ID:MASK", "ID~MASK"
 * (inverted), several separated by commas. *count is the number written, at most max. */
const char *text_parse_filters(cw_filter *out, unsigned *count, unsigned max, const char *text);

/* One filter in the same notation. */
void text_print_filter(char out[FILTER_TEXT_MAX], const cw_filter *filter);

/* An error filter of can-utils, "#MASK": classes of linux/can/error.h that are asked for. */
const char *text_parse_error_mask(uint32_t *mask, const char *text);

/* An identifier alone, 3 digits (base) or 8 (extended); *flags is 0 or CW_FRAME_EXTENDED. */
const char *text_parse_id(uint32_t *id, uint8_t *flags, const char *text);

/* Data bytes with wildcards, "DEAD..EF" or "DE AD x1": each hexadecimal digit may be '.' or 'x',
 * which stands for any; blanks may stand between bytes. 1 to 8 bytes. */
typedef struct text_bytes {
    uint8_t length;
    uint8_t mask[8];  /* 1 where the bit is given */
    uint8_t value[8]; /* 0 where it is not */
} text_bytes;

const char *text_parse_bytes(text_bytes *out, const char *text);

/* Levels of bits in a row, "10x1": 1 recessive, 0 dominant, x as it is. 1 to CW_PATTERN_MAX bits,
 * not all of them x. */
typedef struct text_levels {
    uint16_t bits;
    uint64_t level; /* bit i is the i-th level */
    uint64_t mask;  /* 1 where it is given */
} text_levels;

const char *text_parse_levels(text_levels *out, const char *text);

/* A part of a whole, "60%" or "12.5%", as permille: 0.1% to 100%. */
const char *text_parse_percent(uint16_t *permille, const char *text);

/* A decimal integer 0..2^64-1: digits only, no leading 0. */
const char *text_parse_uint(uint64_t *out, const char *text);

/* A decimal fraction 0..1 such as 0.05 or 1e-5, as a fraction of 2^64 rounded down; 1 is
 * UINT64_MAX. Exact, no floating point. */
const char *text_parse_probability(uint64_t *out, const char *text);

/* 10ms, 250us, 2s, 100bit, 1.5ms, 500ns, 1min, 1h. A number without unit only when it is 0. */
const char *text_parse_time(cfg_time *out, const char *text);

/* Bytes: 64kB, 100MB, 2GB, or with powers of 1024 KiB, MiB, GiB; a number without unit are
 * bytes. */
const char *text_parse_size(uint64_t *bytes, const char *text);

/* Ticks of a span, rounded up, so that `<=` against ends of bits stays exact. Saturates. */
uint64_t text_time_ticks(cfg_time time, uint32_t bit_ticks);

/* Ticks of start + k * step, rounded up once, without accumulating rounding. Saturates. */
uint64_t text_time_ticks_sum(cfg_time start, uint64_t k, cfg_time step, uint32_t bit_ticks);

/* Fault positions: "crc[3]", "data[2.7]", "ack-slot", "stuff[1]", "bit[17]" (design.md §4). */
const char *text_parse_position(cw_field *field, uint16_t *index, const char *text);

/* Nanoseconds of a number of ticks of 12.5 ns, rounded down. */
static inline uint64_t text_ticks_ns(uint64_t ticks)
{
    return ticks / 2 * 25 + ticks % 2 * 12;
}

/* Bus time in seconds with 9 decimals, truncated: "0.000176000". */
char *text_print_seconds(char out[TIME_TEXT_MAX], uint64_t tick);

/* A span as people write it, in the largest unit of which it has one: "7.204ms", "2s"; truncated to
 * nanoseconds. */
void text_print_span(char out[TIME_TEXT_MAX], uint64_t ticks);

/* Nanoseconds as candump -L prints them: "(0000000000.000178)", truncated. */
char *text_print_log_ns(char out[TIME_TEXT_MAX], uint64_t ns);

/* Bus time in the same way. */
char *text_print_log_time(char out[TIME_TEXT_MAX], uint64_t tick);

#endif
