/* SPDX-License-Identifier: MIT
 *
 * test_chars.c - what chars.c writes is what printf writes, and not a byte more; the other parts of
 * base that make texts, and read digits.
 */
#include "cases.h"
#include "base/text/chars.h"
#include "base/text/jsontext.h"
#include "base/text/memo.h"
#include "base/text/number.h"

#include <inttypes.h>

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

TEST(decimals_are_those_of_printf)
{
    for (unsigned i = 0; i < NUMBERS; i++) {
        char written[ROOM], expected[ROOM];
        memset(written, UNTOUCHED, sizeof written);
        (void)snprintf(expected, sizeof expected, "%" PRIu64, number(i));
        assert_written(written, chars_decimal(written, number(i)), expected);
    }
}

TEST(digits_are_the_last_ones_with_zeros_before)
{
    for (unsigned i = 0; i < NUMBERS; i++) {
        unsigned count = i % (CHARS_DECIMAL_MAX + 1);
        char written[ROOM], all[ROOM];
        memset(written, UNTOUCHED, sizeof written);
        (void)snprintf(all, sizeof all, "%020" PRIu64, number(i));
        assert_written(written, chars_digits(written, number(i), count),
                       all + CHARS_DECIMAL_MAX - count);
    }
}

TEST(hex_digits_are_those_of_printf)
{
    for (unsigned i = 0; i < NUMBERS; i++) {
        unsigned count = i % 9;
        char written[ROOM], all[ROOM];
        memset(written, UNTOUCHED, sizeof written);
        (void)snprintf(all, sizeof all, "%08" PRIX32, (uint32_t)number(i));
        assert_written(written, chars_hex(written, (uint32_t)number(i), count), all + 8 - count);
    }
}

TEST(bytes_are_two_digits_each)
{
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

TEST(texts_end_before_their_zero)
{
    char written[ROOM];
    memset(written, UNTOUCHED, sizeof written);
    assert_written(written, chars_text(chars_text(chars_text(written, "ab"), ""), "c"), "abc");
}

TEST(a_text_that_does_not_fit_is_cut)
{
    char text[8];
    size_t used = 0;
    used = chars_print(text, sizeof text, used, "%s", "abc");
    used = chars_print(text, sizeof text, used, "%u", 1234u);
    assert_string_equal(text, "abc1234");
    assert_int_equal(used, 7);
    used = chars_print(text, sizeof text, used, "%s", "xy");
    assert_int_equal(used, 9);
    assert_int_equal(chars_print(text, sizeof text, used, "%s", "z"), 9);
    assert_string_equal(text, "abc1234");
}

TEST(buffers_take_texts)
{
    buffer b = {.data = NULL};
    assert_string_equal(buffer_text(&b), "");
    buffer_put(&b, "ab");
    buffer_print(&b, "%s %u", "c", 12u);
    assert_string_equal(buffer_text(&b), "abc 12");
    assert_int_equal(buffer_length(&b), 6);
    buffer_put(&b, "!");
    assert_string_equal(buffer_text(&b), "abc 12!");
    b.no_memory = true;
    assert_null(buffer_text(&b));
    buffer_clear(&b);
    assert_string_equal(buffer_text(&b), "");
    buffer_free(&b);
}

TEST(json_has_commas_and_escapes)
{
    buffer b = {.data = NULL};
    jsontext_item(&b, "{");
    jsontext_number(&b, "n", UINT64_MAX);
    jsontext_string(&b, "s", "a\"\n\xE2\x82\xAC\xFF");
    jsontext_seconds(&b, "t", 80000001);
    jsontext_value(&b, "list", "[");
    jsontext_item(&b, "1");
    jsontext_item(&b, "{");
    jsontext_value(&b, "x", "null");
    buffer_put(&b, "}]}");
    assert_string_equal(buffer_text(&b),
                        "{\"n\":18446744073709551615,\"s\":\"a\\\"\\n????\","
                        "\"t\":1.000000012,\"list\":[1,{\"x\":null}]}");
    buffer_free(&b);
}

TEST(json_in_memory_is_the_same)
{
    char written[ROOM];
    memset(written, UNTOUCHED, sizeof written);
    char *at = AT_WORD(written, "w", "a");
    at = AT_NUMBER(at, "n", UINT64_MAX);
    at = AT_SIGNED(at, "i", INT64_MIN);
    assert_written(written, at,
                   ",\"w\":\"a\",\"n\":18446744073709551615,\"i\":-9223372036854775808");
}

/* Digits that are read: the number, and what is behind it; no digits: none. */
TEST(digits_end_where_the_number_ends)
{
    static const struct {
        const char *text;
        uint64_t most;
        const char *rest;     /* of text_take_digits(), NULL: it fails */
        const char *unpadded; /* of text_take_uint() */
    } cases[] = {
        {"12..", 12, "..", ".."}, {"13", 12, NULL, NULL}, {"007x", 7, "x", NULL},
        {"0", 0, "", ""}, {"", 9, NULL, NULL}, {"-1", 9, NULL, NULL}, {"00", 0, "", NULL},
        {"18446744073709551615", UINT64_MAX, "", ""},
        {"18446744073709551616", UINT64_MAX, NULL, NULL},
    };
    for (size_t i = 0; i < COUNT(cases); i++) {
        const char *a = cases[i].text, *b = a;
        uint64_t number = 77;
        assert_int_equal(text_take_digits(&number, &a, cases[i].most), cases[i].rest != NULL);
        assert_string_equal(a, cases[i].rest ? cases[i].rest : cases[i].text);
        assert_int_equal(number == 77, cases[i].rest == NULL);
        assert_int_equal(text_take_uint(&number, &b, cases[i].most), cases[i].unpadded != NULL);
        assert_string_equal(b, cases[i].unpadded ? cases[i].unpadded : cases[i].text);
    }
}

TEST(hex_numbers_have_up_to_eight_digits)
{
    uint32_t value = 5;
    assert_true(text_parse_hex(&value, "fFFFFFfe", 8) && value == 0xFFFFFFFE);
    assert_true(text_parse_hex(&value, "0a9", 2) && value == 0x0A);
    assert_false(text_parse_hex(&value, "000000001", 9));
    assert_false(text_parse_hex(&value, "1g", 2));
    assert_false(text_parse_hex(&value, "1", 2));
    assert_false(text_parse_hex(&value, "1", 0));
    assert_int_equal(value, 0x0A);
}

TEST(memos_grow_until_they_are_taken)
{
    memo m;
    assert_non_null(memo_begin(&m));
    fputs("a", m.out);
    assert_string_equal(memo_text(&m), "a");
    fputs("b", m.out);
    FREED char *text = memo_take(&m);
    assert_string_equal(text, "ab");
    memo_end(&m);
}

TEST(memos_forget_what_a_rewind_leaves_behind)
{
    memo m;
    assert_non_null(memo_begin(&m));
    fputs("a long text", m.out);
    assert_string_equal(memo_text(&m), "a long text");
    rewind(m.out);
    assert_string_equal(memo_text(&m), "");
    fputs("short", m.out);
    assert_string_equal(memo_text(&m), "short");
    memo_end(&m);
}
