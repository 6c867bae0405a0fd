/* SPDX-License-Identifier: MIT
 *
 * arena.c - memory that is freed all at once.
 */
#include "base/arena.h"

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

struct arena_block {
    arena_block *next;
    max_align_t memory[];
};

void *arena_alloc(arena *self, size_t size)
{
    arena_block *block = NULL;

    if (size <= SIZE_MAX - sizeof *block)
        block = calloc(1, sizeof *block + size);
    if (!block)
        return NULL;
    block->next = self->blocks;
    self->blocks = block;
    return block->memory;
}

/* Formats twice: the first time only counts. NULL: without memory, or when the format fails. */
char *arena_print_list(arena *self, const char *format, va_list args)
{
    va_list again;

    va_copy(again, args);
    int length = vsnprintf(NULL, 0, format, args);
    char *text = length < 0 ? NULL : arena_alloc(self, (size_t)length + 1);
    if (text)
        vsnprintf(text, (size_t)length + 1, format, again);
    va_end(again);
    return text;
}

char *arena_print(arena *self, const char *format, ...)
{
    va_list args;

    va_start(args, format);
    char *text = arena_print_list(self, format, args);
    va_end(args);
    return text;
}

void arena_free(arena *self)
{
    while (self->blocks) {
        arena_block *block = self->blocks;
        self->blocks = block->next;
        free(block);
    }
}
