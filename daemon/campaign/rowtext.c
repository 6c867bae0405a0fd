/* SPDX-License-Identifier: MIT
 *
 * rowtext.c - builds a line of JSON with keys in a fixed order, faster than jansson does.
 */
#include "campaign/rowtext.h"

#include "base/chars.h"
#include "base/jsonput.h"
#include "base/number.h"

#include <stdlib.h>
#include <string.h>

static void put_bytes(rowtext *row, const char *bytes, size_t count)
{
    if (!buffer_append(&row->bytes, bytes, count))
        row->no_memory = true;
}

void rowtext_put(rowtext *row, const char *text)
{
    put_bytes(row, text, strlen(text));
}

/* Returns where so many bytes more have room, or NULL without memory. */
static char *find_room(rowtext *row, size_t count)
{
    if (buffer_reserve(&row->bytes, count))
        return row->bytes.data + row->bytes.end;
    row->no_memory = true;
    return NULL;
}

/* Takes the bytes up to `end` in. */
static void end_at(rowtext *row, const char *end)
{
    row->bytes.end = (size_t)(end - row->bytes.data);
}

/* Writes a text in quotes. Returns its end, or NULL when a character needs an escape. */
static char *write_simple(char *out, const char *text)
{
    *out++ = '"';
    for (; *text; text++) {
        if (*text < ' ' || *text > '~' || *text == '"' || *text == '\\')
            return NULL;
        *out++ = *text;
    }
    *out++ = '"';
    return out;
}

static void put_escaped(rowtext *row, const char *text)
{
    json_t *value = text_to_json(text, strlen(text));
    char *quoted = json_dumps(value, JSON_ENCODE_ANY);
    json_decref(value);
    if (quoted)
        rowtext_put(row, quoted);
    else
        row->no_memory = true;
    free(quoted);
}

void rowtext_quoted(rowtext *row, const char *text)
{
    char *out = find_room(row, strlen(text) + 2);
    const char *end = out ? write_simple(out, text) : NULL;
    if (end)
        end_at(row, end);
    else if (out)
        put_escaped(row, text);
}

static bool needs_comma(const rowtext *row)
{
    const buffer *b = &row->bytes;
    char last = '\0';
    if (buffer_length(b) > 0)
        last = b->data[b->end - 1];
    return last != '\0' && last != '{' && last != '[' && last != ':' && last != '\n';
}

void rowtext_key(rowtext *row, const char *key)
{
    if (needs_comma(row))
        rowtext_put(row, ",");
    rowtext_quoted(row, key);
    rowtext_put(row, ":");
}

void rowtext_number(rowtext *row, const char *key, uint64_t value)
{
    rowtext_key(row, key);
    char *out = find_room(row, CHARS_DECIMAL_MAX);
    if (out)
        end_at(row, chars_decimal(out, value));
}

void rowtext_string(rowtext *row, const char *key, const char *text)
{
    rowtext_key(row, key);
    rowtext_quoted(row, text);
}

void rowtext_seconds(rowtext *row, const char *key, uint64_t ticks)
{
    char text[TIME_TEXT_MAX];
    rowtext_key(row, key);
    (void)text_print_seconds(text, ticks);
    rowtext_put(row, text);
}

void rowtext_end(rowtext *row, rowtext *command)
{
    if (!buffer_append(&command->bytes, "", 1))
        command->no_memory = true;
    row->no_memory = row->no_memory || command->no_memory;
    rowtext_string(row, "repeat", command->no_memory ? "" : buffer_first(&command->bytes));
    rowtext_put(row, "}\n");
}

void rowtext_clear(rowtext *row)
{
    row->bytes.begin = 0;
    row->bytes.end = 0;
    row->no_memory = false;
}

void rowtext_free(rowtext *row)
{
    buffer_free(&row->bytes);
}
