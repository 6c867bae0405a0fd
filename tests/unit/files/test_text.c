/* SPDX-License-Identifier: MIT
 *
 * test_text.c - frames, filters, numbers, times and positions as text.
 */
#include "cases.h"
#include "base/text/number.h"
#include "trace/frametext.h"

#include <inttypes.h>

typedef struct frame_case {
    const char *text;
    const char *printed;
    uint32_t id;
    unsigned flags;
    unsigned dlc;
    unsigned last_byte; /* of the data */
} frame_case;

static const frame_case frames[] = {
    {"123#DEADBEEF", "123#DEADBEEF", 0x123, 0, 4, 0xEF},
    {"7ff#deadbeef", "7FF#DEADBEEF", 0x7FF, 0, 4, 0xEF},
    {"000#", "000#", 0, 0, 0, 0},
    {"12345678#", "12345678#", 0x12345678, CW_FRAME_EXTENDED, 0, 0},
    {"1fffffff#01", "1FFFFFFF#01", 0x1FFFFFFF, CW_FRAME_EXTENDED, 1, 1},
    {"00000123#00", "00000123#00", 0x123, CW_FRAME_EXTENDED, 1, 0},
    {"123#11.22.33", "123#112233", 0x123, 0, 3, 0x33},
    {"123#1122.3344", "123#11223344", 0x123, 0, 4, 0x44},
    {"123#R", "123#R", 0x123, CW_FRAME_REMOTE, 0, 0},
    {"123#r0", "123#R", 0x123, CW_FRAME_REMOTE, 0, 0},
    {"123#R4", "123#R4", 0x123, CW_FRAME_REMOTE, 4, 0},
    {"123#R8", "123#R8", 0x123, CW_FRAME_REMOTE, 8, 0},
    {"123#R8_9", "123#R8_9", 0x123, CW_FRAME_REMOTE, 9, 0},
    {"00000001#R8_f", "00000001#R8_F", 1, CW_FRAME_REMOTE | CW_FRAME_EXTENDED, 15, 0},
    {"123#1122334455667788", "123#1122334455667788", 0x123, 0, 8, 0x88},
    {"123#1122334455667788_9", "123#1122334455667788_9", 0x123, 0, 9, 0x88},
    {"123#11.22.33.44.55.66.77.88_F", "123#1122334455667788_F", 0x123, 0, 15, 0x88},
};

#define EIGHT "1122334455667788"
#define SIXTEEN EIGHT EIGHT
#define SIXTY_FOUR SIXTEEN SIXTEEN SIXTEEN SIXTEEN

/* D2: other lengths are rounded up. */
static const frame_case fd_frames[] = {
    {"123##0", "123##0", 0x123, CW_FRAME_FD, 0, 0},
    {"123##1deadbeef", "123##1DEADBEEF", 0x123, CW_FRAME_FD | CW_FRAME_BRS, 4, 0xEF},
    {"123##2DE.AD", "123##2DEAD", 0x123, CW_FRAME_FD | CW_FRAME_ESI, 2, 0xAD},
    {"123##3.11", "123##311", 0x123, CW_FRAME_FD | CW_FRAME_BRS | CW_FRAME_ESI, 1, 0x11},
    {"123##411", "123##011", 0x123, CW_FRAME_FD, 1, 0x11}, /* CANFD_FDF of the kernel */
    {"123##f11", "123##311", 0x123, CW_FRAME_FD | CW_FRAME_BRS | CW_FRAME_ESI, 1, 0x11},
    {"1FFFFFFF##0", "1FFFFFFF##0", 0x1FFFFFFF, CW_FRAME_FD | CW_FRAME_EXTENDED, 0, 0},
    {"00000001##3" EIGHT, "00000001##3" EIGHT, 1,
     CW_FRAME_FD | CW_FRAME_EXTENDED | CW_FRAME_BRS | CW_FRAME_ESI, 8, 0x88},
    {"123##0" EIGHT "99", "123##0" EIGHT "99000000", 0x123, CW_FRAME_FD, 9, 0},
    {"123##0" EIGHT "99AABBCC", "123##0" EIGHT "99AABBCC", 0x123, CW_FRAME_FD, 9, 0xCC},
    {"123##0" SIXTEEN, "123##0" SIXTEEN, 0x123, CW_FRAME_FD, 10, 0x88},
    {"123##0" SIXTEEN EIGHT "01", "123##0" SIXTEEN EIGHT "0100000000000000", 0x123, CW_FRAME_FD,
     13, 0},
    {"123##0" SIXTEEN SIXTEEN SIXTEEN "01",
     "123##0" SIXTEEN SIXTEEN SIXTEEN "01000000000000000000000000000000", 0x123, CW_FRAME_FD, 15,
     0},
    {"1FFFFFFF##1" SIXTY_FOUR, "1FFFFFFF##1" SIXTY_FOUR, 0x1FFFFFFF,
     CW_FRAME_FD | CW_FRAME_EXTENDED | CW_FRAME_BRS, 15, 0x88},
};

