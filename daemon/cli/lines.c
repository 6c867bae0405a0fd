/* SPDX-License-Identifier: MIT
 *
 * lines.c - reads the lines of a peer that may be slow, hang, or never end a line.
 */
#include "cli/lines.h"

#include "base/wall.h"

#include <errno.h>
#include <limits.h>
#include <poll.h>
#include <string.h>
#include <unistd.h>

#define READ_BYTES 65536u
#define NS_PER_MS 1000000

/* Returns the time that is left for poll(), rounded up. */
static int left_ms(int64_t until)
{
    if (until == LINES_NO_END)
        return -1;
    const int64_t left = until - wall_ns();
    if (left <= 0)
        return 0;
    return left / NS_PER_MS < INT_MAX - 1 ? (int)(left / NS_PER_MS) + 1 : INT_MAX;
}

bool lines_wait(int fd, short events, int64_t until)
{
    struct pollfd waits = {.fd = fd, .events = events};
    int count;
    do
        count = poll(&waits, 1, left_ms(until));
    while (count < 0 && errno == EINTR);
    if (count == 0)
        errno = EAGAIN;
    return count > 0;
}

/* Appends what is there. Returns false with errno, which is 0 at the end. */
static bool read_more(lines_reader *l, int fd, int64_t until)
{
    ssize_t count = -1;
    errno = ENOMEM;
    if (!buffer_reserve(&l->bytes, READ_BYTES))
        return false;
    do
        if (!lines_wait(fd, POLLIN, until))
            return false;
    while ((count = read(fd, l->bytes.data + l->bytes.end, READ_BYTES)) < 0 && errno == EINTR);
    if (count == 0)
        errno = 0;
    if (count > 0)
        l->bytes.end += (size_t)count;
    return count > 0;
}

/* Returns a line of that many bytes; one more is its end. */
static char *lines_show(lines_reader *l, size_t length)
{
    char *line = buffer_first(&l->bytes);
    line[length] = '\0';
    l->shown = length + 1;
    l->seen = 0;
    return line;
}

/* Returns the rest of what has ended within a line, or NULL. */
static char *show_rest(lines_reader *l)
{
    const size_t length = buffer_length(&l->bytes);
    if (length == 0 || !buffer_append(&l->bytes, "", 1))
        return NULL;
    return lines_show(l, length);
}

char *lines_next(lines_reader *l, int fd, int64_t until)
{
    buffer_take(&l->bytes, l->shown);
    l->shown = 0;
    for (;;) {
        const size_t length = buffer_length(&l->bytes);
        const char *rest = length > l->seen ? buffer_first(&l->bytes) + l->seen : NULL;
        const char *end = rest ? memchr(rest, '\n', length - l->seen) : NULL;
        if (end)
            return lines_show(l, l->seen + (size_t)(end - rest));
        l->seen = length;
        if (length > LINES_MAX_BYTES) {
            errno = EMSGSIZE;
            return NULL;
        }
        if (!read_more(l, fd, until))
            return errno == 0 ? show_rest(l) : NULL;
    }
}

void lines_free(lines_reader *l)
{
    buffer_free(&l->bytes);
    *l = (lines_reader){.shown = 0};
}
