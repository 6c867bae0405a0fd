/* SPDX-License-Identifier: MIT
 *
 * test_bits_file.c - the encoder against tests/bits/frames.txt, whose bits were derived without it.
 */
#include "cases.h"
#include "canwire.h"
#include "trace/frametext.h"

#define LINE_BYTES 512
#define FRAMES_LEAST 24 /* a file that lost its frames is no success */

static void levels_text(char out[CW_BITS_MAX + 1], const cw_bits *bits)
{
    for (unsigned n = 0; n < bits->length; n++)
        out[n] = cw_bits_level(bits, n) == CW_RECESSIVE ? '1' : '0';
    out[bits->length] = '\0';
}

/* Prints stuff marks in the form of the file: "5,11", or "-". */
static void stuff_text(char out[LINE_BYTES], const cw_bits *bits)
{
    size_t used = 0;

    strcpy(out, "-");
    for (unsigned n = 0; n < bits->length; n++)
        if (cw_bits_place(bits, n).stuff)
            used += (size_t)snprintf(out + used, LINE_BYTES - used, used == 0 ? "%u" : ",%u", n);
}

static void encodes_as_it_says(char *line)
{
    const char *frame_text = strtok(line, " \t\n");
    const char *levels_expected = strtok(NULL, " \t\n");
    const char *stuff_expected = strtok(NULL, " \t\n");
    char levels[CW_BITS_MAX + 1];
    char stuff[LINE_BYTES];
    cw_frame frame;
    cw_bits bits;

    assert_non_null(stuff_expected); /* FRAME BITS STUFF */
    assert_null(strtok(NULL, " \t\n"));
    print_message("%s\n", frame_text);
    assert_null(text_parse_frame(&frame, frame_text));
    assert_int_equal(cw_bits_encode(&bits, &frame), CW_OK);
    levels_text(levels, &bits);
    assert_string_equal(levels, levels_expected);
    stuff_text(stuff, &bits);
    assert_string_equal(stuff, stuff_expected);
}

TEST(frames_have_the_bits_of_the_file)
{
    FILE *file = fopen(TESTS_DIR "/bits/frames.txt", "r");
    char line[LINE_BYTES];
    unsigned frames = 0;

    assert_non_null(file);
    while (fgets(line, sizeof line, file)) {
        if (line[0] == '#' || line[0] == '\n')
            continue;
        encodes_as_it_says(line);
        frames++;
    }
    fclose(file);
    assert_true(frames >= FRAMES_LEAST);
}