static void are_read_and_printed(const frame_case *cases, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        const frame_case *c = &cases[i];
        char printed[FRAME_TEXT_MAX];
        cw_frame frame;

        assert_null(text_parse_frame(&frame, c->text));
        assert_int_equal(frame.id, c->id);
        assert_int_equal(frame.flags, c->flags);
        assert_int_equal(frame.dlc, c->dlc);
        if (c->last_byte)
            assert_int_equal(frame.data[cw_frame_length(&frame) - 1], c->last_byte);
        text_print_frame(printed, &frame);
        assert_string_equal(printed, c->printed);
    }
}

TEST(frames_are_read_and_printed)
{
    are_read_and_printed(frames, COUNT(frames));
}

TEST(fd_frames_are_read_and_printed)
{
    are_read_and_printed(fd_frames, COUNT(fd_frames));
}

/* Each with a part of the message. */
static const char *const bad_frames[][2] = {
    {"", "expected a frame"},
    {"123", "expected a frame"},
    {"#11", "expected a frame"},
    {" 123#", "expected a frame"},
    {"0x123#", "expected a frame"},
    {"12#", "identifiers have"},
    {"1234#", "identifiers have"},
    {"800#", "up to 7FF"},
    {"20000000#", "up to 1FFFFFFF"},
    {"123456789#", "identifiers have"},
    {"123##", "one digit of flags"},
    {"123##G", "one digit of flags"},
    {"123##R4", "one digit of flags"},
    {"123##DEADBEEF", "two hexadecimal digits"}, /* the flags are missing */
    {"123##11", "two hexadecimal digits"},
    {"123##0..11", "expected a CAN FD frame"},
    {"123##011.", "expected a CAN FD frame"},
    {"123##01122334455667788_F", "expected a CAN FD frame"},
    {"123##0R", "expected a CAN FD frame"},
    {"123##0" SIXTY_FOUR "00", "at most 64"},
    {"800##0", "up to 7FF"},
    {"123#1", "two hexadecimal digits"},
    {"123#112", "two hexadecimal digits"},
    {"123#112233445566778899", "at most 8"},
    {"123#11 22", "expected a frame"},
    {"123#.11", "expected a frame"},
    {"123#11.", "expected a frame"},
    {"123#11..22", "expected a frame"},
    {"123#1.1", "two hexadecimal digits"},
    {"123#GG", "expected a frame"},
    {"123#11_9", "raw DLC"},
    {"123#1122334455667788_8", "raw DLC"},
    {"123#1122334455667788_", "raw DLC"},
    {"123#1122334455667788_FF", "raw DLC"},
    {"123#1122334455667788_G", "raw DLC"},
    {"123#R9", "R0 to R8"},
    {"123#RF", "R0 to R8"},
    {"123#R4_F", "raw DLC"},
    {"123#R_9", "R0 to R8"},
    {"123#R44", "expected a frame"},
    {"123#R8_8", "raw DLC"},
};

TEST(bad_frames_are_refused)
{
    for (size_t i = 0; i < COUNT(bad_frames); i++) {
        cw_frame frame = {.id = 0x55};
        const char *problem = text_parse_frame(&frame, bad_frames[i][0]);

        if (!problem || !strstr(problem, bad_frames[i][1]))
            fail_msg("'%s': %s", bad_frames[i][0], problem ? problem : "accepted");
        assert_int_equal(frame.id, 0x55);
    }
}

