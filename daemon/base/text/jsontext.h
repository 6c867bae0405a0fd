/* SPDX-License-Identifier: MIT
 *
 * jsontext.h - writes JSON with keys in a fixed order, faster than jansson does: to a buffer, or to
 * memory that has room.
 */
#ifndef CANWIRE_BASE_JSONTEXT_H
#define CANWIRE_BASE_JSONTEXT_H

#include "base/arena.h"
#include "base/text/buffer.h"
#include "base/text/chars.h"

#include <stdint.h>
#include <stdio.h>

/* Appends a text in quotes. */
void jsontext_quoted(buffer *out, const char *text);

/* Appends a comma where one is needed, and a text as it is: an item of a list, or its begin. */
void jsontext_item(buffer *out, const char *text);

/* Append a comma where one is needed, then "key": and the value. */
void jsontext_number(buffer *out, const char *key, uint64_t value);
void jsontext_string(buffer *out, const char *key, const char *text);
void jsontext_seconds(buffer *out, const char *key, uint64_t ticks);
void jsontext_value(buffer *out, const char *key, const char *text); /* ... as it is, or a part */
void jsontext_key(buffer *out, const char *key);                     /* ... without the value */

/* Returns what has been made, in memory of the arena, and frees it; NULL without memory. */
const char *jsontext_keep(buffer *text, arena *memory);

/* Writes what has been made on a line, and frees it. Without memory see json_no_memory(). */
void jsontext_out(buffer *text, FILE *out);

/* Write ,"key": and the value to memory that has room, as base/chars.h has it; they return the end.
 * Keys are constants, and words need no escape. */
#define AT_WORD(at, key, word) jsontext_end_word(chars_text(at, ",\"" key "\":\""), word)
#define AT_NUMBER(at, key, number) chars_decimal(chars_text(at, ",\"" key "\":"), number)
#define AT_SIGNED(at, key, number) jsontext_signed(chars_text(at, ",\"" key "\":"), number)

static inline char *jsontext_end_word(char *at, const char *word)
{
    at = chars_text(at, word);
    *at++ = '"';
    return at;
}

static inline char *jsontext_signed(char *at, int64_t number)
{
    if (number < 0)
        *at++ = '-';
    return chars_decimal(at, number < 0 ? -(uint64_t)number : (uint64_t)number);
}

#endif
