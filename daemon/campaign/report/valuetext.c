/* SPDX-License-Identifier: MIT
 *
 * valuetext.c - the value of a factor as people read it.
 */
#include "campaign/report/valuetext.h"

#include "base/text/jsonput.h"

#include <stdlib.h>
#include <string.h>

static const char *end_text(buffer *out)
{
    const char *text = buffer_text(out);
    if (!text)
        json_no_memory();
    return text;
}

/* Returns place i of a fault, or NULL. */
static const char *valuetext_place_of(const json_t *value, size_t i)
{
    const json_t *places = json_object_get(value, "places");
    if (places)
        return json_string_value(json_array_get(places, i));
    return i == 0 ? get_text(value, "place") : NULL;
}

bool value_is_space(const json_t *value)
{
    return json_is_string(json_object_get(value, "frame")) && valuetext_place_of(value, 0);
}

const char *value_frame(const json_t *value)
{
    return get_any_text(value, "frame");
}

/* Writes a place, or its field: "crc[3] stuff" is in the field "crc stuff". */
static void put_place(buffer *out, const char *place, bool field)
{
    const size_t length = strcspn(place, "[");
    const char *behind = strchr(place, ' ');
    if (!field) {
        buffer_put(out, place);
        return;
    }
    (void)buffer_append(out, place, length);
    if (behind && place[length] == '[')
        buffer_put(out, behind);
}

static void put_places(buffer *out, const json_t *value, bool field)
{
    const char *place;
    for (size_t i = 0; (place = valuetext_place_of(value, i)) != NULL; i++) {
        buffer_put(out, i > 0 ? " + " : "");
        put_place(out, place, field);
    }
}

const char *value_field(buffer *out, const json_t *value)
{
    buffer_clear(out);
    put_places(out, value, true);
    return end_text(out);
}

const char *value_text(buffer *out, const json_t *value)
{
    buffer_clear(out);
    if (json_is_string(value)) {
        buffer_put(out, json_string_value(value));
        return end_text(out);
    }
    if (value_is_space(value)) {
        buffer_put(out, value_frame(value));
        buffer_put(out, " ");
        put_places(out, value, false);
        return end_text(out);
    }
    char *text = json_dumps(value, JSON_COMPACT | JSON_ENCODE_ANY);
    buffer_put(out, text ? text : "null");
    free(text);
    return end_text(out);
}
