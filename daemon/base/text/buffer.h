/* SPDX-License-Identifier: MIT
 *
 * buffer.h - bytes in memory that grows and shrinks: a text in the making, or bytes that wait,
 * first in, first out.
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
    bool no_memory; /* bytes are missing */
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

/* Makes room for so many bytes behind the last one. Returns false when there is no memory, which is
 * noted. */
bool buffer_reserve(buffer *self, size_t count);

/* Appends bytes; none, and returns false, when there is no memory. */
bool buffer_append(buffer *self, const char *bytes, size_t count);

/* Appends a text. */
void buffer_put(buffer *self, const char *text);

/* Appends as printf() does. */
void buffer_print(buffer *self, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Returns the bytes as a text, whose final 0 does not count; NULL when some are missing. */
const char *buffer_text(buffer *self);

/* Forgets the bytes. */
void buffer_clear(buffer *self);

/* Removes the first bytes. */
void buffer_take(buffer *self, size_t count);

/* Frees the memory and leaves an empty buffer. */
void buffer_free(buffer *self);

#endif
