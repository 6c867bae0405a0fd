/* SPDX-License-Identifier: MIT
 *
 * plain.c - makes foreign text safe to show: on one line, without control characters.
 */
#include "base/plain.h"

#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#define TEXT_BYTES 16384 /* of a message; a longer one is cut */

/* Returns the length in bytes of a character with this first byte; 0: no character begins so. */
static size_t size_of(unsigned char first)
{
    if (first < 0x80)
        return 1;
    if (first >= 0xC2 && first <= 0xDF)
        return 2;
    if (first >= 0xE0 && first <= 0xEF)
        return 3;
    return first >= 0xF0 && first <= 0xF4 ? 4 : 0;
}

/* Returns the size in bytes of the character that begins here. Returns 0 for an invalid one and for
 * a control character. */
static size_t shown_size(const unsigned char *text)
{
    size_t size = size_of(*text);
    if (*text < ' ' || *text == 0x7F || (*text == 0xC2 && text[1] >= 0x80 && text[1] <= 0x9F))
        return 0;
    for (size_t i = 1; i < size; i++)
        if ((text[i] & 0xC0) != 0x80) /* also at the end of the text */
            return 0;
    return size;
}

void plain_make(char *text, char instead)
{
    while (*text) {
        size_t size = shown_size((const unsigned char *)text);
        if (size == 0)
            *text = instead;
        text += size == 0 ? 1 : size;
    }
}

bool plain_is_not(const char *text)
{
    while (*text) {
        size_t size = shown_size((const unsigned char *)text);
        if (size == 0 && !strchr("\t\n\r", *text))
            return true;
        text += size == 0 ? 1 : size;
    }
    return false;
}

static void plain_write(FILE *out, char *text)
{
    for (char *piece = text; *piece;) {
        size_t length = strcspn(piece, "\t\n");
        const char end = piece[length];
        piece[length] = '\0';
        plain_make(piece, '?');
        fputs(piece, out);
        if (!end)
            return;
        fputc(end, out);
        piece += length + 1;
    }
}

void plain_print(FILE *out, const char *format, ...)
{
    char text[TEXT_BYTES];
    va_list args;
    va_start(args, format);
    (void)vsnprintf(text, sizeof text, format, args);
    va_end(args);
    plain_write(out, text);
}

void plain_options(int argc, char **argv)
{
    for (int i = 1; i < argc && strcmp(argv[i], "--") != 0; i++) {
        char *value = strchr(argv[i], '=');
        if (strncmp(argv[i], "--", 2) != 0)
            continue;
        if (value)
            *value = '\0';
        plain_make(argv[i], '?');
        if (value)
            *value = '=';
    }
}
