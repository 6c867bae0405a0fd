/* SPDX-License-Identifier: MIT
 *
 * space.c - positions in frames: those of a pattern, and all faults of a space.
 */
#include "campaign/space/space.h"

#include "base/text/jsontext.h"
#include "trace/frametext.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define POSITION_MAX 48 /* bytes of a position with its final 0 */
#define PATTERN "a position, or several such as \"crc[0..14]\", \"data[0..7].*\" or \"crc.*\""

/* ---- Lists ----------------------------------------------------------------------------------- */

void space_add(space_list *list, const char *text)
{
    list->too_many = list->too_many || list->count == CAMPAIGN_VALUES_MAX;
    if (list->too_many)
        return;
    if (list->count == list->room) {
        const uint64_t room = list->room > 0 ? 2 * list->room : 64;
        const char **texts = arena_alloc(list->memory, (size_t)room * sizeof *texts);
        if (texts && list->count > 0)
            memcpy(texts, list->texts, (size_t)list->count * sizeof *texts);
        list->texts = texts;
        list->room = texts ? room : 0;
        list->count = texts ? list->count : 0;
    }
    list->no_memory = list->no_memory || !list->texts || !text;
    if (!list->no_memory)
        list->texts[list->count++] = text;
}

/* ---- Positions ------------------------------------------------------------------------------- */

/* Returns true if the bits of the frame on the wire have this place: it depends on format and
 * length. */
static bool has_position(const cw_frame *frame, cw_field field, unsigned index)
{
    cw_bits bits;
    if (cw_bits_encode(&bits, frame) != CW_OK)
        return false;
    for (unsigned n = 0; n < bits.length; n++)
        if (cw_bits_is_at(&bits, n, field, index))
            return true;
    return false;
}

static bool is_behind_eof(cw_field field)
{
    return field == CW_FIELD_INTERMISSION || field == CW_FIELD_SUSPEND ||
           field == CW_FIELD_ERROR_FLAG || field == CW_FIELD_ERROR_DELIMITER ||
           field == CW_FIELD_OVERLOAD_FLAG || field == CW_FIELD_OVERLOAD_DELIMITER;
}

/* Adds a position, unless the frame lacks it. Returns what is wrong with it, or NULL. */
static const char *add_position(space_list *list, const char *position, const cw_frame *frame)
{
    cw_field field;
    uint16_t index;
    const char *wrong = text_parse_position(&field, &index, position, true);
    if (wrong)
        return wrong;
    if (frame && !is_behind_eof(field) && !has_position(frame, field, index))
        list->pruned++;
    else
        space_add(list, arena_print(list->memory, "\"%s\"", position));
    return NULL;
}

/* A pattern: NAME[first..last], with all bits of bytes where there is a .* behind it. */
typedef struct pattern {
    char name[POSITION_MAX];
    unsigned first;
    unsigned last;
    bool bytes;
} pattern;

/* Adds the positions of a pattern, in order. A byte has eight, one for each bit. */
static const char *add_pattern(space_list *list, const pattern *p, const cw_frame *frame)
{
    const char *wrong = NULL;
    for (unsigned i = p->first; i <= p->last && !wrong; i++) {
        for (unsigned bit = 0; bit < (p->bytes ? 8u : 1u) && !wrong; bit++) {
            char position[2 * POSITION_MAX];
            if (p->bytes)
                (void)snprintf(position, sizeof position, "%s[%u.%u]", p->name, i, bit);
            else
                (void)snprintf(position, sizeof position, "%s[%u]", p->name, i);
            wrong = add_position(list, position, frame);
        }
    }
    return wrong;
}

/* Adds all bits of a field, by its name. */
static const char *add_field(space_list *list, const char *name, const cw_frame *frame)
{
    const bool fd = frame && (frame->flags & CW_FRAME_FD);
    for (unsigned field = 0; field < CW_FIELD_COUNT; field++) {
        const unsigned bits = cw_field_bits((cw_field)field, fd);
        if (strcmp(cw_field_name((cw_field)field), name) != 0 || bits == 0)
            continue;
        pattern p = {.last = bits - 1, .bytes = field == CW_FIELD_DATA};
        p.last = p.bytes ? bits / 8 - 1 : p.last;
        (void)snprintf(p.name, sizeof p.name, "%s", name);
        return bits == 1 ? add_position(list, name, frame) : add_pattern(list, &p, frame);
    }
    return "expected " PATTERN;
}

const char *space_add_positions(space_list *list, const char *text, const cw_frame *frame)
{
    pattern p = {.first = 0};
    char behind[3] = "";
    const size_t length = strlen(text);
    if (length >= POSITION_MAX)
        return "expected " PATTERN;
    const int found = sscanf(text, "%40[a-z-][%3u..%3u]%2s", p.name, &p.first, &p.last, behind);
    p.bytes = strcmp(behind, ".*") == 0;
    if (found >= 3 && (found == 3 || p.bytes) && text[length - 1] == (found == 3 ? ']' : '*'))
        return p.first <= p.last ? add_pattern(list, &p, frame) : "expected " PATTERN;
    if (length > 2 && strcmp(text + length - 2, ".*") == 0 && !strchr(text, '[')) {
        memcpy(p.name, text, length - 2);
        p.name[length - 2] = '\0';
        return add_field(list, p.name, frame);
    }
    return add_position(list, text, frame);
}

