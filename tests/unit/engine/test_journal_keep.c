/* SPDX-License-Identifier: MIT
 *
 * test_journal_keep.c - which journals of before are kept.
 */
#include "cases.h"
#include "journal_rig.h"
#include "run/journal_keep.h"

/* Letters: a journal of that name, small ones with their end; 'x': no journal; '-': none. */
typedef struct keeping {
    unsigned files;
    const char *before; /* from FILE on */
    const char *after;  /* from FILE.1 on */
} keeping;

static const keeping keepings[] = {
    {5, "A---", "A---"},  {5, "AB--", "AB--"}, {2, "a---", "a---"}, {2, "ab--", "a---"},
    {3, "abc-", "ab--"},  {3, "AbC-", "AC--"}, {3, "aBC-", "aC--"}, {3, "ABC-", "AC--"},
    {3, "ABCD", "A-D-"},  {2, "A---", "A---"}, {2, "AB--", "AB--"}, {2, "ABC-", "AC--"},
    {4, "aBc-", "aBc-"},  {4, "A-BC", "ABC-"}, {4, "-BC-", "BC--"}, {4, "abCD", "aCD-"},
    {3, "----", "----"},  {2, "xabA", "x-A-"}, {2, "A-x-", "Ax--"}, {2, "xxxx", "xxxx"},
};

/* Writes what is there before; large journals have more than one frame. */
static void write_before(const keeping *now, bool packed)
{
    enum { BLANKS = 2 * JOURNAL_PACK_FRAME };
    char *text = malloc(BLANKS + 400);
    assert_non_null(text);
    for (unsigned i = 0; i < 4; i++) {
        const char kind = now->before[i];
        int used = snprintf(text, 200, "{\"canwire-journal\":1,\"canwire\":\"x\",\"bus\":\"%c\"}\n",
                            kind);
        for (unsigned k = 0; packed && k < BLANKS / 24; k++)
            used += snprintf(text + used, 25, "{\"at\":0,\"fire\":\"rrrrr\"}\n");
        (void)snprintf(text + used, 200, "%s",
                       kind >= 'a' ? END : "{\"at\":0,\"fire\":\"r\"}\n");
        write_numbered(i, kind == '-' ? NULL : kind == 'x' ? "somebody else's\n" : text,
                       packed && kind != 'x');
    }
    free(text);
}

/* Returns the letter of a journal. */
static char letter_of(const char *name)
{
    char *text = read_text(name);
    const char *bus = strstr(text, "\"bus\":\"");
    const char letter = bus ? bus[7] : 'x';
    free(text);
    return letter;
}

static void check_keeping(const keeping *now, bool packed)
{
    char after[5] = "----";
    write_before(now, packed);
    assert_int_equal(journal_make_room(path_of("journal"), now->files), 0);
    assert_int_equal(access(path_of("journal"), F_OK), -1);
    for (unsigned i = 0; i < 4; i++) {
        char name[32];
        snprintf(name, sizeof name, "journal.%u", i + 1);
        if (access(path_of(name), F_OK) == 0)
            after[i] = letter_of(name);
    }
    if (strcmp(after, now->after) != 0)
        fail_msg("%u files, %s: %s and not %s", now->files, now->before, after, now->after);
    for (unsigned i = 0; i < 5; i++)
        write_numbered(i, NULL, false);
}

TEST(the_first_without_end_and_the_newest_are_kept)
{
    for (size_t k = 0; k < COUNT(keepings); k++)
        for (unsigned packed = 0; packed < 2; packed++)
            check_keeping(&keepings[k], packed);
}

TEST(in_a_loop_of_crashes_the_first_is_kept_and_the_disk_bounded)
{
    for (unsigned i = 0; i < 1000; i++) {
        char text[200];
        assert_int_equal(journal_make_room(path_of("journal"), 3), 0);
        snprintf(text, sizeof text,
                 "{\"canwire-journal\":1,\"canwire\":\"x\",\"bus\":\"%u\"}\n", i);
        write_file("journal", text);
        assert_int_equal(access(path_of("journal.3"), F_OK), -1);
    }
    char *first = read_file("journal.2");
    char *last = read_file("journal.1");
    assert_non_null(strstr(first, "\"bus\":\"0\""));
    assert_non_null(strstr(last, "\"bus\":\"998\""));
    free(first);
    free(last);
    for (unsigned i = 0; i < 3; i++)
        write_numbered(i, NULL, false);
}

TESTS_WITH(make_folder, remove_folder)
