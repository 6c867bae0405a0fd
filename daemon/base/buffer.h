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

/* Bytes that wait. */
static inline size_t buffer_length(const buffer *self)
{
    return self->end - self->begin;
}

/* The first of them; stays where it is until the next buffer_reserve() or buffer_take(). */
static inline char *buffer_first(const buffer *self)
{
    return self->data + self->begin;
}

/* Makes room for so many bytes behind the last one. False when there is no memory. */
bool buffer_reserve(buffer *self, size_t count);

/* Appends bytes. False, with nothing changed, when there is no memory. */
bool buffer_append(buffer *self, const char *bytes, size_t count);

/* Takes the first bytes away. */
void buffer_take(buffer *self, size_t count);

/* Leaves an empty buffer. */
void buffer_free(buffer *self);

#endif
