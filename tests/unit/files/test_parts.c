/* SPDX-License-Identifier: MIT
 *
 * test_parts.c - the parts of a frame in traces and pictures: names, colours, labels and values.
 */
#include "cases.h"
#include "cli/svg/svg_parts.h"
#include "trace/frametext.h"

#define LETTERS 40

/* Returns the bits of a frame as its receiver sees them, to be freed. */
static cw_bit_view *views_of(const char *text, size_t *count)
{
    cw_frame frame;
    cw_bits bits;
    assert_null(text_parse_frame(&frame, text));
    assert_int_equal(cw_bits_encode(&bits, &frame), CW_OK);
    *count = bits.length;
    cw_bit_view *views = calloc(bits.length, sizeof *views);
    assert_non_null(views);
    for (unsigned n = 0; n < bits.length; n++) {
        views[n].node_count = 1;
        views[n].sampled = cw_bits_level(&bits, n);
        views[n].nodes[0].phase = CW_MAC_FRAME;
        views[n].nodes[0].place = cw_bits_place(&bits, n);
    }
    return views;
}

/* Returns the labels of all parts, "sof|id 123|...", to be freed. */
static char *labels_of(const char *text)
{
    char *all = NULL;
    size_t size, count;
    cw_bit_view *views = views_of(text, &count);
    FILE *out = open_memstream(&all, &size);
    assert_non_null(out);
    for (size_t n = 0; n < count; n++) {
        char label[SVG_LABEL_MAX];
        if (n > 0 && svg_same_part(views, 0, n))
            continue;
        svg_label(label, views, count, 0, n, LETTERS, true);
        fprintf(out, "%s%s", n > 0 ? "|" : "", label);
    }
    fclose(out);
    free(views);
    return all;
}

#define END "|crc delimiter|ack slot|ack delimiter|eof"
#define FIXED_4 "|fixed stuff|crc|fixed stuff|crc|fixed stuff|crc|fixed stuff|crc"
#define CRC_17 FIXED_4 "|fixed stuff|crc"
#define CRC_21 CRC_17 "|fixed stuff|crc"

/* Their CRC is in pieces of 4 bits, so it has no value. */
TEST(labels_have_names_and_values)
{
    static const char *const cases[][2] = {
        {"000#", "sof|id 000|rtr|ide|r0|dlc 0|crc 0000" END},
        {"123##0DE", "sof|id 123|rtr|ide|fdf|res|brs|esi|dlc 1|data[0] DE|fixed stuff|"
                     "stuff-count 3" CRC_17 END},
        {"12345678##2",
         "sof|id 48D|srr|ide|id 05678|rtr|fdf|res|brs|esi|dlc 0|fixed stuff|stuff-count 0" CRC_17
         END},
        {"7FF##0AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA55555555",
         "sof|id 7FF|rtr|ide|fdf|res|brs|esi|dlc B|data[0] AA|data[1] AA|data[2] AA|data[3] AA|"
         "data[4] AA|data[5] AA|data[6] AA|data[7] AA|data[8] AA|data[9] AA|data[10] AA|"
         "data[11] AA|data[12] AA|data[13] AA|data[14] AA|data[15] AA|data[16] 55|data[17] 55|"
         "data[18] 55|data[19] 55|fixed stuff|stuff-count 6" CRC_21 END},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        FREED char *got = labels_of(cases[i][0]);
        assert_string_equal(got, cases[i][1]);
    }
}

/* Each field that a bit can stand at. */
TEST(each_field_has_a_colour_and_labels_that_get_shorter)
{
    for (unsigned field = CW_FIELD_SOF; field < CW_FIELD_STUFF; field++) {
        char name[BIT_PART_TEXT_MAX];
        const bit_part part = {.field = (cw_field)field, .phase = CW_MAC_FRAME, .byte = 63};
        if (field == CW_FIELD_ERROR_FLAG) /* its colour is that of a phase */
            continue;
        const svg_style *style = svg_part_style(&part);
        assert_non_null(style->fill);
        assert_non_null(style->ink);
        assert_non_null(style->labels[0]);
        for (unsigned i = 1; i < SVG_LABELS_MAX && style->labels[i]; i++)
            assert_true(strlen(style->labels[i]) < strlen(style->labels[i - 1]));
        bit_part_print(name, &part);
        assert_memory_equal(name, cw_field_name((cw_field)field),
                            strlen(cw_field_name((cw_field)field)));
    }
}