TEST(invalid_frames_are_printed)
{
    static const struct {
        cw_frame frame;
        const char *printed;
    } cases[] = {
        {{.id = 0x800}, "00000800#"},
        {{.id = 0xFFFFFFFF, .dlc = 1}, "FFFFFFFF#00"},
        {{.id = 1, .flags = CW_FRAME_FD, .dlc = 9}, "001##0000000000000000000000000"},
        {{.id = 1, .flags = CW_FRAME_CUT, .dlc = 8}, "001##00000000000000000"},
        {{.id = 1, .flags = CW_FRAME_CUT | CW_FRAME_BRS, .dlc = 2}, "001##10000"},
        {{.id = 1, .flags = CW_FRAME_FD | CW_FRAME_NON_ISO, .dlc = 1}, "001##000"},
        {{.id = 1, .flags = CW_FRAME_FD | CW_FRAME_BRS | CW_FRAME_ESI}, "001##3"},
    };
    for (size_t i = 0; i < COUNT(cases); i++) {
        char printed[FRAME_TEXT_MAX];

        text_print_frame(printed, &cases[i].frame);
        assert_string_equal(printed, cases[i].printed);
    }
}

TEST(longest_text_fits)
{
    cw_frame fd = {.id = UINT32_MAX, .flags = CW_FRAME_FD, .dlc = UINT8_MAX};
    cw_frame classic = {.id = UINT32_MAX, .flags = CW_FRAME_REMOTE, .dlc = UINT8_MAX};
    char printed[FRAME_TEXT_MAX];

    text_print_frame(printed, &fd);
    assert_int_equal(strlen(printed), 8 + 3 + 128);
    text_print_frame(printed, &classic);
    assert_string_equal(printed, "FFFFFFFF#R8_FF");
}

TEST(filters_follow_can_utils)
{
    static const struct {
        const char *text;
        cw_filter filter;
    } cases[] = {
        {"123", {0x123, 0x800007FF, false}},
        {"7ff", {0x7FF, 0x800007FF, false}},
        {"00000123", {0x80000123, 0x9FFFFFFF, false}},
        {"1FFFFFFF", {0x9FFFFFFF, 0x9FFFFFFF, false}},
        {"123:7FF", {0x123, 0x7FF, false}},
        {"123~7FF", {0x123, 0x7FF, true}},
        {"0:0", {0, 0, false}},
        {"0~0", {0, 0, true}},
        {"12345678:1FFF0000", {0x92345678, 0x1FFF0000, false}},
        {"12345678~DFFFFFFF", {0x92345678, 0xDFFFFFFF, true}},
        {"123:C00007FF", {0x123, 0xC00007FF, false}},
    };
    for (size_t i = 0; i < COUNT(cases); i++) {
        cw_filter filter = {0};
        unsigned count = 0;

        assert_null(text_parse_filters(&filter, &count, 1, cases[i].text));
        assert_int_equal(count, 1);
        assert_int_equal(filter.value, cases[i].filter.value);
        assert_int_equal(filter.mask, cases[i].filter.mask);
        assert_int_equal(filter.inverted, cases[i].filter.inverted);
    }
}

TEST(filters_are_separated_by_commas)
{
    cw_filter filters[3];
    unsigned count = 0;

    assert_null(text_parse_filters(filters, &count, 3, "123,100~700,12345678"));
    assert_int_equal(count, 3);
    assert_true(filters[1].inverted);
    assert_int_equal(filters[2].value, 0x92345678);
}

TEST(bad_filters_are_refused)
{
    static const char *const cases[] = {
        "",
        "12",
        "1234",
        "800",
        "20000000",
        "123456789",
        "0x123",
        "123,",
        ",123",
        "123 ",
        "123, 456",
        "123:",
        ":7FF",
        "123:xyz",
        "123#7FF",
        "123:7FF~7FF",
        "123:123456789",
        "20000123:7FF",
        "1,2,3,4",
        "123,456,789,7FF",
        "123,100:700,G",
    };
    for (size_t i = 0; i < COUNT(cases); i++) {
        cw_filter filters[3] = {{.value = 0x55}};
        unsigned count = 7;

        if (!text_parse_filters(filters, &count, 3, cases[i]))
            fail_msg("'%s' was accepted", cases[i]);
        assert_int_equal(count, 7);
        assert_int_equal(filters[0].value, 0x55);
    }
}

