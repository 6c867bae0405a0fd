/* SPDX-License-Identifier: MIT
 *
 * row.c - reads a row of `canwire campaign run` or of `canwire sim --seeds`.
 */
#include "campaign/report/row.h"

#include "base/text/jsonput.h"
#include "base/text/number.h"
#include "campaign/report/memory.h"
#include "campaign/report/rowcheck.h"

#include <string.h>

#define NO_ROW "it is no row of canwire campaign run or canwire sim --seeds"
#define LARGE_DIGITS 19u /* of 2^63 */

/* ---- Values ---------------------------------------------------------------------------------- */

/* Reads seconds with 9 decimals. */
static uint64_t ns_of(const json_t *value)
{
    const double ns = json_number_value(value) * 1e9 + 0.5;
    return ns > 0 && ns < 0x1p63 ? (uint64_t)ns : 0;
}

static bool find_outcome(outcome *out, const char *name)
{
    for (unsigned i = 0; i < OUTCOME_COUNT && name; i++) {
        *out = (outcome)i;
        if (strcmp(outcome_name(*out), name) == 0)
            return true;
    }
    return false;
}

/* Appends a run of digits, in quotes when it is too large for an integer of jansson. Returns its
 * length. */
static size_t put_digits(buffer *out, const char *at, size_t left)
{
    size_t length = 0;
    while (length < left && at[length] >= '0' && at[length] <= '9')
        length++;
    if (length >= LARGE_DIGITS)
        buffer_put(out, "\"");
    (void)buffer_append(out, at, length);
    if (length >= LARGE_DIGITS)
        buffer_put(out, "\"");
    return length;
}

/* Puts large numbers of a line in quotes. */
static void quote_large(buffer *out, const char *line, size_t length)
{
    bool in_string = false;
    for (size_t i = 0; i < length;) {
        const size_t digits = in_string ? 0 : put_digits(out, line + i, length - i);
        i += digits;
        if (digits > 0)
            continue;
        const size_t count = in_string && line[i] == '\\' && i + 1 < length ? 2 : 1;
        in_string ^= line[i] == '"';
        (void)buffer_append(out, line + i, count);
        i += count;
    }
}

/* JSON integers are signed in jansson, and seeds are not: a large one becomes a text. */
static json_t *row_load(const char *line, size_t length, json_error_t *error)
{
    json_t *object = json_loadb(line, length, JSON_REJECT_DUPLICATES, error);
    if (object || json_error_code(error) != json_error_numeric_overflow)
        return object;
    buffer quoted = {.data = NULL};
    quote_large(&quoted, line, length);
    const char *text = memory_seen(&quoted);
    object = json_loadb(text, buffer_length(&quoted), JSON_REJECT_DUPLICATES, error);
    buffer_free(&quoted);
    return object;
}

json_t *report_row_load(const char *line, size_t length)
{
    json_error_t error;
    return row_load(line, length, &error);
}

static bool read_seed(uint64_t *out, const json_t *value)
{
    if (json_is_string(value))
        return !text_parse_uint(out, json_string_value(value));
    *out = (uint64_t)json_integer_value(value);
    return json_is_integer(value) && json_integer_value(value) >= 0;
}

/* ---- Facts ----------------------------------------------------------------------------------- */

bool row_signs_has(const row_signs *signs, const char *name)
{
    for (size_t i = 0; i < signs->count; i++)
        if (strcmp(signs->names[i], name) == 0)
            return true;
    return false;
}

const char *report_row_failed(const report_row *row, size_t i)
{
    const char *name = get_text(json_array_get(row->failed, i), "name");
    return name ? name : "";
}

static bool has_failed(const report_row *row, const char *name)
{
    for (size_t i = 0; i < json_array_size(row->failed); i++)
        if (strcmp(report_row_failed(row, i), name) == 0)
            return true;
    return false;
}

static void judge_expectations(report_row *row, const row_signs *signs)
{
    for (size_t i = 0; i < json_array_size(row->failed); i++)
        row->facts.failed = row->facts.failed ||
                            !row_signs_has(signs, report_row_failed(row, i));
    for (size_t i = 0; i < signs->count; i++)
        row->facts.announced = row->facts.announced || !has_failed(row, signs->names[i]);
}

