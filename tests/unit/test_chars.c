/* SPDX-License-Identifier: MIT
 *
 * test_chars.c - what chars.c writes is what printf writes, and not a byte more.
 */
#include "base/chars.h"

#include <inttypes.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>

#include <cmocka.h>

#define COUNT(array) (sizeof(array) / sizeof(array)[0])
#define ROOM 64
#define UNTOUCHED '~'

static const uint64_t borders[] = {
    0, 1, 9, 10, 11, 99, 100, 101, 999, 1000, 4294967295, 4294967296,
    UINT64_C(9999999999), UINT64_C(10000000000), UINT64_C(9999999999999999999),
    UINT64_C(10000000000000000000), UINT64_MAX,
};

/* Returns limits first, and then numbers of any length. */
static uint64_t number(unsigned i)
{
    if (i < COUNT(borders))
        return borders[i];
    uint64_t x = i * UINT64_C(0x9E3779B97F4A7C15);
    x ^= x >> 29;
    return x * UINT64_C(0xBF58476D1CE4E5B9) >> i % 64;
}

#define NUMBERS 20000u

static void assert_written(const char written[ROOM], const char *end, const char *expected)
{
    size_t length = strlen(expected);
    assert_int_equal(end - written, length);
    assert_memory_equal(written, expected, length);
    for (size_t i = length; i < ROOM; i++)
        assert_int_equal(written[i], UNTOUCHED);
}

static void decimals_are_those_of_printf(void **state)
{
    (void)state;
    for (unsigned i = 0; i < NUMBERS; i++) {
        char written[ROOM], expected[ROOM];
        memset(written, UNTOUCHED, sizeof written);
        (void)snprintf(expected, sizeof expected, "%" PRIu64, number(i));
        assert_written(written, chars_decimal(written, number(i)), expected);
    }
}

static void digits_are_the_last_ones_with_zeros_before(void **state)
{
    (void)state;
    for (unsigned i = 0; i < NUMBERS; i++) {
        unsigned count = i % (CHARS_DECIMAL_MAX + 1);
        char written[ROOM], all[ROOM];
        memset(written, UNTOUCHED, sizeof written);
        (void)snprintf(all, sizeof all, "%020" PRIu64, number(i));
        assert_written(written, chars_digits(written, number(i), count),
                       all + CHARS_DECIMAL_MAX - count);
    }
}

static void hex_digits_are_those_of_printf(void **state)
{
    (void)state;
    for (unsigned i = 0; i < NUMBERS; i++) {
        unsigned count = i % 9;
        char written[ROOM], all[ROOM];
        memset(written, UNTOUCHED, sizeof written);
        (void)snprintf(all, sizeof all, "%08" PRIX32, (uint32_t)number(i));
        assert_written(written, chars_hex(written, (uint32_t)number(i), count), all + 8 - count);
    }
}

static void bytes_are_two_digits_each(void **state)
{
    (void)state;
    for (unsigned value = 0; value < 256; value++) {
        const uint8_t bytes[] = {(uint8_t)value, 0x0F, (uint8_t)~value};
        char written[ROOM], expected[ROOM];
        memset(written, UNTOUCHED, sizeof written);
        (void)snprintf(expected, sizeof expected, "%02X%02X%02X", bytes[0], bytes[1], bytes[2]);
        assert_written(written, chars_bytes(written, bytes, 3), expected);
        memset(written, UNTOUCHED, sizeof written);
        assert_written(written, chars_bytes(written, bytes, 0), "");
    }
}

static void texts_end_before_their_zero(void **state)
{
    char written[ROOM];
    (void)state;
    memset(written, UNTOUCHED, sizeof written);
    assert_written(written, chars_text(chars_text(chars_text(written, "ab"), ""), "c"), "abc");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(decimals_are_those_of_printf),
        cmocka_unit_test(digits_are_the_last_ones_with_zeros_before),
        cmocka_unit_test(hex_digits_are_those_of_printf),
        cmocka_unit_test(bytes_are_two_digits_each),
        cmocka_unit_test(texts_end_before_their_zero),
    };
    return cmocka_run_group_tests_name("chars", tests, NULL, NULL);
}
