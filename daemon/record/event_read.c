/* SPDX-License-Identifier: MIT
 *
 * event_read.c - events of a bus from the lines of JSON that output_event() wrote.
 */
#include "record/event_read.h"

#include "base/text/jsonput.h"
#include "trace/frametext.h"

#include <string.h>

static unsigned event_read_number_of(const json_t *line, const char *key)
{
    json_int_t value = get_number(line, key);
    return value > 0 && value <= UINT16_MAX ? (unsigned)value : 0;
}

/* ---- Words ----------------------------------------------------------------------------------- */

/* Returns false for a word that this version does not know: the bus may be a newer one. */
static bool event_read_find_kind(cw_event_kind *kind, const char *word)
{
    for (unsigned i = 0; i < CW_EVENT_COUNT; i++)
        if (strcmp(cw_event_name((cw_event_kind)i), word) == 0) {
            *kind = (cw_event_kind)i;
            return true;
        }
    return false;
}

static bool find_state(uint8_t *state, const char *word)
{
    for (unsigned i = 0; i < CW_STATE_COUNT; i++)
        if (strcmp(cw_state_name((cw_state)i), word) == 0) {
            *state = (uint8_t)i;
            return true;
        }
    return false;
}

static bool find_drop(uint8_t *why, const char *word)
{
    for (unsigned i = 0; i < CW_DROP_COUNT; i++)
        if (strcmp(cw_drop_name((cw_drop)i), word) == 0) {
            *why = (uint8_t)i;
            return true;
        }
    return false;
}

static bool find_wake(uint8_t *by, const char *word)
{
    for (unsigned i = 0; i < CW_WAKE_COUNT; i++)
        if (strcmp(cw_wake_name((cw_wake)i), word) == 0) {
            *by = (uint8_t)i;
            return true;
        }
    return false;
}

static bool find_type(cw_error_type *type, const char *word)
{
    for (unsigned i = 0; i < CW_ERROR_COUNT; i++)
        if (strcmp(cw_error_type_name((cw_error_type)i), word) == 0) {
            *type = (cw_error_type)i;
            return true;
        }
    return false;
}

static bool find_field(cw_field *field, const char *word)
{
    for (unsigned i = 0; i < CW_FIELD_COUNT; i++)
        if (strcmp(cw_field_name((cw_field)i), word) == 0) {
            *field = (cw_field)i;
            return true;
        }
    return false;
}

/* ---- Lines ----------------------------------------------------------------------------------- */

/* Reads the details of an error. Returns false when type or field is not known. */
static bool read_error(cw_error *error, const json_t *line)
{
    bool sends = strcmp(get_any_text(line, "role"), "tx") == 0;
    error->role = sends ? CW_ROLE_TRANSMITTER : CW_ROLE_RECEIVER;
    error->place.index = (uint16_t)event_read_number_of(line, "index");
    error->place.stuff = json_is_true(json_object_get(line, "stuff"));
    return find_type(&error->type, get_any_text(line, "type")) &&
           find_field(&error->place.field, get_any_text(line, "field"));
}

/* Reads the details of an event beyond time, node and kind; returns false when they are not
 * understood. */
static bool read_details(cw_event *out, const json_t *line)
{
    const char *frame = get_any_text(line, "frame");
    if (*frame && text_parse_frame(&out->frame, frame) != NULL)
        return false;
    out->tec = (uint16_t)event_read_number_of(line, "tec");
    out->rec = (uint16_t)event_read_number_of(line, "rec");
    out->lost_bit = (uint8_t)event_read_number_of(line, "bit");
    if (out->kind == CW_EVENT_ERROR) {
        out->fast = strcmp(get_any_text(line, "rate"), "data") == 0;
        return read_error(&out->error, line);
    }
    if (strcmp(get_any_text(line, "was"), cw_state_name(CW_STATE_SLEEPING)) == 0)
        out->state_before = CW_STATE_SLEEPING;
    if (out->kind == CW_EVENT_STATE)
        return find_state(&out->state, get_any_text(line, "state"));
    if (out->kind == CW_EVENT_WAKE)
        return find_wake(&out->why, get_any_text(line, "by"));
    if (out->kind == CW_EVENT_DROP)
        return find_drop(&out->why, get_any_text(line, "why"));
    if (out->kind == CW_EVENT_CAPTURE) {
        const json_int_t local = get_number(line, "local-time");
        out->local_time = local > 0 ? (uint64_t)local : 0;
    }
    if (out->kind == CW_EVENT_SKIP) {
        json_int_t ns = get_number(line, "skipped_ns");
        out->ticks = ns > 0 ? (uint64_t)ns / 25 * 2 : 0;
    }
    return true;
}

/* Sets the node of an event. An event of the bus has none. Returns false for a node that is not
 * known. */
static bool event_read_find_node(uint64_t *nodes, const json_t *line, const cfg *config)
{
    const char *name = get_text(line, "node");
    uint8_t node = name ? cfg_find_node(config, name) : CW_NO_NODE;
    if (node != CW_NO_NODE)
        *nodes = UINT64_C(1) << node;
    return node != CW_NO_NODE || !name;
}

event_read_result event_read(cw_event *out, uint64_t *time_ns, const json_t *line,
                             const cfg *config)
{
    double seconds = json_number_value(json_object_get(line, "t"));
    *out = (cw_event){.kind = CW_EVENT_COUNT};
    if (!(seconds >= 0 && seconds < 1e9) ||
        !event_read_find_kind(&out->kind, get_any_text(line, "event")) ||
        !read_details(out, line))
        return EVENT_OTHER;
    *time_ns = (uint64_t)(seconds * 1e9 + 0.5); /* exact for the first hundred days */
    out->tick = *time_ns / 25 * 2;
    return event_read_find_node(&out->nodes, line, config) ? EVENT_READ : EVENT_NO_SUCH_NODE;
}
