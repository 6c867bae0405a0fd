/* SPDX-License-Identifier: MIT
 *
 * told.c - messages of a call, for its caller.
 */
#include "embed/embed.h"

#include <stdlib.h>

bool embed_tell_begin(embed_told *t)
{
    *t = (embed_told){.out = open_memstream(&t->text, &t->size)};
    return t->out;
}

void embed_tell_end(embed_told *t, char **messages)
{
    if (t->out)
        (void)fclose(t->out);
    if (messages)
        *messages = t->size > 0 ? t->text : NULL;
    if (!messages || t->size == 0)
        free(t->text);
}