/* ---- Spaces ---------------------------------------------------------------------------------- */

#define TEXT_MAX 96 /* bytes of a short text with its final 0: the name of a rule with a suffix */

/* Puts the identifier of a frame. */
static void put_frame(buffer *out, const cw_frame *frame)
{
    char text[TEXT_MAX];
    (void)snprintf(text, sizeof text, "%0*X", frame->flags & CW_FRAME_EXTENDED ? 8 : 3, frame->id);
    jsontext_string(out, "frame", text);
}

/* Returns the rule that inverts a wire bit once. */
static const char *rule_text(arena *memory, const space *s, const char *suffix,
                             const cw_frame *frame, unsigned bit)
{
    buffer out = {.data = NULL};
    char text[TEXT_MAX];
    (void)snprintf(text, sizeof text, "%s%s", s->name, suffix);
    jsontext_item(&out, "{");
    jsontext_string(&out, "name", text);
    jsontext_value(&out, "when", "{");
    put_frame(&out, frame);
    if (s->from)
        jsontext_value(&out, "from", s->from);
    jsontext_number(&out, "skip", s->skip);
    jsontext_value(&out, "count", "1}");
    (void)snprintf(text, sizeof text, "bit[%u]", bit);
    jsontext_value(&out, "do", "{");
    jsontext_string(&out, "flip", text);
    if (s->at)
        jsontext_value(&out, "at", s->at);
    buffer_put(&out, "}}");
    return jsontext_keep(&out, memory);
}

/* Puts the place of a wire bit: bit[37] is crc[3]. */
static void put_place(buffer *out, const char *key, const cw_bits *bits, unsigned n)
{
    char text[POSITION_MAX];
    const cw_place place = cw_bits_place(bits, n);
    const char *name = cw_field_name(place.field);
    const char *stuff = place.stuff ? " stuff" : "";
    if (cw_field_bits(place.field, true) == 1)
        (void)snprintf(text, sizeof text, "%s%s", name, stuff);
    else if (place.field == CW_FIELD_DATA)
        (void)snprintf(text, sizeof text, "%s[%u.%u]%s", name, place.index / 8u, place.index % 8u,
                       stuff);
    else
        (void)snprintf(text, sizeof text, "%s[%u]%s", name, place.index, stuff);
    if (key)
        jsontext_key(out, key);
    else
        jsontext_item(out, "");
    jsontext_quoted(out, text);
}

void space_add_bits(space_list *values, space_list *rules, const space *s, const cw_frame *frame)
{
    cw_bits bits;
    if (cw_bits_encode(&bits, frame) != CW_OK)
        return;
    for (unsigned n = 0; n < bits.length; n++) {
        buffer value = {.data = NULL};
        jsontext_item(&value, "{");
        put_frame(&value, frame);
        jsontext_number(&value, "bit", n);
        put_place(&value, "place", &bits, n);
        buffer_put(&value, "}");
        space_add(values, jsontext_keep(&value, values->memory));
        space_add(rules, rule_text(rules->memory, s, "", frame, n));
    }
}

/* Adds a pair of bits: a value for rows, and two rules as lines of one text. */
static void add_pair(space_list *values, space_list *rules, const space *s, const cw_frame *frame,
                     const cw_bits *bits, const unsigned pair[2])
{
    buffer value = {.data = NULL};
    jsontext_item(&value, "{");
    put_frame(&value, frame);
    jsontext_value(&value, "bits", "[");
    buffer_print(&value, "%u,%u]", pair[0], pair[1]);
    jsontext_value(&value, "places", "[");
    put_place(&value, NULL, bits, pair[0]);
    put_place(&value, NULL, bits, pair[1]);
    buffer_put(&value, "]}");
    space_add(values, jsontext_keep(&value, values->memory));
    const char *first = rule_text(rules->memory, s, ".1", frame, pair[0]);
    const char *second = rule_text(rules->memory, s, ".2", frame, pair[1]);
    space_add(rules, first && second ? arena_print(rules->memory, "%s\n%s", first, second) : NULL);
}

const char *space_add_pairs(space_list *values, space_list *rules, const space *s,
                            const cw_frame *frame, const char *field)
{
    unsigned chosen[CW_BITS_MAX];
    unsigned count = 0;
    cw_bits bits;
    if (cw_bits_encode(&bits, frame) != CW_OK)
        return "no such frame exists";
    for (unsigned n = 0; n < bits.length; n++) {
        const cw_place place = cw_bits_place(&bits, n);
        if (!field || (!place.stuff && strcmp(cw_field_name(place.field), field) == 0))
            chosen[count++] = n;
    }
    if (values->count + (uint64_t)count * count / 2 > CAMPAIGN_VALUES_MAX)
        values->too_many = true;
    for (unsigned i = 0; i < count && !values->too_many; i++)
        for (unsigned k = i + 1; k < count; k++)
            add_pair(values, rules, s, frame, &bits, (unsigned[]){chosen[i], chosen[k]});
    return count < 2 ? "the frame has no two bits there" : NULL;
}
