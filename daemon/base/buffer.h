/* SPDX-License-Identifier: MIT
 *
 * buffer.h - bytes that wait, first in, first out, in memory that grows and shrinks.
 */
#ifndef CANWIRE_BASE_BUFFER_H
#define CANWIRE_BASE_BUFFER_H

#include <stdbool.h>
#include <stddef.h>

/* All zeros is an empty buffer. The bytes are data[begin] to data[end - 1]. */
typedef struct buffer {
    char *data;
    size_t begin;
    size_t end;
    size_t size;
} buffer;

/* Returns the number of bytes that wait. */
static inline size_t buffer_length(const buffer *self)
{
    return self->end - self->begin;
}

/* Returns the first byte that waits; it stays there until the next buffer_reserve() or
 * buffer_take(). */
static inline char *buffer_first(const buffer *self)
{
    return self->data + self->begin;
}

/* Makes room for so many bytes behind the last one. Returns false when there is no memory. */
bool buffer_reserve(buffer *self, size_t count);

/* Appends bytes. Changes nothing and returns false when there is no memory. */
bool buffer_append(buffer *self, const char *bytes, size_t count);

/* Removes the first bytes. */
void buffer_take(buffer *self, size_t count);

/* Frees the memory and leaves an empty buffer. */
void buffer_free(buffer *self);

#endif