TEST(bytes_may_have_wildcards)
{
    static const struct {
        const char *text;
        unsigned length;
        const char *mask;
        const char *value;
    } cases[] = {
        {"DE", 1, "\xFF", "\xDE"},
        {"dead..ef", 4, "\xFF\xFF\x00\xFF", "\xDE\xAD\x00\xEF"},
        {"DE AD  x1", 3, "\xFF\xFF\x0F", "\xDE\xAD\x01"},
        {"1.X2", 2, "\xF0\x0F", "\x10\x02"},
        {"1122334455667788", 8, "\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF",
         "\x11\x22\x33\x44\x55\x66\x77\x88"},
    };
    static const char *const bad[] = {
        "",   " ", "1", "112", "1 1", " 11", "11 ", "11\t22", "1G", "11,22", "112233445566778899",
        "$$",
    };
    text_bytes bytes;

    for (size_t i = 0; i < COUNT(cases); i++) {
        assert_null(text_parse_bytes(&bytes, cases[i].text, i % 2));
        assert_int_equal(bytes.length, cases[i].length);
        assert_memory_equal(bytes.mask, cases[i].mask, bytes.length);
        assert_memory_equal(bytes.value, cases[i].value, bytes.length);
    }
    for (size_t i = 0; i < COUNT(bad); i++)
        if (!text_parse_bytes(&bytes, bad[i], false))
            fail_msg("'%s' was accepted", bad[i]);
}

TEST(bytes_of_fd_frames_are_up_to_64)
{
    static const char pair[] = "1x";
    char text[2 * (CW_FRAME_DATA_MAX + 1) + 1] = "";
    text_bytes bytes;

    for (size_t i = 0; i < CW_FRAME_DATA_MAX; i++)
        strcat(text, pair);
    assert_null(text_parse_bytes(&bytes, text, true));
    assert_int_equal(bytes.length, CW_FRAME_DATA_MAX);
    assert_int_equal(bytes.mask[63], 0xF0);
    assert_int_equal(bytes.value[63], 0x10);
    assert_non_null(text_parse_bytes(&bytes, text, false));
    strcat(text, pair);
    assert_non_null(text_parse_bytes(&bytes, text, true));
    assert_null(text_parse_bytes(&bytes, "112233445566778899", true));
    assert_int_equal(bytes.length, 9);
}

TEST(levels_come_in_order)
{
    static const char longest[] =
        "x111111111111111111111111111111111111111111111111111111111111110";
    static const char *const bad[] = {"", "x", "xxx", "2", "1 0", "1.0"};
    text_levels levels;

    assert_null(text_parse_levels(&levels, "10xX1"));
    assert_int_equal(levels.bits, 5);
    assert_int_equal(levels.level, 0x11);
    assert_int_equal(levels.mask, 0x13);
    assert_int_equal(strlen(longest), CW_PATTERN_MAX);
    assert_null(text_parse_levels(&levels, longest));
    assert_true(levels.mask == ~UINT64_C(1));
    assert_true(levels.level == (~UINT64_C(1) ^ UINT64_C(1) << 63));
    assert_non_null(text_parse_levels(&levels, "x1111111111111111111111111111111111111111111111111"
                                               "1111111111111110"));
    for (size_t i = 0; i < COUNT(bad); i++)
        if (!text_parse_levels(&levels, bad[i]))
            fail_msg("'%s' was accepted", bad[i]);
}

TEST(parts_are_percent)
{
    static const struct {
        const char *text;
        uint16_t permille;
    } cases[] = {{"60%", 600}, {"12.5%", 125}, {"0.1%", 1}, {"100%", 1000}, {"100.0%", 1000}};
    static const char *const bad[] = {
        "",    "60",     "%",    "0%",   "100.1%", "101%",
        "-1%", "12.25%", "60 %", "060%", "60%%",   "184467440737095517%",
    };
    uint16_t permille;

    for (size_t i = 0; i < COUNT(cases); i++) {
        assert_null(text_parse_percent(&permille, cases[i].text));
        assert_int_equal(permille, cases[i].permille);
    }
    for (size_t i = 0; i < COUNT(bad); i++)
        if (!text_parse_percent(&permille, bad[i]))
            fail_msg("'%s' was accepted", bad[i]);
}

TEST(error_filters_are_classes)
{
    static const char *const bad[] = {"", "#", "4", "#0", "#E0000000", "#123456789", "#G", "#4 "};
    uint32_t mask;

    assert_null(text_parse_error_mask(&mask, "#4"));
    assert_int_equal(mask, 4);
    assert_null(text_parse_error_mask(&mask, "#FFFFFFFF"));
    assert_int_equal(mask, 0x1FFFFFFF);
    for (size_t i = 0; i < COUNT(bad); i++)
        if (!text_parse_error_mask(&mask, bad[i]))
            fail_msg("'%s' was accepted", bad[i]);
}

