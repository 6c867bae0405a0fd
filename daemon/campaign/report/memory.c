/* SPDX-License-Identifier: MIT
 *
 * memory.c - memory of a report. Half a report would be wrong, so a lack of it ends the program.
 */
#include "campaign/report/memory.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ROOM_FIRST 16u

_Noreturn static void memory_give_up(void)
{
    fputs("canwire campaign: out of memory\n", stderr);
    exit(EXIT_FAILURE);
}

void *memory_list(void *list, size_t count, size_t item_bytes)
{
    void *memory = reallocarray(list, count > 0 ? count : 1, item_bytes);
    if (!memory)
        memory_give_up();
    return memory;
}

void *memory_grow(void *list, size_t *room, size_t count, size_t item_bytes)
{
    if (count < *room)
        return list;
    *room = *room > 0 ? 2 * *room : ROOM_FIRST;
    return memory_list(list, *room, item_bytes);
}

char *memory_text(const char *text)
{
    char *copy = strdup(text);
    if (!copy)
        memory_give_up();
    return copy;
}

const char *memory_seen(buffer *b)
{
    const char *text = buffer_text(b);
    if (!text)
        memory_give_up();
    return text;
}

char *memory_of_buffer(buffer *b)
{
    char *text = memory_text(memory_seen(b));
    buffer_free(b);
    return text;
}

const jsonread_value *memory_json(jsonread *r, jsonread_problem *problem, const char *text,
                                  size_t length)
{
    const jsonread_value *value = jsonread_text(r, problem, text, length);
    if (*problem == JSONREAD_NO_MEMORY)
        memory_give_up();
    return value;
}

char *memory_print(const char *format, ...)
{
    va_list args;
    char *text = NULL;
    va_start(args, format);
    const int length = vasprintf(&text, format, args);
    va_end(args);
    if (length < 0)
        memory_give_up();
    return text;
}
