/* SPDX-License-Identifier: MIT
 *
 * test_journal_pack.c - what is packed can be unpacked: all of it at any time, what is left of it
 * after errors, and what is behind damage.
 */
#include "cases.h"
#include "journal_rig.h"

#define TEXT_BYTES (3 * JOURNAL_PACK_FRAME + 1000)

/* A file that a packer writes. */
typedef struct packed {
    spool_packer packer;
    char *bytes;
    size_t size;
    size_t room;
} packed;

static void begin(packed *f, bool steady)
{
    *f = (packed){.room = 2 * TEXT_BYTES};
    f->bytes = malloc(f->room);
    assert_non_null(f->bytes);
    assert_true(journal_packer(&f->packer, steady));
}

static void put_bytes(packed *f, const void *bytes, size_t size)
{
    assert_non_null(bytes);
    assert_true(f->size + size <= f->room);
    memcpy(f->bytes + f->size, bytes, size);
    f->size += size;
}

static void put_text(packed *f, const char *text, size_t size)
{
    size_t count;
    const void *bytes = f->packer.pack(f->packer.user, &count, text, size);
    put_bytes(f, bytes, count);
    f->packer.settle(f->packer.user, true);
}

/* Packs a text that a disk does not take. */
static void lose_text(const packed *f, const char *text, size_t size)
{
    size_t count;
    assert_non_null(f->packer.pack(f->packer.user, &count, text, size));
    f->packer.settle(f->packer.user, false);
}

static void put_end(packed *f)
{
    size_t count;
    const void *bytes = f->packer.end(f->packer.user, &count);
    put_bytes(f, bytes, count);
    f->packer.settle(f->packer.user, true);
}

static void end(packed *f)
{
    f->packer.free(f->packer.user);
    free(f->bytes);
}

/* Returns the text of a file, and how many parts of it could not be read. */
static char *text_of(const packed *f, size_t *size, unsigned *torn)
{
    enum { CHUNK = 1000 };
    const char *problem;
    bool damaged;
    char *text = malloc(f->room + CHUNK);
    write_bytes("journal", f->bytes, f->size);
    int fd = open(path_of("journal"), O_RDONLY | O_CLOEXEC);
    journal_unpacker *u = journal_unpack(fd);
    assert_true(text && u);
    *size = 0;
    *torn = 0;
    for (ssize_t count = 1; count != 0;) {
        count = journal_unpack_read(u, text + *size, CHUNK, &problem, &damaged);
        *size += count > 0 ? (size_t)count : 0;
        assert_true(*size <= f->room);
        if (count >= 0)
            continue;
        assert_true(damaged && strlen(problem) > 0);
        ++*torn;
        if (!journal_unpack_go_on(u))
            break;
    }
    journal_unpack_end(u);
    close(fd);
    return text;
}

static void check_text_is(const packed *f, const char *text, size_t size)
{
    size_t found;
    unsigned torn;
    char *again = text_of(f, &found, &torn);
    assert_int_equal(torn, 0);
    assert_int_equal(found, size);
    assert_memory_equal(again, text, size);
    free(again);
}

static uint32_t draw(uint64_t *state, uint32_t limit)
{
    *state ^= *state << 13;
    *state ^= *state >> 7;
    *state ^= *state << 17;
    return (uint32_t)(*state >> 32) % limit;
}

/* Returns lines, as a journal has them. */
static char *make_text(uint64_t seed)
{
    uint64_t state = seed * 0x9E3779B97F4A7C15u | 1u;
    char *text = malloc(TEXT_BYTES + 100);
    assert_non_null(text);
    for (size_t used = 0; used < TEXT_BYTES;)
        used += (size_t)snprintf(text + used, 100, "{\"at\":%zu,\"send\":\"a\",\"in\":%u}\n", used,
                                 (unsigned)draw(&state, 5000));
    return text;
}

/* ---- All of it ------------------------------------------------------------------------------- */

TEST(all_that_has_been_packed_can_be_read_at_any_time)
{
    uint64_t random = 1;
    packed f;
    char *text = make_text(1);
    begin(&f, false);
    for (size_t used = 0; used < TEXT_BYTES;) {
        const size_t most = TEXT_BYTES - used;
        const size_t count = 1 + draw(&random, used < 20000 ? 300 : 60000);
        put_text(&f, text + used, count < most ? count : most);
        used += count < most ? count : most;
        check_text_is(&f, text, used);
    }
    assert_true(f.size < TEXT_BYTES / 2);
    put_end(&f);
    check_text_is(&f, text, TEXT_BYTES);
    end(&f);
    free(text);
}

