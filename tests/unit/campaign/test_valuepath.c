/* SPDX-License-Identifier: MIT
 *
 * test_valuepath.c - paths of values have parts, and what is none is told with its place.
 */
#include "cases.h"
#include "campaign/space/valuepath.h"

TEST(a_path_has_parts)
{
    static const char *const texts[] = {"nodes", "engine-2", "traffic", "0", "12", "every_x"};
    static const bool numbers[] = {false, false, false, true, true, false};
    const char *rest = "nodes.engine-2.traffic[0][12].every_x";
    arena memory = {.blocks = NULL};
    assert_null(valuepath_check(&memory, rest));
    for (size_t i = 0; i < COUNT(texts); i++) {
        valuepath_part p;
        valuepath_take(&rest, &p);
        assert_string_equal(p.text, texts[i]);
        assert_int_equal(p.number, numbers[i]);
        assert_int_equal(p.last, i + 1 == COUNT(texts));
    }
    arena_free(&memory);
}

/* Asserts that a path is wrong at a character, from 1 on. */
static void assert_wrong_at(arena *memory, const char *path, unsigned place)
{
    char end[32];
    const char *wrong = valuepath_check(memory, path);
    (void)snprintf(end, sizeof end, " at character %u", place);
    if (!wrong)
        fail_msg("'%s' is a path", path);
    if (strcmp(wrong + strlen(wrong) - strlen(end), end) != 0)
        fail_msg("%s: %s", path, wrong);
}

TEST(other_texts_are_wrong_at_a_character)
{
    static const char *const paths[] = {"", ".a", "a.", "a..b", "a b", "[0]", "a.[0]", "a[]",
                                        "a[01]", "a[00]", "a[1", "a[-1]", "a[1]b", "a[b]",
                                        "a[1].", "a]", "a[123].b c"};
    static const unsigned places[] = {1, 1, 3, 3, 2, 1, 3, 2, 2, 2, 2, 2, 5, 2, 6, 2, 9};
    arena memory = {.blocks = NULL};
    for (size_t i = 0; i < COUNT(paths); i++)
        assert_wrong_at(&memory, paths[i], places[i]);
    arena_free(&memory);
}

TEST(parts_have_a_limit)
{
    char path[VALUEPATH_PART_MAX + 4];
    arena memory = {.blocks = NULL};
    memset(path, 'x', VALUEPATH_PART_MAX);
    path[VALUEPATH_PART_MAX - 1] = '\0';
    assert_null(valuepath_check(&memory, path));
    path[VALUEPATH_PART_MAX - 1] = 'x';
    path[VALUEPATH_PART_MAX] = '\0';
    assert_wrong_at(&memory, path, 1);
    memset(path, '7', VALUEPATH_PART_MAX + 2);
    memcpy(path, "a[", 2);
    memcpy(path + VALUEPATH_PART_MAX + 1, "]", 2);
    assert_null(valuepath_check(&memory, path));
    memcpy(path + VALUEPATH_PART_MAX + 1, "7]", 3);
    assert_wrong_at(&memory, path, 2);
    arena_free(&memory);
}
