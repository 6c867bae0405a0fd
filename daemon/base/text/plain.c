/* SPDX-License-Identifier: MIT
 *
 * plain.c - makes foreign text safe to show: on one line, without control characters.
 */
#include "base/text/plain.h"

#include <stdarg.h>
#include <stdint.h>
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

size_t plain_character(uint32_t *code, const char *text)
{
    const unsigned char *bytes = (const unsigned char *)text;
    const size_t size = size_of(*bytes);
    *code = size == 1 ? *bytes : *bytes & (0x7Fu >> size);
    for (size_t i = 1; i < size; i++) {
        if ((bytes[i] & 0xC0) != 0x80) /* also at the end of the text */
            return 0;
        *code = *code << 6 | (bytes[i] & 0x3Fu);
    }
    return size;
}

static bool is_control(uint32_t code)
{
    return code < ' ' || (code >= 0x7F && code <= 0x9F);
}

/* Returns true for a character that changes or hides what is around it. */
static bool is_hidden(uint32_t code)
{
    static const struct { uint32_t first, last; } hidden[] = {
        {0xAD, 0xAD}, {0x61C, 0x61C}, {0x180E, 0x180E}, {0x200B, 0x200F}, {0x2028, 0x202E},
        {0x2060, 0x206F}, {0xFEFF, 0xFEFF}, {0xFFF9, 0xFFFB}, {0xE0000, 0xE007F},
    };
    for (size_t i = 0; i < sizeof hidden / sizeof hidden[0]; i++)
        if (code >= hidden[i].first && code <= hidden[i].last)
            return true;
    return false;
}

size_t plain_size(const char *text)
{
    uint32_t code;
    const size_t size = plain_character(&code, text);
    return is_control(code) || is_hidden(code) ? 0 : size;
}

/* Replaces each byte of what must not be shown, so that the text keeps its length. */
static void base_plain_make(char *text, char instead, const char *kept)
{
    while (*text) {
        const size_t size = plain_size(text);
        if (size == 0 && !strchr(kept, *text))
            *text = instead;
        text += size == 0 ? 1 : size;
    }
}

void plain_make(char *text, char instead)
{
    base_plain_make(text, instead, "");
}

void plain_make_lines(char *text, char instead)
{
    base_plain_make(text, instead, "\t\n");
}

bool plain_is_not(const char *text)
{
    while (*text) {
        uint32_t code;
        const size_t size = plain_character(&code, text);
        if (size == 0 || (is_control(code) && !strchr("\t\n\r", *text)))
            return true;
        text += size;
    }
    return false;
}

void plain_print(FILE *out, const char *format, ...)
{
    char text[TEXT_BYTES];
    va_list args;
    va_start(args, format);
    (void)vsnprintf(text, sizeof text, format, args);
    va_end(args);
    plain_make_lines(text, '?');
    fputs(text, out);
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
