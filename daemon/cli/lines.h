/* SPDX-License-Identifier: MIT
 *
 * lines.h - reads the lines of a peer that may be slow, hang, or never end a line.
 */
#ifndef CANWIRE_CLI_LINES_H
#define CANWIRE_CLI_LINES_H

#include "base/text/buffer.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define LINES_MAX_BYTES (16u << 20) /* of a line; a status of 64 nodes has 200 KB */
#define LINES_NO_END INT64_MAX      /* a moment that does not come */

typedef struct lines_reader {
    buffer bytes;
    size_t shown; /* bytes at its start: the line that was returned last */
    size_t seen;  /* bytes at its start without an end of a line */
} lines_reader;

/* Waits for events of poll() until a moment of wall_ns(). Returns false with errno, which is EAGAIN
 * when that has passed. It finds what is already there also after that moment. */
bool lines_wait(int fd, short events, int64_t until);

/* Returns the next line, without its end; it lives until the next call. All of it must come until
 * that moment: a peer that sends now and then gains no time. Returns NULL with errno: 0 at the end,
 * EAGAIN when the time is over, EMSGSIZE for a line that is too long, or another one. */
char *lines_next(lines_reader *l, int fd, int64_t until);

void lines_free(lines_reader *l);

#endif
