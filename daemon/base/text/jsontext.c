/* SPDX-License-Identifier: MIT
 *
 * jsontext.c - writes JSON with keys in a fixed order, faster than jansson does.
 */
#include "base/text/jsontext.h"

#include "base/text/chars.h"
#include "base/text/jsonput.h"
#include "base/text/number.h"

#include <stdlib.h>

/* Writes a text in quotes. Returns its end, or NULL when a character needs an escape. */
static char *write_simple(char *out, const char *text)
{
    *out++ = '"';
    while (chars_plain[(unsigned char)*text])
        *out++ = *text++;
    *out++ = '"';
    return *text ? NULL : out;
}

/* jansson makes the escapes; texts that need any are rare. */
static void put_escaped(buffer *out, const char *text)
{
    json_t *value = text_to_json(text, strlen(text));
    char *quoted = json_dumps(value, JSON_ENCODE_ANY);
    json_decref(value);
    if (quoted)
        buffer_put(out, quoted);
    else
        out->no_memory = true;
    free(quoted);
}

void jsontext_quoted(buffer *out, const char *text)
{
    if (!buffer_reserve(out, strlen(text) + 2))
        return;
    const char *end = write_simple(out->data + out->end, text);
    if (end)
        out->end = (size_t)(end - out->data);
    else
        put_escaped(out, text);
}

/* Puts a comma where one is needed. There must be room. */
static void put_comma(buffer *out)
{
    char last = '{';
    if (buffer_length(out) > 0)
        last = out->data[out->end - 1];
    if (last != '{' && last != '[' && last != ':' && last != '\n')
        out->data[out->end++] = ',';
}

void jsontext_item(buffer *out, const char *text)
{
    if (!buffer_reserve(out, 1))
        return;
    put_comma(out);
    buffer_put(out, text);
}

void jsontext_key(buffer *out, const char *key)
{
    if (!buffer_reserve(out, strlen(key) + strlen(",\"\":")))
        return;
    put_comma(out);
    jsontext_quoted(out, key);
    (void)buffer_append(out, ":", 1);
}

void jsontext_value(buffer *out, const char *key, const char *text)
{
    jsontext_key(out, key);
    buffer_put(out, text);
}

void jsontext_number(buffer *out, const char *key, uint64_t value)
{
    jsontext_key(out, key);
    if (buffer_reserve(out, CHARS_DECIMAL_MAX))
        out->end = (size_t)(chars_decimal(out->data + out->end, value) - out->data);
}

void jsontext_string(buffer *out, const char *key, const char *text)
{
    jsontext_key(out, key);
    jsontext_quoted(out, text);
}

void jsontext_seconds(buffer *out, const char *key, uint64_t ticks)
{
    char text[TIME_TEXT_MAX];
    (void)text_print_seconds(text, ticks);
    jsontext_value(out, key, text);
}

const char *jsontext_keep(buffer *text, arena *memory)
{
    const char *made = buffer_text(text);
    const char *kept = made ? arena_print(memory, "%s", made) : NULL;
    buffer_free(text);
    return kept;
}

void jsontext_out(buffer *text, FILE *out)
{
    buffer_put(text, "\n");
    if (text->no_memory)
        json_no_memory();
    else
        (void)fwrite(buffer_first(text), 1, buffer_length(text), out);
    buffer_free(text);
}
