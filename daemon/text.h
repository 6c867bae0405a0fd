/* SPDX-License-Identifier: MIT
 *
 * text.h - frames, filters, times and bus time as people write them: parsing and printing.
 *
 * Parsers return NULL on success, else a constant or per-call message without position that says
 * what is allowed; *out is then unchanged.
 */
#ifndef CANWIRE_TEXT_H
#define CANWIRE_TEXT_H

#include "canwire.h"

#define FRAME_TEXT_MAX 160 /* bytes of a printed frame with its final 0 */
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
void text_print_frame(char out[FRAME_TEXT_MAX], const cw_frame *frame);

/* can-utils filter text: "123" (exact, base), "12345678" (exact, extended), "ID:MASK", "ID~MASK"
 * (inverted), several separated by commas. *count is the number written, at most max. */
const char *text_parse_filters(cw_filter *out, unsigned *count, unsigned max, const char *text);

/* A decimal integer 0..2^64-1: digits only, no leading 0. */
const char *text_parse_uint(uint64_t *out, const char *text);

/* A decimal fraction 0..1, as a fraction of 2^64 rounded down; 1 is UINT64_MAX. Exact. */
const char *text_parse_probability(uint64_t *out, const char *text);

/* 10ms, 250us, 2s, 100bit, 1.5ms, 500ns, 1min, 1h. A number without unit only when it is 0. */
const char *text_parse_time(cfg_time *out, const char *text);

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
void text_print_seconds(char out[TIME_TEXT_MAX], uint64_t tick);

/* Bus time as candump -L prints it: "(0000000000.000178)", truncated. */
void text_print_log_time(char out[TIME_TEXT_MAX], uint64_t tick);

#endif
