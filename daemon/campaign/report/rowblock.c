/* SPDX-License-Identifier: MIT
 *
 * rowblock.c - reads the lines of a large file in several processes, and takes them in their order.
 *
 * A block has the lines that begin in it. A process makes digests of it, each behind its length. In
 * place of the last one there may be the reason that ends the reading.
 */
#include "campaign/report/rowblock.h"

#include "campaign/pool.h"
#include "campaign/report/memory.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define BLOCK_BYTES (UINT64_C(32) << 10) /* digests of some hundred of them wait */
#define MORE_BYTES (16u << 10) /* for the line that goes on in the next block */

/* In place of the length of a digest. */
#define WRONG UINT32_MAX     /* a text follows that says what is wrong with the line */
#define CUT (UINT32_MAX - 1) /* the file ends in the line */

/* The part of a file that a process reads. */
typedef struct block {
    const rowblock_work *work;
    uint64_t begin; /* in the file, of the bytes */
    buffer bytes;
    bool over;      /* no bytes come behind these */
    int error;      /* errno */
} block;

/* Reads more bytes. Returns false at the end of the file. */
static bool block_read_more(block *b, size_t count)
{
    const uint64_t at = b->begin + buffer_length(&b->bytes);
    const uint64_t left = b->work->size - at;
    count = left < count ? (size_t)left : count;
    if (!buffer_reserve(&b->bytes, count))
        (void)memory_seen(&b->bytes);
    while (count > 0) {
        const ssize_t got = pread(b->work->fd, b->bytes.data + b->bytes.end, count,
                                  (off_t)(b->begin + buffer_length(&b->bytes)));
        if (got < 0 && errno == EINTR)
            continue;
        b->error = got < 0 ? errno : 0;
        if (got <= 0)
            break;
        b->bytes.end += (size_t)got;
        count -= (size_t)got;
    }
    b->over = b->begin + buffer_length(&b->bytes) == b->work->size || count > 0;
    return b->begin + buffer_length(&b->bytes) > at;
}

/* Returns the length of the line that begins at a byte, with its end; 0: the file ends in it. */
static size_t find_line(block *b, size_t at)
{
    size_t seen = at;
    for (;;) {
        const char *first = buffer_first(&b->bytes);
        const size_t length = buffer_length(&b->bytes);
        const char *end = memchr(first + seen, '\n', length - seen);
        if (end)
            return (size_t)(end - first) + 1 - at;
        seen = length;
        if (b->over || !block_read_more(b, MORE_BYTES))
            return 0;
    }
}

static void put_size(buffer *out, uint32_t size)
{
    (void)buffer_append(out, (const char *)&size, sizeof size);
}

/* Puts what is wrong with the line. */
static void put_wrong(buffer *out, const char *wrong)
{
    put_size(out, WRONG);
    (void)buffer_append(out, wrong, strlen(wrong) + 1);
}

/* Puts the digest of a line. Returns false when something is wrong with it, which follows then. */
static bool put_line(const block *b, size_t at, size_t length, buffer *out)
{
    const size_t place = buffer_length(out);
    put_size(out, 0);
    char *wrong = b->work->calls->read(b->work->user, buffer_first(&b->bytes) + at, length, out);
    if (wrong) {
        out->end = out->begin + place;
        put_wrong(out, wrong);
        free(wrong);
        return false;
    }
    (void)memory_seen(out); /* all of it is there */
    const uint32_t size = (uint32_t)(buffer_length(out) - place - sizeof size);
    memcpy(buffer_first(out) + place, &size, sizeof size);
    return true;
}

/* Puts the lines that begin before `end` bytes of the block, from one on. */
static void put_lines(block *b, size_t at, size_t end, buffer *out)
{
    while (at < end && at < buffer_length(&b->bytes)) {
        const size_t length = find_line(b, at);
        if (length > 0 && !put_line(b, at, length, out))
            return;
        if (length == 0 && !b->error)
            put_size(out, CUT);
        if (length == 0)
            break;
        at += length;
    }
    if (b->error)
        put_wrong(out, strerror(b->error));
}

/* A line that has begun in an earlier block belongs there. */
static unsigned char rowblock_make(void *user, uint64_t number, buffer *out)
{
    const rowblock_work *work = user;
    const size_t before = number > 0; /* the byte that may end the last line of the block before */
    block b = {.work = work, .begin = number * BLOCK_BYTES - before};
    (void)block_read_more(&b, BLOCK_BYTES + before);
    const size_t end = before + BLOCK_BYTES;
    const char *first = buffer_first(&b.bytes);
    const size_t length = buffer_length(&b.bytes);
    const char *behind = before ? memchr(first, '\n', length) : NULL;
    const size_t skipped = !before ? 0 : behind ? (size_t)(behind - first) + 1 : length;
    put_lines(&b, skipped, end, out);
    buffer_free(&b.bytes);
    return 0;
}

/* A block whose process ends is an error of the reading: its rows must not be missing in
 * silence. */
static unsigned char rowblock_lose(void *user, uint64_t number, const pool_loss *loss,
                                   buffer *out)
{
    (void)user;
    (void)number;
    (void)loss;
    put_wrong(out, "the process that reads it has ended");
    return 0;
}

/* Takes the digests of a block. Nothing is read behind a line that is wrong; one that is cut is the
 * last. */
static bool rowblock_take(void *user, unsigned char code, const char *digests, size_t length)
{
    const rowblock_work *work = user;
    const char *const end = digests + length;
    bool good = true;
    (void)code;
    for (const char *at = digests; at < end && good;) {
        uint32_t size;
        memcpy(&size, at, sizeof size);
        at += sizeof size;
        if (size == WRONG) {
            (void)work->calls->problem(work->user, at);
            return false;
        }
        if (size == CUT)
            return work->calls->problem(work->user, NULL);
        good = work->calls->take(work->user, at);
        at += size;
    }
    return good;
}

bool rowblock_read(const rowblock_work *work)
{
    static const pool_calls calls = {.make = rowblock_make, .lose = rowblock_lose,
                                     .take = rowblock_take};
    const pool_work blocks = {.calls = &calls, .user = (void *)work,
                              .count = (work->size + BLOCK_BYTES - 1) / BLOCK_BYTES,
                              .jobs = work->jobs};
    return pool_run(&blocks);
}