TEST(identifiers_stand_alone)
{
    static const char *const bad[] = {"", "12", "800", "20000000", "123#", "x23", "123456789"};
    uint32_t id;
    uint8_t flags;

    assert_null(text_parse_id(&id, &flags, "7ff"));
    assert_int_equal(id, 0x7FF);
    assert_int_equal(flags, 0);
    assert_null(text_parse_id(&id, &flags, "00000001"));
    assert_int_equal(id, 1);
    assert_int_equal(flags, CW_FRAME_EXTENDED);
    for (size_t i = 0; i < COUNT(bad); i++)
        if (!text_parse_id(&id, &flags, bad[i]))
            fail_msg("'%s' was accepted", bad[i]);
}

/* A number that a text stands for. */
typedef struct number_row {
    const char *text; /* NULL ends a table */
    uint64_t value;
} number_row;

typedef const char *number_parser(uint64_t *out, const char *text);

/* Checks texts that stand for numbers, and texts that stand for none and leave the number as it
 * is. */
static void check_numbers(number_parser *parse, const number_row *good, const char *const *bad)
{
    for (; good->text; good++) {
        uint64_t value = good->value + 1;
        if (parse(&value, good->text) || value != good->value)
            fail_msg("'%s' is %" PRIu64, good->text, value);
    }
    for (; *bad; bad++) {
        uint64_t value = 7;
        if (!parse(&value, *bad) || value != 7)
            fail_msg("'%s' was accepted", *bad);
    }
}

TEST(integers_are_strict)
{
    static const number_row good[] = {{"0", 0}, {"18446744073709551615", UINT64_MAX}, {NULL, 0}};
    static const char *const bad[] = {
        "",
        "+5",
        "-5",
        "0500",
        "00",
        "0x10",
        "1_000",
        "5.0",
        "500k",
        " 5",
        "5 ",
        "1e3",
        "18446744073709551616",
        "99999999999999999999",
        NULL,
    };
    check_numbers(text_parse_uint, good, bad);
}

TEST(probabilities_are_exact)
{
    static const number_row good[] = {
        {"0", 0},
        {"0.0", 0},
        {"0.5", UINT64_C(1) << 63},
        {"0.50", UINT64_C(1) << 63},
        {"0.25", UINT64_C(1) << 62},
        {"0.1", UINT64_C(0x1999999999999999)},
        {"1", UINT64_MAX},
        {"1.000", UINT64_MAX},
        {"0.9999999999999999999", UINT64_MAX - 1},
        {"0.0000000000000000001", 1},
        {"1e-19", 1},
        {"5e-1", UINT64_C(1) << 63},
        {"2.5E-1", UINT64_C(1) << 62},
        {"0.05e+1", UINT64_C(1) << 63},
        {"50e-2", UINT64_C(1) << 63},
        {"100e-2", UINT64_MAX},
        {"1e0", UINT64_MAX},
        {"0e-999", 0},
        {"0e999", 0},
        {"1e-5", UINT64_C(184467440737095)},
        {"10e-6", UINT64_C(184467440737095)},
        {"0.00001", UINT64_C(184467440737095)},
        {NULL, 0},
    };
    static const char *const bad[] = {
        "",
        "2",
        "1.1",
        "-0.5",
        ".5",
        "0.",
        "00.5",
        "5%",
        "1e-20",
        "1e-999",
        "1e-1000",
        "1e1",
        "1e999",
        "0.2e1",
        "1e",
        "1e-",
        "e-5",
        "1e-5%",
        "1 e-5",
        "1e--5",
        "18446744073709551615e-1",
        "0.5x",
        "0,5",
        "1.00000000000000000000001",
        "0.00000000000000000001",
        "nan",
        NULL,
    };
    check_numbers(text_parse_probability, good, bad);
}

TEST(times_have_units)
{
    static const struct {
        const char *text;
        cfg_time time;
    } cases[] = {
        {"0", {0, 0}},
        {"10ms", {10000000, 0}},
        {"250us", {250000, 0}},
        {"2s", {2000000000, 0}},
        {"100bit", {0, 100}},
        {"0bit", {0, 0}},
        {"1.5ms", {1500000, 0}},
        {"0.000000001s", {1, 0}},
        {"1.50us", {1500, 0}},
        {"500ns", {500, 0}},
        {"1min", {60000000000, 0}},
        {"0.5h", {1800000000000, 0}},
        {"18446744073709551615ns", {UINT64_MAX, 0}},
        {"18446744073709551615bit", {0, UINT64_MAX}},
    };
    for (size_t i = 0; i < COUNT(cases); i++) {
        cfg_time time;

        assert_null(text_parse_time(&time, cases[i].text));
        assert_true(time.ns == cases[i].time.ns && time.bits == cases[i].time.bits);
    }
}

