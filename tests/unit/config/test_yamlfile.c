/* SPDX-License-Identifier: MIT
 *
 * test_yamlfile.c - files that are hardly YAML: other line ends, no text, no end; and aliases.
 */
#include "cases.h"
#include "configs.h"
#include "base/text/yamlfile.h"

#define BYTES(text) text, sizeof(text) - 1

TEST(aliases_stand_for_their_values)
{
    CFG *config = load_good(GOOD "aliases.yaml");

    assert_int_equal(config->nodes[1].restart_ms, 100);
    assert_int_equal(config->nodes[2].traffic[1].frame.id, 0x100);
    assert_int_equal(config->rules[1].time_end, TICKS_PER_S);
    assert_int_equal(config->rules[1].field, CW_FIELD_CRC);
}

/* Returns NULL when the content is accepted, else the message behind the path, to be freed. */
static char *errors_of_content(const void *content, size_t length)
{
    char *path = make_file(content, length);
    char *errors = errors_of(path);

    if (errors)
        memmove(errors, errors + strlen(path), strlen(errors + strlen(path)) + 1);
    drop_file(path);
    return errors;
}

static void expect_error(const void *content, size_t length, const char *expected)
{
    FREED char *errors = errors_of_content(content, length);

    if (!errors || strncmp(errors, expected, strlen(expected)) != 0)
        fail_msg("expected %s\ngot %s", expected, errors ? errors : "no error");
}

/* A bad file reports only errors; warnings do not take their places. */
TEST(warnings_take_no_place_of_errors)
{
    char *text = NULL;
    size_t size = 0;
    char *path;
    unsigned lines = 0;
    FILE *out = open_memstream(&text, &size);
    fputs("bus: { bitrate: 500000 }\nnodes: [ { name: a } ]\nfaults:\n", out);
    for (unsigned i = 0; i < 300; i++)
        fprintf(out, "  - { name: r%u, do: { no-ack: a, for: 1us } }\n", i);
    fputs("seed: -1\n", out);
    fclose(out);
    path = make_file(text, size);
    char *errors = errors_of(path);
    assert_non_null(errors);
    for (const char *c = errors; *c; c++)
        lines += *c == '\n';
    assert_int_equal(lines, 1);
    assert_non_null(strstr(errors, ":304:7: seed: expected"));
    free(errors);
    free(text);
    drop_file(path);
}

TEST(bytes_that_are_no_text_are_refused)
{
    static const struct {
        const char *content;
        size_t length;
        const char *expected;
    } cases[] = {
        {BYTES(""), ":1:1: the file is empty"},
        {BYTES("\0"), ":1:1: NUL bytes"},
        {BYTES("# \xC3\xA4\nseed: \0"), ":2:7: NUL bytes"},
        {BYTES("seed: \xFF\n"), ":1:7: invalid leading UTF-8 octet"},
        {BYTES("# \xC3\xA4\n\xC3\xA4: \xE4\n"), ":2:4: incomplete UTF-8 octet sequence"},
        {BYTES("seed: \x01\n"), ":1:7: control characters"},
        {BYTES("\xFF\xFEs\0e\0"), ":1:4: NUL bytes"},
    };
    for (size_t i = 0; i < COUNT(cases); i++)
        expect_error(cases[i].content, cases[i].length, cases[i].expected);
}

TEST(marks_and_line_ends_of_other_systems_are_accepted)
{
    static const char content[] = "\xEF\xBB\xBF"
                                  "bus: { bitrate: 500000 }\r\nnodes: [{ name: a }]\r\n";
    assert_null(errors_of_content(content, sizeof content - 1));
}

TEST(what_is_no_file_is_refused)
{
    FREED char *missing = errors_of("tests/config/none.yaml");
    FREED char *directory = errors_of("tests/config");

    assert_string_equal(missing,
                        "tests/config/none.yaml: No such file or directory\n");
    assert_string_equal(directory, "tests/config: cannot read: Is a directory\n");
}

/* Repeats a pattern in a file, up to the size limit. */
static void expect_huge_error(const char *pattern, size_t length, const char *expected)
{
    FREED char *content = malloc(length);
    size_t step = strlen(pattern);

    assert_non_null(content);
    for (size_t i = 0; i < length; i++)
        content[i] = pattern[i % step];
    expect_error(content, length, expected);
}

TEST(huge_files_end_soon)
{
    static const struct {
        const char *pattern;
        const char *expected;
    } cases[] = {
        {"#", ":1:1: the file is empty"},
        {"[", ":1:65: a file has at most 64 lists"},
        {"{", ":1:65: a file has at most 64 lists"},
        {"- ", ":1:"},
        {"? ", ":1:"},
        {"\n", ":1:1: the file is empty"},
        {"a: b\n", ":100000:4: a file has at most 200000 values"},
        {"- &a x\n", ":1001:3: a file has at most 1000 anchors"},
    };
    for (size_t i = 0; i < COUNT(cases); i++)
        expect_huge_error(cases[i].pattern, YAML_FILE_MAX, cases[i].expected);
    expect_huge_error("#", YAML_FILE_MAX + 1, ": the file is larger than 4 MiB");
}

TEST(errors_without_end_are_cut)
{
    char content[400 * 8];
    size_t length = 0;
    unsigned lines = 0;

    for (int i = 0; i < 400; i++)
        length += (size_t)sprintf(content + length, "k%d: 1\n", i);
    FREED char *errors = errors_of_content(content, length);
    assert_non_null(errors);
    for (const char *c = errors; *c; c++)
        lines += *c == '\n';
    assert_int_equal(lines, DIAG_MAX + 1);
    assert_non_null(strstr(errors, "there are more errors"));
}

/* A list of lists of lists: 9^40 values when expanded. */
TEST(aliases_are_not_expanded)
{
    char content[4096];
    size_t length = (size_t)sprintf(content, "a0: &a0 [x]\n");

    for (int i = 1; i < 40; i++)
        length += (size_t)sprintf(content + length,
                                  "a%d: &a%d [*a%d, *a%d, *a%d, *a%d, *a%d, *a%d, *a%d]\n", i, i,
                                  i - 1, i - 1, i - 1, i - 1, i - 1, i - 1, i - 1);
    expect_error(content, length, ":1:1: configuration: unknown key 'a0'");
}
