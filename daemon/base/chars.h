/* SPDX-License-Identifier: MIT
 *
 * chars.h - words and numbers into memory, where so many are written that printf would cost most.
 *
 * Each writes to `at`, where there must be room, without a final 0, and returns where it has ended.
 */
#ifndef CANWIRE_BASE_CHARS_H
#define CANWIRE_BASE_CHARS_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define CHARS_DECIMAL_MAX 20 /* characters of the largest number */

static inline char *chars_copy(char *at, const char *bytes, size_t count)
{
    memcpy(at, bytes, count);
    return at + count;
}

/* A text, without its final 0. Of a constant the compiler knows the length. */
static inline char *chars_text(char *at, const char *text)
{
    return chars_copy(at, text, strlen(text));
}

/* As many digits as it takes. */
char *chars_decimal(char *at, uint64_t value);

/* So many digits, at most CHARS_DECIMAL_MAX, the first ones 0 where it takes fewer; of a number
 * that takes more the last ones. */
char *chars_digits(char *at, uint64_t value, unsigned count);

/* The last `count` hexadecimal digits, upper case. */
char *chars_hex(char *at, uint32_t value, unsigned count);

/* Two hexadecimal digits each. */
char *chars_bytes(char *at, const uint8_t *bytes, unsigned count);

#endif
