/* SPDX-License-Identifier: MIT
 *
 * pool_worker.c - the processes of a pool: what they get and what they give.
 */
#include "campaign/pool_worker.h"

#include "base/wall.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define GIVE_BYTES (32u << 10) /* lines are given when there are so many bytes ... */
#define GIVE_NS INT64_C(50000000) /* ... or after this time */

/* Returns false when the other end is gone. */
static bool give(int fd, buffer *lines)
{
    while (buffer_length(lines) > 0) {
        const ssize_t count = write(fd, buffer_first(lines), buffer_length(lines));
        if (count < 0 && errno != EINTR)
            return false;
        if (count > 0)
            buffer_take(lines, (size_t)count);
    }
    return true;
}

static bool get(int fd, pool_order *order)
{
    char *at = (char *)order;
    size_t left = sizeof *order;
    while (left > 0) {
        const ssize_t count = read(fd, at, left);
        if (count == 0 || (count < 0 && errno != EINTR))
            return false;
        if (count > 0) {
            at += count;
            left -= (size_t)count;
        }
    }
    return true;
}

bool pool_add_line(buffer *lines, unsigned char flag, const buffer *line)
{
    char head[POOL_HEAD_BYTES] = {(char)flag};
    const uint32_t length = (uint32_t)buffer_length(line);
    memcpy(head + 1, &length, sizeof length);
    return !line->no_memory && buffer_append(lines, head, sizeof head) &&
           buffer_append(lines, buffer_first(line), length);
}

/* Adds a line to those that wait. */
static bool pool_worker_add(const pool_work *work, uint64_t number, buffer *line, buffer *lines)
{
    buffer_clear(line);
    return pool_add_line(lines, work->calls->make(work->user, number, line), line);
}

static bool pool_worker_obey(const pool_work *work, int fd, const pool_order *order, buffer *line,
                             buffer *lines)
{
    int64_t given = wall_ns();
    for (uint64_t i = 0; i < order->count; i++) {
        if (!pool_worker_add(work, order->first + i, line, lines)) {
            (void)give(fd, lines);
            _exit(POOL_EXIT_SHORT);
        }
        if (!order->singly && buffer_length(lines) < GIVE_BYTES && wall_ns() - given < GIVE_NS)
            continue;
        if (!give(fd, lines))
            return false;
        given = wall_ns();
    }
    return give(fd, lines);
}

_Noreturn void pool_worker(const pool_work *work, int fd)
{
    pool_order order;
    buffer line = {.data = NULL};
    buffer lines = {.data = NULL};
    bool good = true;
    while (good && get(fd, &order))
        good = pool_worker_obey(work, fd, &order, &line, &lines);
    _exit(good ? EXIT_SUCCESS : EXIT_FAILURE);
}