TEST(a_steady_file_depends_on_its_text_alone)
{
    packed first, f;
    char *text = make_text(2);
    begin(&first, true);
    put_text(&first, text, TEXT_BYTES);
    put_end(&first);
    for (uint64_t seed = 1; seed < 20; seed++) {
        uint64_t random = seed;
        begin(&f, true);
        for (size_t used = 0; used < TEXT_BYTES;) {
            const size_t most = TEXT_BYTES - used;
            const size_t count = 1 + draw(&random, seed % 2 ? 3000 : 200000);
            put_text(&f, text + used, count < most ? count : most);
            used += count < most ? count : most;
        }
        put_end(&f);
        assert_int_equal(f.size, first.size);
        assert_memory_equal(f.bytes, first.bytes, f.size);
        end(&f);
    }
    check_text_is(&first, text, TEXT_BYTES);
    end(&first);
    free(text);
}

/* ---- What is left of it ---------------------------------------------------------------------- */

/* At each place of a frame, and between frames. */
TEST(what_the_disk_has_not_taken_is_missing_and_nothing_else)
{
    uint64_t random = 7;
    packed f;
    char *text = make_text(3);
    char *left = malloc(TEXT_BYTES);
    for (unsigned steady = 0; steady < 2; steady++) {
        size_t kept = 0;
        begin(&f, steady);
        for (size_t used = 0; used + 20000 < TEXT_BYTES;) {
            const size_t count = 1 + draw(&random, 20000);
            const bool lost = draw(&random, 3) == 0;
            if (lost && steady) /* the part in memory would be lost, too */
                put_end(&f);
            if (lost) {
                lose_text(&f, text + used, count);
            } else {
                put_text(&f, text + used, count);
                memcpy(left + kept, text + used, count);
                kept += count;
            }
            used += count;
        }
        put_end(&f);
        check_text_is(&f, left, kept);
        end(&f);
    }
    free(left);
    free(text);
}

TEST(a_file_that_has_been_emptied_goes_on)
{
    packed f;
    begin(&f, false);
    put_text(&f, "before\n", 7);
    f.size = 0;
    f.packer.begin(f.packer.user);
    put_text(&f, "behind\n", 7);
    put_end(&f);
    check_text_is(&f, "behind\n", 7);
    end(&f);
}

/* A file that ends with errors only is still one that can be read. */
TEST(a_file_without_text_is_empty)
{
    packed f;
    begin(&f, false);
    lose_text(&f, "lost\n", 5);
    put_end(&f);
    check_text_is(&f, "", 0);
    end(&f);
}

/* ---- Damage ---------------------------------------------------------------------------------- */

/* Returns true when lines in a row are in a text. */
static bool is_part(const char *part, size_t size, const char *text)
{
    return memmem(text, TEXT_BYTES, part, size) != NULL;
}

TEST(behind_damage_comes_the_next_frame)
{
    size_t size;
    unsigned torn, found = 0;
    packed f;
    char *text = make_text(4);
    begin(&f, false);
    for (size_t used = 0; used < TEXT_BYTES; used += 1000)
        put_text(&f, text + used, TEXT_BYTES - used < 1000 ? TEXT_BYTES - used : 1000);
    put_end(&f);
    const size_t last = journal_pack_last_frame(f.bytes, f.size);
    assert_true(last > f.size / 2 && last < f.size);
    for (size_t i = 4; i < last; i += 97) {
        f.bytes[i] = (char)(f.bytes[i] ^ 1 << i % 8);
        char *left = text_of(&f, &size, &torn);
        assert_true(size >= 1000 && is_part(left + size - 1000, 1000, text));
        found += torn > 0;
        f.bytes[i] = (char)(f.bytes[i] ^ 1 << i % 8);
        free(left);
    }
    assert_true(found > 0);
    check_text_is(&f, text, TEXT_BYTES);
    end(&f);
    free(text);
}

TEST(a_text_is_not_unpacked)
{
    packed f = {.room = 1000};
    static const char *const texts[] = {"", "{", "{\"canwire-journal\":1}\n", "(\xB5/"};
    for (size_t i = 0; i < COUNT(texts); i++) {
        f.bytes = strdup(texts[i]);
        f.size = strlen(texts[i]);
        check_text_is(&f, texts[i], f.size);
        free(f.bytes);
    }
}

TESTS_WITH(make_folder, remove_folder)
