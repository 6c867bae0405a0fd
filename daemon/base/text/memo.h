/* SPDX-License-Identifier: MIT
 *
 * memo.h - takes down as a text what functions write to a stream.
 */
#ifndef CANWIRE_BASE_MEMO_H
#define CANWIRE_BASE_MEMO_H

#include <stdio.h>

/* All zeros is a stream that is not open. */
typedef struct memo {
    FILE *out;
    char *text; /* as of the last memo_text() */
    size_t size;
} memo;

/* Returns the stream, or NULL without memory; memo_end() is called in any case. */
FILE *memo_begin(memo *t);

/* Returns what has been written up to now, or NULL without memory. After rewind() that is what has
 * been written since. */
char *memo_text(const memo *t);

/* Closes the stream and returns the text, to be freed; NULL without memory. */
char *memo_take(memo *t);

void memo_end(memo *t);

#endif
