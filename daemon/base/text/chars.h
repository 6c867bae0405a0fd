/* SPDX-License-Identifier: MIT
 *
 * chars.h - writes words and numbers into memory where printf would cost too much.
 *
 * Each function but the last writes to `at`, which must have room, without a final 0, and returns
 * the end.
 */
#ifndef CANWIRE_BASE_CHARS_H
#define CANWIRE_BASE_CHARS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define CHARS_DECIMAL_MAX 20 /* characters of the largest number */

/* ASCII characters that stand for themselves in JSON strings. */
extern const bool chars_plain[256];

static inline char *chars_copy(char *at, const char *bytes, size_t count)
{
    memcpy(at, bytes, count);
    return at + count;
}

/* Writes a text. The compiler knows the length of a constant. */
static inline char *chars_text(char *at, const char *text)
{
    return chars_copy(at, text, strlen(text));
}

/* Writes as many digits as the value has. */
char *chars_decimal(char *at, uint64_t value);

/* Writes the last `count` digits, at most CHARS_DECIMAL_MAX, with leading zeros. */
char *chars_digits(char *at, uint64_t value, unsigned count);

/* Writes the last `count` hexadecimal digits, upper case. */
char *chars_hex(char *at, uint32_t value, unsigned count);

/* Writes two hexadecimal digits for each byte. */
char *chars_bytes(char *at, const uint8_t *bytes, unsigned count);

/* Appends as printf() does to a text of `used` characters, as far as its `size` bytes have room.
 * Returns the length that it would have with more room. */
size_t chars_print(char *text, size_t size, size_t used, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

#endif