TEST(bad_times_are_refused)
{
    static const char *const cases[] = {
        "",
        "10",
        "ms",
        "10 ms",
        "-1s",
        "+1s",
        "010ms",
        "1.s",
        ".5s",
        "1e3s",
        "10MS",
        "1s500ms",
        "0.5bit",
        "1.5ns",
        "0.0000000001s",
        "18446744073709551616ns",
        "18446744074s",
        "6000000h",
        "1s ",
        "1..2s",
        "99999999999999999999h",
    };
    for (size_t i = 0; i < COUNT(cases); i++) {
        cfg_time time = {7, 7};

        if (!text_parse_time(&time, cases[i]))
            fail_msg("'%s' was accepted", cases[i]);
        assert_true(time.ns == 7 && time.bits == 7);
    }
}

static uint64_t ticks_at(uint32_t bit_ticks, cfg_time time)
{
    return text_time_ticks(time, cw_rate_of(bit_ticks));
}

static uint64_t sum_at(uint32_t bit_ticks, cfg_time start, uint64_t k, cfg_time step)
{
    return text_time_ticks_sum(start, k, step, cw_rate_of(bit_ticks));
}

TEST(ticks_are_rounded_up_once)
{
    assert_int_equal(ticks_at(160, (cfg_time){25, 0}), 2);
    assert_int_equal(ticks_at(160, (cfg_time){26, 0}), 3);
    assert_int_equal(ticks_at(160, (cfg_time){1, 0}), 1);
    assert_int_equal(ticks_at(160, (cfg_time){0, 3}), 480);
    assert_int_equal(ticks_at(160, (cfg_time){1000000, 3}), 80480);
    /* 10 ns are 0.8 ticks: a million of them are 800000, not a million. */
    assert_int_equal(sum_at(160, (cfg_time){0}, 1000000, (cfg_time){10, 0}), 800000);
    assert_int_equal(sum_at(160, (cfg_time){25, 1}, 2, (cfg_time){0, 1}), 482);
}

TEST(ticks_saturate)
{
    const cfg_time most = {UINT64_MAX, UINT64_MAX};

    assert_true(ticks_at(1, (cfg_time){UINT64_MAX, 0}) == UINT64_C(1475739525896764130));
    assert_true(ticks_at(1, (cfg_time){0, UINT64_MAX}) == UINT64_MAX);
    assert_true(ticks_at(2, (cfg_time){0, UINT64_MAX}) == CW_NEVER);
    assert_true(ticks_at(UINT32_MAX, most) == CW_NEVER);
    assert_true(sum_at(UINT32_MAX, most, UINT64_MAX, most) == CW_NEVER);
    assert_true(sum_at(1, (cfg_time){0}, UINT64_MAX, (cfg_time){12, 0}) < CW_NEVER);
    assert_true(sum_at(1, (cfg_time){0}, UINT64_MAX, (cfg_time){13, 0}) == CW_NEVER);
}

TEST(positions_have_fields_and_indices)
{
    static const struct {
        const char *text;
        cw_field field;
        unsigned index;
    } cases[] = {
        {"sof", CW_FIELD_SOF, 0},
        {"id[0]", CW_FIELD_ID, 0},
        {"id[28]", CW_FIELD_ID, 28},
        {"srr", CW_FIELD_SRR, 0},
        {"r1", CW_FIELD_R1, 0},
        {"dlc[3]", CW_FIELD_DLC, 3},
        {"data[0.0]", CW_FIELD_DATA, 0},
        {"data[2.7]", CW_FIELD_DATA, 23},
        {"data[7.7]", CW_FIELD_DATA, 63},
        {"crc[14]", CW_FIELD_CRC, 14},
        {"crc-delimiter", CW_FIELD_CRC_DELIMITER, 0},
        {"ack-slot", CW_FIELD_ACK_SLOT, 0},
        {"eof[6]", CW_FIELD_EOF, 6},
        {"intermission[2]", CW_FIELD_INTERMISSION, 2},
        {"suspend[7]", CW_FIELD_SUSPEND, 7},
        {"stuff[1]", CW_FIELD_STUFF, 1},
        {"bit[17]", CW_FIELD_BIT, 17},
        {"bit[156]", CW_FIELD_BIT, 156},
        {"error-flag[0]", CW_FIELD_ERROR_FLAG, 0},
        {"overload-delimiter[7]", CW_FIELD_OVERLOAD_DELIMITER, 7},
    };
    for (size_t i = 0; i < 2 * COUNT(cases); i++) {
        cw_field field;
        uint16_t index;
        const size_t k = i / 2;

        assert_null(text_parse_position(&field, &index, cases[k].text, i % 2));
        assert_int_equal(field, cases[k].field);
        assert_int_equal(index, cases[k].index);
    }
}

