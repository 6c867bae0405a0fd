/* SPDX-License-Identifier: MIT
 *
 * journal_keep.c - chooses the older journals that are kept when a new one begins.
 */
#include "run/journal_keep.h"

#include "base/file/filelock.h"
#include "base/file/folder.h"
#include "base/log.h"
#include "base/text/buffer.h"
#include "base/text/number.h"
#include "run/journal_pack.h"
#include "run/journal_seal.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <jansson.h>
#include <limits.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define HEAD_BYTES 4096u
#define TAIL_BYTES (16u << 20) /* that are searched for the last line, packed or not */
#define WORD_BYTES 64u

/* An older journal. */
typedef struct found {
    unsigned number; /* 0: FILE itself */
    bool empty;
    bool begun; /* it begins with the first line of a journal */
    bool ended;
    bool timed; /* a line has a time */
    uint64_t tick;
    char bus[WORD_BYTES];
    char started[WORD_BYTES];
} found;

typedef struct row {
    folder folder;
    const char *file;
    size_t count; /* from the newest to the oldest */
    found all[JOURNAL_FILES_MAX + 1];
} row;

/* Number 0 is the file itself, which has no number in its name. */
static void print_name(char name[PATH_MAX], const char *file, unsigned number)
{
    if (number == 0)
        (void)snprintf(name, PATH_MAX, "%s", file);
    else
        (void)snprintf(name, PATH_MAX, "%s.%u", file, number);
}

/* ---- Content --------------------------------------------------------------------------------- */

/* Returns the begin of the line that ends before a place. */
static const char *line_before(const char *text, const char *end)
{
    const char *before = end - text > 1 ? memrchr(text, '\n', (size_t)(end - text) - 1) : NULL;
    return before ? before + 1 : text;
}

/* Returns true for a line of a text with a wrong seal. It is of the lines before that have none,
 * too; when the first of these is not in the text, it cannot be checked. */
static bool is_damaged(const char *text, const char *line, size_t length)
{
    const char *group = line;
    while (group > text) {
        const char *before = line_before(text, group);
        if (journal_seal_is_there(before, (size_t)(group - before) - 1))
            break;
        group = before;
    }
    const uint32_t crc = journal_crc32(0, group, (size_t)(line - group));
    return group > text && journal_seal_check(line, length, crc) == JOURNAL_SEAL_WRONG &&
           journal_seal_check(line, length, 0) == JOURNAL_SEAL_WRONG;
}

/* Returns NULL for damaged lines and for other text. */
static json_t *parse_line(const char *text, const char *line, size_t length)
{
    if (is_damaged(text, line, length))
        return NULL;
    json_t *object = json_loadb(line, length, JSON_ALLOW_NUL, NULL);
    if (json_is_object(object))
        return object;
    json_decref(object);
    return NULL;
}

static void copy_word(char word[WORD_BYTES], const json_t *text)
{
    const char *from = json_string_value(text);
    (void)snprintf(word, WORD_BYTES, "%s", from ? from : "?");
}

/* Reads a file from a place on, unpacked, up to so many bytes or as far as it can be. */
static void read_text(buffer *text, int fd, off_t from, size_t most)
{
    const char *problem;
    bool damaged;
    ssize_t count = 1;
    journal_unpacker *u = lseek(fd, from, SEEK_SET) == from ? journal_unpack(fd) : NULL;
    while (u && count > 0 && buffer_length(text) < most && buffer_reserve(text, HEAD_BYTES)) {
        count = journal_unpack_read(u, text->data + text->end, HEAD_BYTES, &problem, &damaged);
        text->end += count > 0 ? (size_t)count : 0;
    }
    journal_unpack_end(u);
}

/* Reads from the first line of a file to what bus it belongs and when it was begun. */
static void read_head(found *f, int fd)
{
    buffer text = {.data = NULL};
    read_text(&text, fd, 0, HEAD_BYTES);
    const char *head = buffer_length(&text) > 0 ? buffer_first(&text) : "";
    const char *end = memchr(head, '\n', buffer_length(&text));
    json_t *line = end ? parse_line(head, head, (size_t)(end - head)) : NULL;
    f->begun = json_object_get(line, "canwire-journal");
    copy_word(f->bus, json_object_get(line, "bus"));
    copy_word(f->started, json_object_get(line, "started"));
    json_decref(line);
    buffer_free(&text);
}

