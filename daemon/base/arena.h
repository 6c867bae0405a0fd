/* SPDX-License-Identifier: MIT
 *
 * arena.h - memory that is freed all at once.
 */
#ifndef CANWIRE_BASE_ARENA_H
#define CANWIRE_BASE_ARENA_H

#include <stdarg.h>
#include <stddef.h>

typedef struct arena_block arena_block;

/* All zeros is an empty arena. */
typedef struct arena {
    arena_block *blocks;
} arena;

/* Returns zeroed memory, aligned for anything, or NULL when there is no memory. */
void *arena_alloc(arena *self, size_t size);

/* Returns a formatted string, or NULL when there is no memory. */
char *arena_print(arena *self, const char *format, ...) __attribute__((format(printf, 2, 3)));

char *arena_print_list(arena *self, const char *format, va_list args)
    __attribute__((format(printf, 2, 0)));

void arena_free(arena *self);

#endif