static void judge_node(class_facts *f, const json_t *node)
{
    const char *state = get_text(node, "state");
    const bool dropped = get_count(node, "dropped") > 0 || get_count(node, "rx_dropped") > 0;
    const bool active = state && strcmp(state, "error-active") == 0;
    f->degraded |= (dropped ? DEGRADED_DROPPED : 0u) | (active ? 0u : DEGRADED_STATE) |
                   (get_count(node, "error_passive") > 0 ? DEGRADED_PASSIVE : 0u) |
                   (get_count(node, "bus_off") > 0 ? DEGRADED_BUS_OFF : 0u);
}

/* Reads what only a scenario with a result has. Returns what is wrong, or NULL. */
static const char *read_result(report_row *row, const row_signs *signs)
{
    const json_t *nodes = json_object_get(row->object, "nodes");
    const json_t *latency = json_object_get(row->object, "latency");
    const json_t *error = json_object_get(row->object, "first_error");
    class_facts *f = &row->facts;
    row->failed = json_object_get(json_object_get(row->object, "expectations"), "failed");
    if (!json_is_array(row->failed) || !json_is_object(nodes) || !latency || !error ||
        !json_object_get(row->object, "faults"))
        return NO_ROW ": keys are missing";
    const char *wrong = rowcheck_result(row->object, row->facts.outcome);
    if (wrong)
        return wrong;
    row->first_error = json_is_object(error) ? error : NULL;
    row->lost = json_object_get(row->object, "lost");
    row->has_latency = json_is_number(latency);
    row->latency_ns = ns_of(latency);
    row->end_ns = ns_of(json_object_get(row->object, "t"));
    f->hit = get_count(row->object, "faults") > 0;
    f->error = row->first_error != NULL || get_count(row->object, "error_frames") > 0;
    f->error_after_hit = row->has_latency;
    f->degraded = get_count(row->object, "undetected_errors") > 0 ? DEGRADED_UNDETECTED : 0u;
    void *place;
    for (place = json_object_iter((json_t *)nodes); place;
         place = json_object_iter_next((json_t *)nodes, place))
        judge_node(f, json_object_iter_value(place));
    judge_expectations(row, signs);
    return NULL;
}

/* ---- Rows ------------------------------------------------------------------------------------ */

static const char *read_keys(report_row *row, const row_signs *signs)
{
    const json_t *number = json_object_get(row->object, "number");
    row->factors = json_object_get(row->object, "factors");
    row->repeat = get_text(row->object, "repeat");
    row->has_number = json_is_integer(number) && json_integer_value(number) >= 0;
    row->number = get_count(row->object, "number");
    if (!json_is_object(row->object) || !row->repeat ||
        !read_seed(&row->seed, json_object_get(row->object, "seed")) || !number != !row->factors ||
        (number && (!row->has_number || !json_is_object(row->factors))))
        return NO_ROW;
    if (!find_outcome(&row->facts.outcome, get_text(row->object, "outcome")))
        return NO_ROW ": it has no outcome that is known";
    if (row->facts.outcome != OUTCOME_PASSED && row->facts.outcome != OUTCOME_FAILED)
        return NULL;
    return read_result(row, signs);
}

static const char *why_no_object(const json_error_t *error)
{
    return json_error_code(error) == json_error_duplicate_key ? NO_ROW ": a key is there twice"
                                                              : NO_ROW ": it is no JSON";
}

const char *report_row_read(report_row *out, const char *line, size_t length,
                            const row_signs *signs)
{
    json_error_t error;
    *out = (report_row){.object = row_load(line, length, &error)};
    const char *wrong = out->object ? read_keys(out, signs) : why_no_object(&error);
    if (wrong) {
        report_row_free(out);
        return wrong;
    }
    out->class = class_of(&out->facts);
    return NULL;
}

void report_row_free(report_row *row)
{
    json_decref(row->object);
    *row = (report_row){.object = NULL};
}
