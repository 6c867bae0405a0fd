/* SPDX-License-Identifier: MIT
 *
 * parts.c - an input that is several texts.
 */
#include "parts.h"

#include <string.h>

static const char mark[] = "=== ";

/* Returns the next "=== " at the beginning of a line, or the end. */
static const char *find_mark(const char *from, const char *end)
{
    while (from < end) {
        if ((size_t)(end - from) > sizeof mark - 1 && memcmp(from, mark, sizeof mark - 1) == 0)
            return from;
        const char *newline = memchr(from, '\n', (size_t)(end - from));
        from = newline ? newline + 1 : end;
    }
    return end;
}

/* Reads the line of a mark; returns the text behind it. */
static const char *read_head(fuzz_part *part, const char *from, const char *end)
{
    from += sizeof mark - 1;
    const char *newline = memchr(from, '\n', (size_t)(end - from));
    size_t length = (size_t)((newline ? newline : end) - from);
    size_t kept = length < FUZZ_HEAD_MAX ? length : FUZZ_HEAD_MAX - 1;
    memcpy(part->head, from, kept);
    part->head[kept] = '\0';
    return newline ? newline + 1 : end;
}

size_t fuzz_split(fuzz_part parts[FUZZ_PARTS_MAX], const uint8_t *data, size_t size)
{
    const char *text = size > 0 ? (const char *)data : "";
    const char *end = text + size;
    size_t count = 0;
    parts[0] = (fuzz_part){.text = text};
    for (;;) {
        fuzz_part *part = &parts[count++];
        const char *next = count < FUZZ_PARTS_MAX ? find_mark(part->text, end) : end;
        part->size = (size_t)(next - part->text);
        if (next == end)
            return count;
        parts[count] = (fuzz_part){.text = ""};
        parts[count].text = read_head(&parts[count], next, end);
    }
}
