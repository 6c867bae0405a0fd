/* SPDX-License-Identifier: MIT
 *
 * test_number_text.c - decimal numbers with a unit are read, aligned and printed exactly.
 */
#include "cases.h"
#include "campaign/space/number_text.h"

#include "canwire.h"

#include <inttypes.h>

static void assert_parsed(const char *text, int64_t mantissa, unsigned decimals, const char *unit)
{
    number_text n;
    if (!number_text_parse(&n, text))
        fail_msg("%s is no number", text);
    assert_int_equal(n.mantissa, mantissa);
    assert_int_equal(n.decimals, decimals);
    assert_string_equal(n.unit, unit);
}

TEST(numbers_are_read)
{
    assert_parsed("0", 0, 0, "");
    assert_parsed("-50", -50, 0, "");
    assert_parsed("007", 7, 0, "");
    assert_parsed("0.875", 875, 3, "");
    assert_parsed("-0.5", -5, 1, "");
    assert_parsed("1.50", 150, 2, "");
    assert_parsed("12.5us", 125, 1, "us");
    assert_parsed("60%", 60, 0, "%");
    assert_parsed("5ns/m", 5, 0, "ns/m");
    assert_parsed("999999999999999", INT64_C(999999999999999), 0, "");
    assert_parsed("1000000000000000", INT64_C(1000000000000000), 0, "");
    assert_parsed("0.123456789", 123456789, 9, "");
}

TEST(other_texts_are_no_numbers)
{
    static const char *const texts[] = {
        "", "-", ".", ".5", "5.", "+5", "1e3", "1 ms", " 1", "1.5.2", "--1", "0x10", "1.-5", "ms",
        "1000000000000001", "99999999999999999999", "0.1234567891", "1microsec", "1_0",
        "1.5\xc2\xb5s"};
    number_text n;
    for (size_t i = 0; i < COUNT(texts); i++)
        if (number_text_parse(&n, texts[i]))
            fail_msg("'%s' is a number", texts[i]);
}

static void assert_printed(const char *text, const char *expected)
{
    char found[NUMBER_TEXT_MAX];
    number_text n;
    assert_true(number_text_parse(&n, text));
    number_text_print(found, &n);
    assert_string_equal(found, expected);
}

TEST(numbers_are_printed_as_json)
{
    assert_printed("0", "0");
    assert_printed("-0.05", "-0.05");
    assert_printed("1.50", "1.50");
    assert_printed("007", "7");
    assert_printed("12.5us", "\"12.5us\"");
    assert_printed("-3%", "\"-3%\"");
    assert_printed("-999999.999999999", "-999999.999999999");
}

/* A printed number is read as the same one. */
TEST(printing_keeps_each_number)
{
    static const char *const units[] = {"", "us", "%", "ns/m"};
    for (uint64_t i = 0; i < 5000; i++) {
        char printed[NUMBER_TEXT_MAX];
        number_text n = {.mantissa = (int64_t)(cw_random(1, "m", i) % 2000000000000000u) -
                                     INT64_C(1000000000000000),
                         .decimals = (unsigned)(cw_random(1, "d", i) % 10)};
        number_text again;
        (void)strcpy(n.unit, units[i % COUNT(units)]);
        number_text_print(printed, &n);
        char *end = printed + strlen(printed) - 1;
        const bool quoted = *end == '"';
        *end = quoted ? '\0' : *end;
        assert_true(number_text_parse(&again, printed + quoted));
        assert_int_equal(again.mantissa, n.mantissa);
        assert_int_equal(again.decimals, n.decimals);
        assert_string_equal(again.unit, n.unit);
    }
}

static bool align(number_text out[3], const char *a, const char *b, const char *c)
{
    assert_true(number_text_parse(&out[0], a));
    assert_true(number_text_parse(&out[1], b));
    assert_true(number_text_parse(&out[2], c));
    return number_text_align((number_text *const[]){&out[0], &out[1], &out[2]}, 3);
}

TEST(aligned_numbers_have_the_same_decimals_and_unit)
{
    number_text n[3];
    assert_true(align(n, "0", "9.5ms", "0.25ms"));
    assert_int_equal(n[0].mantissa, 0);
    assert_int_equal(n[1].mantissa, 950);
    assert_int_equal(n[2].mantissa, 25);
    for (unsigned i = 0; i < 3; i++) {
        assert_int_equal(n[i].decimals, 2);
        assert_string_equal(n[i].unit, "ms");
    }
}

TEST(times_get_the_smallest_of_their_units)
{
    number_text n[3];
    assert_true(align(n, "-5ms", "0", "1.5us"));
    assert_int_equal(n[0].mantissa, -50000);
    assert_int_equal(n[1].mantissa, 0);
    assert_int_equal(n[2].mantissa, 15);
    assert_true(align(n, "0.5s", "1s", "100us"));
    assert_int_equal(n[0].mantissa, 500000);
    assert_int_equal(n[1].mantissa, 1000000);
    assert_int_equal(n[2].mantissa, 100);
    for (unsigned i = 0; i < 3; i++) {
        assert_int_equal(n[i].decimals, 0);
        assert_string_equal(n[i].unit, "us");
    }
}

TEST(numbers_of_two_units_are_not_aligned)
{
    number_text n[3];
    assert_false(align(n, "1us", "2%", "1us"));
    assert_false(align(n, "1h", "2ms", "1ms"));
    assert_false(align(n, "999999999999999s", "2ms", "1ms")); /* too large in ms */
    assert_false(align(n, "1", "2ms", "1ms")); /* 0 alone needs no unit */
    assert_true(align(n, "0", "2ms", "0.0"));
    assert_false(align(n, "1000000000000000", "0.1", "1")); /* too large with a decimal */
    assert_false(align(n, "-1000000000000000", "0.1", "1"));
    assert_true(align(n, "100000000000000", "0.1", "1"));
}
