/* SPDX-License-Identifier: MIT
 *
 * number.h - numbers, spans of time and bus time as people write them: parsing and printing.
 *
 * Parsers return NULL on success. Otherwise they return a constant or per-call message without
 * position that says what is allowed; *out is then unchanged.
 */
#ifndef CANWIRE_BASE_NUMBER_H
#define CANWIRE_BASE_NUMBER_H

#include "canwire.h"

#define TIME_TEXT_MAX 32   /* bytes of a printed bus time with its final 0 */

/* A configured span of time, kept exactly: nanoseconds plus bit times. */
typedef struct cfg_time {
    uint64_t ns;
    uint64_t bits;
} cfg_time;

/* Reads "60%" or "12.5%" as permille: 0.1% to 100%. */
const char *text_parse_percent(uint16_t *permille, const char *text);

/* Reads a decimal integer 0..2^64-1: digits only, no leading 0. */
const char *text_parse_uint(uint64_t *out, const char *text);

/* Reads the digits at the beginning of a text, and moves it behind them. Returns false, and leaves
 * all as it is, for none, and for a number beyond `most`. */
bool text_take_digits(uint64_t *out, const char **text, uint64_t most);

/* Does the same with an integer without leading 0. */
bool text_take_uint(uint64_t *out, const char **text, uint64_t most);

/* Returns the value of a hexadecimal digit, or 16. */
unsigned text_hex_digit(char c);

/* Reads a hexadecimal number of exactly `length` digits, 1 to 8. Returns false for other text. */
bool text_parse_hex(uint32_t *value, const char *text, size_t length);

/* Reads what people write for such an integer: 500k, 0.5M, 500kbit/s, 500_000, "500 000", 500000.0.
 * Returns false for a text that is none of these. A message can then say what to write. */
bool text_meant_uint(uint64_t *out, const char *text);

/* Reads a decimal fraction 0..1 such as 0.05 or 1e-5, as a fraction of 2^64 rounded down. 1 is
 * UINT64_MAX. The result is exact, without floating point. */
const char *text_parse_probability(uint64_t *out, const char *text);

/* Reads 10ms, 250us, 2s, 100bit, 1.5ms, 500ns, 1min, 1h. Only 0 may have no unit. */
const char *text_parse_time(cfg_time *out, const char *text);

/* Reads a number of bytes: 64kB, 100MB, 2GB, or KiB, MiB, GiB with powers of 1024. A number without
 * unit counts bytes. */
const char *text_parse_size(uint64_t *bytes, const char *text);

/* Reads a frequency: 16MHz, 8.333MHz, 500kHz. A number without unit counts Hz. */
const char *text_parse_frequency(uint64_t *hz, const char *text);

/* Reads a length: 40m, 12.5m, 30cm. Only 0 may have no unit. */
const char *text_parse_length(uint64_t *mm, const char *text);

/* Reads the delay of a metre of line: 5ns/m, 5.5ns/m, 5050ps/m. */
const char *text_parse_line_delay(uint64_t *ps, const char *text);

/* Reads a sample point, "87.5%" or "0.875", as permille: 10% to 99.9%. */
const char *text_parse_sample_point(uint16_t *permille, const char *text);

/* Returns the ticks of a span, rounded up, so that `<=` against ends of bits stays exact.
 * Saturates. */
uint64_t text_time_ticks(cfg_time time, cw_rate rate);

/* Returns the ticks of start + k * step, rounded up once: rounding does not accumulate.
 * Saturates. */
uint64_t text_time_ticks_sum(cfg_time start, uint64_t k, cfg_time step, cw_rate rate);

/* Returns a span in 2^-32 ticks, rounded to the nearest; at most 2^60 (3 s). */
cw_span text_time_fine(cfg_time time, cw_rate rate);

/* Returns the nanoseconds of a number of ticks of 12.5 ns, rounded down. */
static inline uint64_t text_ticks_ns(uint64_t ticks)
{
    return ticks / 2 * 25 + ticks % 2 * 12;
}

/* Returns the picoseconds of a span of 2^-32 ticks, truncated. */
static inline int64_t text_span_ps(cw_span span)
{
    return span / CW_TICK * 12500 + span % CW_TICK * 12500 / CW_TICK;
}

/* Prints bus time in seconds with 9 decimals, truncated: "0.000176000". */
char *text_print_seconds(char out[TIME_TEXT_MAX], uint64_t tick);

/* Prints a span in the largest unit that it contains: "7.204ms", "2s"; truncated to nanoseconds. */
void text_print_span(char out[TIME_TEXT_MAX], uint64_t ticks);

/* Prints nanoseconds as candump -L does: "(0000000000.000178)", truncated. */
char *text_print_log_ns(char out[TIME_TEXT_MAX], uint64_t ns);

/* Prints bus time in the same way. */
char *text_print_log_time(char out[TIME_TEXT_MAX], uint64_t tick);

#endif
