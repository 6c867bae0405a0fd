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

/* Returns true for a text of which no character needs an escape. */
static bool is_simple(const char *text)
{
    for (; *text; text++)
        if (*text < ' ' || *text > '~' || *text == '"' || *text == '\\')
            return false;
    return true;
}

void rowtext_quoted(rowtext *row, const char *text)
{
    if (is_simple(text)) {
        rowtext_put(row, "\"");
        rowtext_put(row, text);
        rowtext_put(row, "\"");
        return;
    }
    json_t *value = text_to_json(text, strlen(text));
    char *quoted = json_dumps(value, JSON_ENCODE_ANY);
    json_decref(value);
    if (quoted)
        rowtext_put(row, quoted);
    else
        row->no_memory = true;
    free(quoted);
}

static void put_comma(rowtext *row)
{
    const size_t length = buffer_length(&row->bytes);
    char last = '\0';
    if (length > 0)
        last = buffer_first(&row->bytes)[length - 1];
    if (last != '\0' && last != '{' && last != '[' && last != ':' && last != '\n')
        rowtext_put(row, ",");
}

void rowtext_key(rowtext *row, const char *key)
{
    put_comma(row);
    rowtext_quoted(row, key);
    rowtext_put(row, ":");
}

void rowtext_number(rowtext *row, const char *key, uint64_t value)
{
    char digits[CHARS_DECIMAL_MAX];
    rowtext_key(row, key);
    put_bytes(row, digits, (size_t)(chars_decimal(digits, value) - digits));
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
    (void)buffer_append(&command->bytes, "", 1);
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