/* Reads a line of a journal. last: it is the last line of the file, and complete. */
static bool journal_keep_take_line(found *f, const json_t *line, bool last)
{
    const json_t *at = json_object_get(line, "at");
    f->timed = json_is_integer(at) && json_integer_value(at) >= 0;
    f->tick = f->timed ? (uint64_t)json_integer_value(at) : 0;
    f->ended = last && f->timed && json_object_get(line, "end");
    return f->timed;
}

/* Searches backwards for a readable line; an incomplete line does not count. */
static bool search_text(found *f, const char *text, size_t size)
{
    const char *end = memrchr(text, '\n', size);
    bool last = end == text + size - 1;
    bool taken = false;
    while (end && !taken) {
        const char *line = line_before(text, end);
        json_t *object = parse_line(text, line, (size_t)(end - line));
        taken = journal_keep_take_line(f, object, last);
        json_decref(object);
        last = false;
        end = line > text ? line - 1 : NULL;
    }
    return taken;
}

/* Searches in what the file has from a place on. */
static bool search_from(found *f, int fd, off_t from)
{
    buffer text = {.data = NULL};
    read_text(&text, fd, from, TAIL_BYTES);
    const bool good =
        buffer_length(&text) > 0 && search_text(f, buffer_first(&text), buffer_length(&text));
    buffer_free(&text);
    return good;
}

/* Searches the last part of the file. A packed one can be read from the beginning of a frame on:
 * from the last one, or one before it. */
static void read_tail(found *f, int fd, off_t size)
{
    size_t want = size < (off_t)TAIL_BYTES ? (size_t)size : TAIL_BYTES;
    const off_t from = size - (off_t)want;
    char *tail = malloc(want + 1);
    const ssize_t count = tail ? pread(fd, tail, want, from) : -1;
    size_t begin = count > 0 ? (size_t)count : 0;
    bool packed = false, done = false;
    while (!done && (begin = journal_pack_last_frame(tail, begin)) != SIZE_MAX) {
        packed = true;
        done = search_from(f, fd, from + (off_t)begin);
    }
    if (!packed && count > 0)
        (void)search_text(f, tail, (size_t)count);
    free(tail);
}

