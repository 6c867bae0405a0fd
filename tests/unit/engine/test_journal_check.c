/* SPDX-License-Identifier: MIT
 *
 * test_journal_check.c - damage of a journal is found, with its line.
 */
#include "cases.h"
#include "journal_rig.h"
#include "run/journal_seal.h"

/* Checks for "journal:LINE:", or a message without place. */
static void check_place(const char *messages, const char *text, size_t damaged)
{
    size_t line = 1;
    for (size_t i = 0; i < damaged; i++)
        line += text[i] == '\n';
    const char *said = strstr(messages, path_of("journal"));
    assert_non_null(said);
    size_t told = strtoul(said + strlen(path_of("journal")) + 1, NULL, 10);
    if (told != line)
        fail_msg("byte %zu of line %zu: %s", damaged, line, messages);
}

/* One bit of each byte, another from byte to byte. */
TEST(a_flipped_bit_of_each_byte_is_found_with_its_line)
{
    size_t size;
    char *messages;
    char *text = make_small_journal(&size);
    assert_true(check_text(text, size, &messages));
    assert_string_equal(messages, "");
    free(messages);
    for (size_t i = 0; i < size; i++) {
        const unsigned bit = i % 8;
        text[i] = (char)(text[i] ^ 1 << bit);
        if (check_text(text, size, &messages))
            fail_msg("bit %u of byte %zu", bit, i);
        text[i] = (char)(text[i] ^ 1 << bit);
        check_place(messages, text, i);
        free(messages);
    }
    free(text);
}

TEST(each_cut_is_found)
{
    size_t size;
    char *messages;
    char *text = make_small_journal(&size);
    for (size_t i = 0; i < size; i++) {
        if (check_text(text, i, &messages))
            fail_msg("cut at byte %zu", i);
        check_place(messages, text, i);
        free(messages);
    }
    free(text);
}

/* Whole lines can be lost, too, and come again. */
TEST(each_missing_or_repeated_line_is_found)
{
    size_t size;
    char *messages;
    char *text = make_small_journal(&size);
    char *other = malloc(2 * size);
    unsigned lines = 0;
    for (size_t i = 0; i < size; lines++) {
        size_t length = (size_t)(strchr(text + i, '\n') - text) + 1 - i;
        memcpy(other, text, i);
        memcpy(other + i, text + i + length, size - i - length);
        assert_false(check_text(other, size - length, &messages));
        assert_string_not_equal(messages, "");
        free(messages);
        memcpy(other, text, i + length);
        memcpy(other + i + length, text + i, size - i);
        assert_false(check_text(other, size + length, &messages));
        assert_string_not_equal(messages, "");
        free(messages);
        i += length;
    }
    assert_int_equal(lines, 5);
    free(other);
    free(text);
}

TEST(the_checksum_is_that_of_zlib)
{
    assert_int_equal(journal_crc32(0, "123456789", 9), 0xCBF43926);
    assert_int_equal(journal_crc32(journal_crc32(0, "1234", 4), "56789", 5), 0xCBF43926);
}

TESTS_WITH(make_folder, remove_folder)
