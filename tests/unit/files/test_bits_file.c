/* SPDX-License-Identifier: MIT
 *
 * test_bits_file.c - the encoder against tests/bits/frames.txt, whose bits were derived without it.
 *
 * usage: test_bits_file [FILE]. Each frame of the file is a test of its own.
 */
#include "canwire.h"
#include "trace/frametext.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#ifndef TESTS_DIR
#define TESTS_DIR "tests"
#endif

#define LINE_BYTES 512
#define FRAMES_MAX 1000
#define FRAMES_LEAST 24 /* a file that lost its frames is no success */

/* A line of the file: what it says, and the texts it points into. */
typedef struct expectation {
    char line[LINE_BYTES];
    const char *frame;
    const char *levels;
    const char *stuff; /* "5,11", or "-" */
} expectation;

typedef struct suite {
    size_t count;
    expectation *lines;
    struct CMUnitTest *tests;
} suite;

static void read_suite(suite *out, const char *path);
static void free_suite(suite *self);

int main(int argc, char **argv)
{
    suite frames = {0};

    read_suite(&frames, argc > 1 ? argv[1] : TESTS_DIR "/bits/frames.txt");
    int failed = _cmocka_run_group_tests("bits file", frames.tests, frames.count, NULL, NULL);

    free_suite(&frames);
    return failed;
}

/* ---- The test -------------------------------------------------------------------------------- */

static void levels_text(char out[CW_BITS_MAX + 1], const cw_bits *bits)
{
    for (unsigned n = 0; n < bits->length; n++) {
        out[n] = cw_bits_level(bits, n) == CW_RECESSIVE ? '1' : '0';
    }
    out[bits->length] = '\0';
}

/* Prints stuff marks in the form of the file. */
static void stuff_text(char out[LINE_BYTES], const cw_bits *bits)
{
    size_t used = 0;

    strcpy(out, "-");
    for (unsigned n = 0; n < bits->length; n++) {
        if (cw_bits_place(bits, n).stuff) {
            int written = snprintf(out + used, LINE_BYTES - used, used == 0 ? "%u" : ",%u", n);

            used += (size_t)written;
        }
    }
}

static void encodes_as_the_file_says(void **state)
{
    const expectation *expected = *state;
    char levels[CW_BITS_MAX + 1];
    char stuff[LINE_BYTES];
    cw_frame frame;
    cw_bits bits;

    assert_null(text_parse_frame(&frame, expected->frame));
    assert_int_equal(cw_bits_encode(&bits, &frame), CW_OK);
    levels_text(levels, &bits);
    assert_string_equal(levels, expected->levels);
    stuff_text(stuff, &bits);
    assert_string_equal(stuff, expected->stuff);
}

/* ---- The file -------------------------------------------------------------------------------- */

static void give_up(const char *path, const char *problem)
{
    fprintf(stderr, "%s: %s\n", path, problem);
    exit(EXIT_FAILURE);
}

/* Splits a line; returns false for a comment or an empty line. */
static bool split_line(expectation *out, const char *path)
{
    static const char blanks[] = " \t\r\n";
    char *rest = NULL;

    out->frame = strtok_r(out->line, blanks, &rest);
    if (out->frame == NULL || out->frame[0] == '#') {
        return false;
    }
    out->levels = strtok_r(NULL, blanks, &rest);
    out->stuff = strtok_r(NULL, blanks, &rest);
    if (out->stuff == NULL || strtok_r(NULL, blanks, &rest) != NULL) {
        give_up(path, "a line has not FRAME BITS STUFF");
    }
    return true;
}

static void read_lines(suite *out, const char *path)
{
    FILE *file = fopen(path, "r");

    if (file == NULL) {
        give_up(path, "cannot be read");
        return;
    }
    while (out->count < FRAMES_MAX && fgets(out->lines[out->count].line, LINE_BYTES, file)) {
        if (split_line(&out->lines[out->count], path)) {
            out->count++;
        }
    }
    fclose(file);
    if (out->count < FRAMES_LEAST || out->count == FRAMES_MAX) {
        give_up(path, "holds too few or too many frames");
    }
}

static void read_suite(suite *out, const char *path)
{
    out->lines = calloc(FRAMES_MAX, sizeof *out->lines);
    out->tests = calloc(FRAMES_MAX, sizeof *out->tests);
    if (out->lines == NULL || out->tests == NULL) {
        give_up(path, "out of memory");
    }
    read_lines(out, path);
    for (size_t i = 0; i < out->count; i++) {
        out->tests[i].name = out->lines[i].frame;
        out->tests[i].test_func = encodes_as_the_file_says;
        out->tests[i].initial_state = &out->lines[i];
    }
}

static void free_suite(suite *self)
{
    free(self->tests);
    free(self->lines);
}
