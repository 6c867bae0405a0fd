/* SPDX-License-Identifier: MIT
 *
 * buffer.c - bytes in memory that grows and shrinks.
 */
#include "base/text/buffer.h"

#include <assert.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SIZE_MIN 4096u
#define SIZE_KEPT 65536u /* of an empty buffer; a larger one frees its memory */

/* Moves bytes only once the bytes taken are half of the memory, so the cost of a byte is
 * bounded. */
static void move_to_front(buffer *self)
{
    if (self->begin == 0 || self->begin < self->size / 2)
        return;
    memmove(self->data, buffer_first(self), buffer_length(self));
    self->end -= self->begin;
    self->begin = 0;
}

static bool note_lack(buffer *self)
{
    self->no_memory = true;
    return false;
}

bool buffer_reserve(buffer *self, size_t count)
{
    if (count <= self->size - self->end)
        return true;
    move_to_front(self);
    size_t size = self->size > SIZE_MIN ? self->size : SIZE_MIN;
    while (size - self->end < count) {
        if (size > SIZE_MAX / 2)
            return note_lack(self);
        size *= 2;
    }
    if (size == self->size)
        return true;
    char *data = realloc(self->data, size);
    if (!data)
        return note_lack(self);
    self->data = data;
    self->size = size;
    return true;
}

bool buffer_append(buffer *self, const char *bytes, size_t count)
{
    if (!buffer_reserve(self, count))
        return false;
    if (count > 0)
        memcpy(self->data + self->end, bytes, count);
    self->end += count;
    return true;
}

void buffer_put(buffer *self, const char *text)
{
    (void)buffer_append(self, text, strlen(text));
}

void buffer_print(buffer *self, const char *format, ...)
{
    va_list args, again;
    va_start(args, format);
    va_copy(again, args);
    const int length = vsnprintf(NULL, 0, format, args);
    if (length >= 0 && buffer_reserve(self, (size_t)length + 1)) {
        (void)vsnprintf(self->data + self->end, (size_t)length + 1, format, again);
        self->end += (size_t)length;
    }
    va_end(again);
    va_end(args);
}

const char *buffer_text(buffer *self)
{
    if (!buffer_reserve(self, 1) || self->no_memory)
        return NULL;
    self->data[self->end] = '\0';
    return buffer_first(self);
}

void buffer_clear(buffer *self)
{
    self->begin = 0;
    self->end = 0;
    self->no_memory = false;
}

void buffer_take(buffer *self, size_t count)
{
    assert(count <= buffer_length(self));
    self->begin += count;
    if (self->begin < self->end)
        return;
    self->begin = 0;
    self->end = 0;
    if (self->size > SIZE_KEPT)
        buffer_free(self);
}

void buffer_free(buffer *self)
{
    free(self->data);
    *self = (buffer){.data = NULL};
}
