/* SPDX-License-Identifier: MIT
 *
 * test_journal_check.c - damage of a journal is found, with its line.
 */
#include "cases.h"
#include "journal_rig.h"
#include "run/journal_seal.h"

#define FIRST_SEND 3u /* line of a small journal */
#define MARK (FIRST_SEND + SMALL_SENDS)

/* Checks for "journal:LINE:". Frames have no checksum of their own: those before the mark are told
 * with it, by the first of these lines. */
static void check_place(const char *messages, const char *text, size_t damaged)
{
    size_t line = 1;
    for (size_t i = 0; i < damaged; i++)
        line += text[i] == '\n';
    if (strstr(messages, "wrong checksum") && line > FIRST_SEND && line <= MARK)
        line = FIRST_SEND;
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

/* Returns true when the journal can be unpacked to its end, and is this text. */
static bool is_whole(const char *text)
{
    bool whole;
    char *now = read_text_of("journal", &whole);
    whole = whole && strcmp(now, text) == 0;
    free(now);
    return whole;
}

/* Some bits of a packed file do not count: the text is the same without them. All bits are tried:
 * how the text is packed depends on the time and on the name of the folder. */
TEST(a_flipped_bit_of_a_packed_journal_is_found)
{
    size_t size, same = 0;
    char *messages;
    char *text = make_small_journal(&size);
    char *packed = read_bytes("journal", &size);
    assert_true(check_text(packed, size, &messages));
    assert_string_equal(messages, "");
    free(messages);
    for (size_t i = 0; i < 8 * size; i++) {
        packed[i / 8] = (char)(packed[i / 8] ^ 1 << i % 8);
        const bool good = check_text(packed, size, &messages);
        if (good != is_whole(text) || good != !*messages)
            fail_msg("bit %zu of byte %zu: %s", i % 8, i / 8, messages);
        same += good;
        packed[i / 8] = (char)(packed[i / 8] ^ 1 << i % 8);
        free(messages);
    }
    assert_true(same < size);
    free(packed);
    free(text);
}

TEST(a_digit_more_or_less_in_the_last_checksum_is_found)
{
    static const char *const ends[] = {"\"}\n", "00\"}\n"}; /* behind seven digits */
    size_t size;
    char *messages;
    char *text = make_small_journal(&size);
    const size_t kept = size - strlen("0\"}\n");
    char *other = malloc(size + 2);
    for (size_t i = 0; i < COUNT(ends); i++) {
        memcpy(other, text, kept);
        strcpy(other + kept, ends[i]);
        assert_false(check_text(other, strlen(other), &messages));
        assert_non_null(strstr(messages, "wrong checksum"));
        free(messages);
    }
    free(other);
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
    assert_int_equal(lines, MARK + 1);
    free(other);
    free(text);
}

TEST(the_checksum_is_that_of_zlib)
{
    assert_int_equal(journal_crc32(0, "123456789", 9), 0xCBF43926);
    assert_int_equal(journal_crc32(journal_crc32(0, "1234", 4), "56789", 5), 0xCBF43926);
}

/* Returns the digest of two frames. The first one has one bit changed; behind the last bit,
 * none. */
static uint64_t digest_with(unsigned bit)
{
    cw_frame frame = {.id = 0x123, .flags = CW_FRAME_FD, .dlc = 15};
    uint64_t tick = 1000;
    unsigned node = 3;
    const unsigned of_data = 8 * CW_FRAME_DATA_MAX;
    if (bit < of_data)
        frame.data[bit / 8] ^= (uint8_t)(1u << bit % 8);
    else if (bit < of_data + 29)
        frame.id ^= 1u << (bit - of_data);
    else if (bit < of_data + 29 + 64)
        tick ^= UINT64_C(1) << (bit - of_data - 29);
    else if (bit < of_data + 29 + 64 + 6)
        node ^= 1u << (bit - of_data - 29 - 64);
    else if (bit == of_data + 29 + 64 + 6)
        frame.flags |= CW_FRAME_BRS;
    return journal_digest(journal_digest(0, node, &frame, tick), 0, &frame, 2000);
}

TEST(each_bit_of_a_frame_counts_in_the_digest)
{
    enum { BITS = 8 * CW_FRAME_DATA_MAX + 29 + 64 + 7 };
    static uint64_t digests[BITS + 1];
    for (unsigned i = 0; i <= BITS; i++) {
        digests[i] = digest_with(i);
        for (unsigned k = 0; k < i; k++)
            if (digests[k] == digests[i])
                fail_msg("bits %u and %u", k, i);
    }
}

TESTS_WITH(make_folder, remove_folder)