/* Each is refused where frames are classical. */
TEST(positions_of_fd_frames_have_fields_and_indices)
{
    static const struct {
        const char *text;
        cw_field field;
        unsigned index;
    } cases[] = {
        {"fdf", CW_FIELD_FDF, 0},
        {"res", CW_FIELD_RES, 0},
        {"brs", CW_FIELD_BRS, 0},
        {"esi", CW_FIELD_ESI, 0},
        {"data[63.7]", CW_FIELD_DATA, 511},
        {"stuff-count[0]", CW_FIELD_STUFF_COUNT, 0},
        {"stuff-count[3]", CW_FIELD_STUFF_COUNT, 3},
        {"crc[20]", CW_FIELD_CRC, 20},
        {"fixed-stuff[0]", CW_FIELD_FIXED_STUFF, 0},
        {"fixed-stuff[6]", CW_FIELD_FIXED_STUFF, 6},
        {"ack-slot[0]", CW_FIELD_ACK_SLOT, 0},
        {"ack-slot[1]", CW_FIELD_ACK_SLOT, 1},
        {"bit[732]", CW_FIELD_BIT, 732},
    };
    static const char *const bad[] = {
        "fdf[0]", "brs[0]", "stuff-count", "stuff-count[4]", "fixed-stuff", "fixed-stuff[7]",
        "crc[21]", "ack-slot[2]", "data[64.0]", "bit[768]", "sof[0]", "ack-delimiter[0]", "rrs",
    };
    cw_field field = CW_FIELD_COUNT;
    uint16_t index = 7;

    for (size_t i = 0; i < COUNT(cases) + COUNT(bad); i++) {
        const char *text = i < COUNT(cases) ? cases[i].text : bad[i - COUNT(cases)];

        if (!text_parse_position(&field, &index, text, false))
            fail_msg("'%s' was accepted", text);
        assert_true(field == CW_FIELD_COUNT && index == 7);
    }
    for (size_t i = 0; i < COUNT(bad); i++)
        if (!text_parse_position(&field, &index, bad[i], true))
            fail_msg("'%s' was accepted", bad[i]);
    for (size_t i = 0; i < COUNT(cases); i++) {
        assert_null(text_parse_position(&field, &index, cases[i].text, true));
        assert_int_equal(field, cases[i].field);
        assert_int_equal(index, cases[i].index);
    }
}

TEST(bad_positions_are_refused)
{
    static const char *const cases[] = {
        "",
        "none",
        "crc",
        "crc[15]",
        "crc[]",
        "crc[3",
        "crc[03]",
        "crc[3]x",
        "crc[-1]",
        "crc[0x1]",
        "crc 3",
        "CRC[3]",
        "sof[0]",
        "ack-slot[0]",
        "id[29]",
        "data[3]",
        "data[8.0]",
        "data[0.8]",
        "data[0.0.0]",
        "stuff",
        "bit[256]",
        "bit[99999999999]",
        "eof[7]",
        "cr[3]",
        "id[1.2]",
    };
    for (size_t i = 0; i < COUNT(cases); i++) {
        cw_field field = CW_FIELD_COUNT;
        uint16_t index = 7;

        if (!text_parse_position(&field, &index, cases[i], false))
            fail_msg("'%s' was accepted", cases[i]);
        assert_true(field == CW_FIELD_COUNT && index == 7);
    }
}