/* Returns 0 or EBUSY. An unreadable file counts as one without end. */
static int read_one(found *f, int directory, const char *name)
{
    struct stat info;
    int fd = openat(directory, name, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
    copy_word(f->bus, NULL);
    copy_word(f->started, NULL);
    if (fd < 0)
        return 0;
    int error = filelock_take(fd);
    if (error == 0 && fstat(fd, &info) == 0 && S_ISREG(info.st_mode)) {
        f->empty = info.st_size == 0;
        read_head(f, fd);
        read_tail(f, fd, info.st_size);
    }
    (void)close(fd);
    return error;
}

/* Returns true for a journal. A file without a first line or any line of one belongs to somebody
 * else and is never removed. */
static bool is_journal(const found *f)
{
    return f->empty || f->begun || f->timed;
}

/* ---- The list -------------------------------------------------------------------------------- */

/* Returns 0 or an errno; EINVAL: a file is not a regular file. */
static int read_row(row *r)
{
    char name[PATH_MAX];
    struct stat info;
    for (unsigned i = 0; i <= JOURNAL_FILES_MAX; i++) {
        print_name(name, r->folder.name, i);
        if (fstatat(r->folder.fd, name, &info, AT_SYMLINK_NOFOLLOW) != 0)
            continue;
        if (!S_ISREG(info.st_mode))
            return EINVAL;
        found *f = &r->all[r->count++];
        *f = (found){.number = i};
        int error = read_one(f, r->folder.fd, name);
        if (error != 0)
            return error;
    }
    return 0;
}

/* Describes a journal of a row for people: its name, its bus, and how far it goes. */
static void journal_keep_describe(char text[PATH_MAX], const row *r, const found *f)
{
    char name[PATH_MAX];
    char time[TIME_TEXT_MAX];
    print_name(name, r->file, f->number);
    text_print_seconds(time, f->tick);
    (void)snprintf(text, PATH_MAX, "journal %.3000s (bus %s, begun %s, %s%s%s)", name, f->bus,
                   f->started, f->empty ? "empty" : f->timed ? "up to " : "not readable",
                   f->timed ? time : "", f->timed ? " s" : "");
}

/* Warns of journals that have no end: their canwired was killed, or the disk was full. */
static void report_without_end(const row *r)
{
    char text[PATH_MAX];
    for (size_t i = 0; i < r->count; i++) {
        if (r->all[i].ended || r->all[i].empty)
            continue;
        if (!is_journal(&r->all[i])) {
            print_name(text, r->file, r->all[i].number);
            log_warning("%s is no journal: it is kept", text);
            continue;
        }
        journal_keep_describe(text, r, &r->all[i]);
        log_warning("%s has no end: that canwired did not stop by itself%s", text,
                    r->all[i].number == 0 ? ", or its disk was full" : "");
    }
}

/* Returns the number of the journal to remove; 0: none. The newest one stays. */
static size_t journal_keep_choose(const row *r)
{
    size_t first = 0; /* the oldest without end */
    size_t second = 0;
    for (size_t i = r->count; i-- > 1;) {
        if (!is_journal(&r->all[i]))
            continue;
        if (r->all[i].ended || r->all[i].empty)
            return i;
        if (first == 0)
            first = i;
        else if (second == 0)
            second = i;
    }
    return second;
}

/* Returns 0 or an errno. */
static int remove_one(row *r, size_t which)
{
    char name[PATH_MAX];
    char text[PATH_MAX];
    const found f = r->all[which];
    print_name(name, r->folder.name, f.number);
    if (unlinkat(r->folder.fd, name, 0) != 0 && errno != ENOENT)
        return errno;
    journal_keep_describe(text, r, &f);
    log_warning("%s is removed%s", text, f.empty ? "" : ": there are too many");
    r->count--;
    memmove(&r->all[which], &r->all[which + 1], (r->count - which) * sizeof r->all[0]);
    return 0;
}

/* Counts the journals: other files of the row belong to somebody else, and stay. */
static size_t count_journals(const row *r)
{
    size_t count = 0;
    for (size_t i = 0; i < r->count; i++)
        count += is_journal(&r->all[i]);
    return count;
}

/* Removes old journals until a new one makes `files`. An empty one that is the newest goes
 * first. */
static int remove_some(row *r, unsigned files)
{
    int error = 0;
    size_t which;
    if (r->count > 0 && r->all[0].number == 0 && r->all[0].empty)
        error = remove_one(r, 0);
    while (error == 0 && count_journals(r) >= files && (which = journal_keep_choose(r)) > 0)
        error = remove_one(r, which);
    return error;
}

/* Renames FILE to FILE.1 and so on, up to the first free number. Returns 0 or an errno. */
static int shift(const row *r)
{
    size_t used = 0;
    int error = 0;
    while (used < r->count && r->all[used].number == used)
        used++;
    for (size_t i = used; i-- > 0 && error == 0;) {
        char from[PATH_MAX];
        char to[PATH_MAX];
        print_name(from, r->folder.name, (unsigned)i);
        print_name(to, r->folder.name, (unsigned)i + 1);
        if (renameat(r->folder.fd, from, r->folder.fd, to) != 0)
            error = errno;
    }
    return error;
}

int journal_make_room(const char *file, unsigned files)
{
    row *r = calloc(1, sizeof *r);
    if (!r)
        return ENOMEM;
    r->file = file;
    int error = folder_open(&r->folder, file);
    if (error == 0)
        error = read_row(r);
    if (error == 0) {
        report_without_end(r);
        error = remove_some(r, files);
    }
    if (error == 0)
        error = shift(r);
    folder_close(&r->folder);
    free(r);
    return error;
}
