/* SPDX-License-Identifier: MIT
 *
 * chars.c - writes words and numbers into memory where printf would cost too much.
 */
#include "base/text/chars.h"

#include <assert.h>
#include <stdarg.h>
#include <stdio.h>

/* The decimal digits of 0 to 99 halve the number of divisions. */
static const char pairs[] = "00010203040506070809101112131415161718192021222324"
                            "25262728293031323334353637383940414243444546474849"
                            "50515253545556575859606162636465666768697071727374"
                            "75767778798081828384858687888990919293949596979899";

static const char hex[] = "0123456789ABCDEF";

/* The hexadecimal digits of all bytes. */
#define ROW(high)                                                                                  \
    high "0" high "1" high "2" high "3" high "4" high "5" high "6" high "7"                        \
    high "8" high "9" high "A" high "B" high "C" high "D" high "E" high "F"
static const char hex_pairs[] = ROW("0") ROW("1") ROW("2") ROW("3") ROW("4") ROW("5") ROW("6")
    ROW("7") ROW("8") ROW("9") ROW("A") ROW("B") ROW("C") ROW("D") ROW("E") ROW("F");

#define PLAIN(c) ((c) >= ' ' && (c) < 0x80 && (c) != '"' && (c) != '\\')
#define PLAIN_4(c) PLAIN(c), PLAIN((c) + 1), PLAIN((c) + 2), PLAIN((c) + 3)
#define PLAIN_16(c) PLAIN_4(c), PLAIN_4((c) + 4), PLAIN_4((c) + 8), PLAIN_4((c) + 12)
#define PLAIN_64(c) PLAIN_16(c), PLAIN_16((c) + 16), PLAIN_16((c) + 32), PLAIN_16((c) + 48)
const bool chars_plain[256] = {PLAIN_64(0), PLAIN_64(64), PLAIN_64(128), PLAIN_64(192)};

char *chars_digits(char *at, uint64_t value, unsigned count)
{
    assert(count <= CHARS_DECIMAL_MAX);
    char *const end = at + count;
    char *first = end;
    while (first - at >= 2) {
        first -= 2;
        memcpy(first, pairs + value % 100 * 2, 2);
        value /= 100;
    }
    if (first > at)
        *at = (char)('0' + value % 10);
    return end;
}

/* Returns the number of digits of a value, 1 or more: 3 for each ten bits, or one more. */
static unsigned count_digits(uint64_t value)
{
    static const uint64_t powers[CHARS_DECIMAL_MAX] = {
        UINT64_C(0), UINT64_C(10), UINT64_C(100), UINT64_C(1000), UINT64_C(10000),
        UINT64_C(100000), UINT64_C(1000000), UINT64_C(10000000), UINT64_C(100000000),
        UINT64_C(1000000000), UINT64_C(10000000000), UINT64_C(100000000000),
        UINT64_C(1000000000000), UINT64_C(10000000000000), UINT64_C(100000000000000),
        UINT64_C(1000000000000000), UINT64_C(10000000000000000), UINT64_C(100000000000000000),
        UINT64_C(1000000000000000000), UINT64_C(10000000000000000000),
    };
    const unsigned least = (64u - (unsigned)__builtin_clzll(value | 1)) * 1233 >> 12;
    return least + (value >= powers[least]);
}

char *chars_decimal(char *at, uint64_t value)
{
    if (value < 10) {
        *at = (char)('0' + value);
        return at + 1;
    }
    return chars_digits(at, value, count_digits(value));
}

char *chars_hex(char *at, uint32_t value, unsigned count)
{
    assert(count <= 2 * sizeof value);
    for (unsigned i = 0; i < count; i++)
        at[i] = hex[value >> 4 * (count - 1 - i) & 0xFu];
    return at + count;
}

char *chars_bytes(char *at, const uint8_t *bytes, unsigned count)
{
    for (unsigned i = 0; i < count; i++)
        at = chars_copy(at, hex_pairs + bytes[i] * 2u, 2);
    return at;
}

size_t chars_print(char *text, size_t size, size_t used, const char *format, ...)
{
    va_list args;
    va_start(args, format);
    const int length = used < size ? vsnprintf(text + used, size - used, format, args) : 0;
    va_end(args);
    return used + (length > 0 ? (size_t)length : 0);
}