TEST(bus_time_is_truncated)
{
    static const struct {
        uint64_t tick;
        const char *seconds;
        const char *log;
    } cases[] = {
        {0, "0.000000000", "(0000000000.000000)"},
        {1, "0.000000012", "(0000000000.000000)"},
        {2, "0.000000025", "(0000000000.000000)"},
        {79, "0.000000987", "(0000000000.000000)"},
        {80, "0.000001000", "(0000000000.000001)"},
        {14080, "0.000176000", "(0000000000.000176)"},
        {79999999, "0.999999987", "(0000000000.999999)"},
        {UINT64_C(80000000) * 10000000000, "10000000000.000000000", "(10000000000.000000)"},
        {UINT64_MAX, "230584300921.369395187", "(230584300921.369395)"},
    };
    for (size_t i = 0; i < COUNT(cases); i++) {
        char printed[TIME_TEXT_MAX];

        text_print_seconds(printed, cases[i].tick);
        assert_string_equal(printed, cases[i].seconds);
        text_print_log_time(printed, cases[i].tick);
        assert_string_equal(printed, cases[i].log);
    }
}

TEST(filters_are_printed_as_they_are_written)
{
    static const char *const texts[] = {"123",     "000",         "7FF",
                                        "12345678", "00000123",   "100:700",
                                        "100~700",  "92345678:DFFFFFFF", "0:0"};

    for (size_t i = 0; i < COUNT(texts); i++) {
        char printed[FILTER_TEXT_MAX];
        cw_filter filter;
        cw_filter again;
        unsigned count;

        assert_null(text_parse_filters(&filter, &count, 1, texts[i]));
        text_print_filter(printed, &filter);
        assert_string_equal(printed, texts[i]);
        assert_null(text_parse_filters(&again, &count, 1, printed));
        assert_true(filter.value == again.value && filter.mask == again.mask &&
                    filter.inverted == again.inverted);
    }
}

TEST(spans_are_printed_in_their_unit)
{
    static const struct {
        uint64_t ticks;
        const char *text;
    } cases[] = {
        {0, "0ns"},
        {1, "12ns"},
        {79, "987ns"},
        {80, "1us"},
        {81, "1.012us"},
        {80000 - 1, "999.987us"},
        {80000, "1ms"},
        {576320, "7.204ms"},
        {80000000, "1s"},
        {80000000 + 8, "1.0000001s"},
        {UINT64_C(80000000) * 86400, "86400s"},
        {UINT64_MAX, "230584300921.369395187s"},
    };

    for (size_t i = 0; i < COUNT(cases); i++) {
        char printed[TIME_TEXT_MAX];

        text_print_span(printed, cases[i].ticks);
        assert_string_equal(printed, cases[i].text);
    }
}

TEST(reads_sizes)
{
    static const number_row good[] = {
        {"0", 0},
        {"64kB", 64000},
        {"100MB", 100000000},
        {"2GB", 2000000000},
        {"1KiB", 1024},
        {"3MiB", 3145728},
        {"999999999GiB", UINT64_C(999999999) << 30},
        {NULL, 0},
    };
    static const char *const bad[] = {
        "",
        "kB",
        "1.5MB",
        "1 MB",
        "1mb",
        "01",
        "-1",
        "1000000000",
        NULL,
    };
    check_numbers(text_parse_size, good, bad);
}

TEST(frequencies_are_whole_hertz)
{
    static const number_row good[] = {
        {"16MHz", 16000000},
        {"80000000", 80000000},
        {"8.333MHz", 8333000},
        {"500kHz", 500000},
        {"1.5GHz", 1500000000},
        {"66.666666MHz", 66666666},
        {"1Hz", 1},
        {"0", 0},
        {"0.5kHz", 500},
        {NULL, 0},
    };
    static const char *const bad[] = {
        "8.3333333MHz",
        "1.5",
        "",
        "MHz",
        "16mhz",
        "16 MHz",
        "-1MHz",
        "16MHzx",
        "016MHz",
        "18446744073709551615GHz",
        NULL,
    };
    check_numbers(text_parse_frequency, good, bad);
}

TEST(lengths_are_whole_millimetres)
{
    static const number_row good[] = {
        {"40m", 40000}, {"12.5m", 12500},
        {"30cm", 300}, {"7mm", 7},
        {"1.5km", 1500000}, {"0", 0},
        {"0m", 0}, {"0.001m", 1},
        {NULL, 0},
    };
    static const char *const bad[] = {
        "40", "0.0001m", "m", "", "4 m", "4M", "-4m", "4ft", NULL,
    };
    check_numbers(text_parse_length, good, bad);
}
