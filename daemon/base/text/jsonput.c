/* SPDX-License-Identifier: MIT
 *
 * jsonput.c - fills JSON objects and arrays, writes them, and reads their members.
 */
#include "base/text/jsonput.h"

#include <stdlib.h>
#include <string.h>

void put(json_t *object, const char *key, json_t *value)
{
    if (json_object_set_new(object, key, value) != 0)
        json_no_memory();
}

void put_last(json_t *array, json_t *value)
{
    if (json_array_append_new(array, value) != 0)
        json_no_memory();
}

void put_out(FILE *out, const json_t *value)
{
    (void)json_dumpf(value, out, JSON_INDENT(2) | JSON_PRESERVE_ORDER);
    fputc('\n', out);
}

void put_count(json_t *object, const char *key, uint64_t value)
{
    put(object, key, json_integer(value > INT64_MAX ? INT64_MAX : (json_int_t)value));
}

void put_ticks(json_t *object, const char *key, uint64_t ticks)
{
    uint64_t pairs = ticks / 2;

    put_count(object, key, pairs > INT64_MAX / 25 ? INT64_MAX : pairs * 25 + ticks % 2 * 25 / 2);
}

void put_bool(json_t *object, const char *key, bool value)
{
    put(object, key, json_boolean(value));
}

void put_text(json_t *object, const char *key, const char *text)
{
    put(object, key, text ? text_to_json(text, strlen(text)) : json_null());
}

void put_text_last(json_t *array, const char *text)
{
    put_last(array, text_to_json(text, strlen(text)));
}

bool json_has_text(const json_t *array, const char *text)
{
    bool found = false;
    for (size_t i = 0; i < json_array_size(array) && !found; i++)
        found = strcmp(json_string_value(json_array_get(array, i)), text) == 0;
    return found;
}

const char *get_text(const json_t *object, const char *key)
{
    return json_string_value(json_object_get(object, key));
}

const char *get_any_text(const json_t *object, const char *key)
{
    const char *text = get_text(object, key);
    return text ? text : "";
}

intmax_t get_number(const json_t *object, const char *key)
{
    return json_integer_value(json_object_get(object, key));
}

uint64_t get_count(const json_t *object, const char *key)
{
    const intmax_t number = get_number(object, key);
    return number > 0 ? (uint64_t)number : 0;
}

json_t *text_to_json(const char *text, size_t length)
{
    json_t *value = json_stringn(text, length);
    if (value)
        return value;
    char *ascii = malloc(length + 1);
    if (!ascii) {
        json_no_memory();
        return NULL;
    }
    memcpy(ascii, text, length);
    for (size_t i = 0; i < length; i++)
        if ((unsigned char)text[i] >= 0x80)
            ascii[i] = '?';
    value = json_stringn(ascii, length);
    free(ascii);
    return value;
}
