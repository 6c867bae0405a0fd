/* SPDX-License-Identifier: MIT
 *
 * valuetext.c - the value of a factor as people read it.
 */
#include "campaign/report/valuetext.h"

#include "base/text/jsonput.h"

#include <stdlib.h>
#include <string.h>

/* Returns the text. The program ends if there is no memory, as for all of a report. */
static const char *end_text(buffer *out)
{
    const char *text = buffer_text(out);
    if (!text)
        json_no_memory();
    return text;
}

/* Returns place i of a fault, or NULL. */
static const char *valuetext_place_of(const jsonread_value *value, size_t i)
{
    const jsonread_value *places = jsonread_get(value, "places");
    const jsonread_value *place = jsonread_first(places);
    if (!places)
        return i == 0 ? jsonread_string(jsonread_get(value, "place")) : NULL;
    for (; place && i > 0; i--)
        place = jsonread_next(places, place);
    return jsonread_string(place);
}

bool value_is_space(const jsonread_value *value)
{
    return jsonread_string(jsonread_get(value, "frame")) && valuetext_place_of(value, 0);
}

const char *value_frame(const jsonread_value *value)
{
    const char *frame = jsonread_string(jsonread_get(value, "frame"));
    return frame ? frame : "";
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

/* Writes the places of a fault, or only their fields. */
static void put_places(buffer *out, const jsonread_value *value, bool field)
{
    const char *place;
    for (size_t i = 0; (place = valuetext_place_of(value, i)) != NULL; i++) {
        buffer_put(out, i > 0 ? " + " : "");
        put_place(out, place, field);
    }
}

const char *value_field(buffer *out, const jsonread_value *value)
{
    buffer_clear(out);
    put_places(out, value, true);
    return end_text(out);
}

/* Writes a value as jansson does: numbers with a point have all digits that tell them apart. */
static void put_json(buffer *out, const jsonread_value *value)
{
    json_t *json = json_loadb(value->text, value->length, JSON_DECODE_ANY, NULL);
    char *text = json_dumps(json, JSON_COMPACT | JSON_ENCODE_ANY);
    buffer_put(out, text ? text : "null");
    free(text);
    json_decref(json);
}

const char *value_text(buffer *out, const jsonread_value *value)
{
    buffer_clear(out);
    if (!value) {
        buffer_put(out, "null");
    } else if (value_is_space(value)) {
        buffer_put(out, value_frame(value));
        buffer_put(out, " ");
        put_places(out, value, false);
    } else if (value->kind == JSONREAD_REAL || value->kind >= JSONREAD_LIST) {
        put_json(out, value);
    } else {
        (void)buffer_append(out, value->text, value->length);
    }
    return end_text(out);
}
