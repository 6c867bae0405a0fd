/* SPDX-License-Identifier: MIT
 *
 * memo.c - takes down as a text what functions write to a stream.
 */
#include "base/text/memo.h"

#include <stdbool.h>
#include <stdlib.h>

FILE *memo_begin(memo *t)
{
    *t = (memo){.text = NULL};
    return t->out = open_memstream(&t->text, &t->size);
}

/* Behind the end there may be a longer text from before a rewind. */
char *memo_text(const memo *t)
{
    if (!t->out || fflush(t->out) != 0)
        return NULL;
    t->text[t->size] = '\0';
    return t->text;
}

char *memo_take(memo *t)
{
    const bool good = t->out && fclose(t->out) == 0;
    char *text = t->text;
    *t = (memo){.text = NULL};
    if (good)
        return text;
    free(text);
    return NULL;
}

void memo_end(memo *t)
{
    free(memo_take(t));
}
