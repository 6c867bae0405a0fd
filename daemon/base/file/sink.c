/* SPDX-License-Identifier: MIT
 *
 * sink.c - what takes a bus's events away from it, as JSON and as text.
 */
#include "base/file/sink.h"

#include "base/text/chars.h"
#include "base/text/jsonput.h"

#include <assert.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#define ONE_BYTES 400u
#define REST_BYTES 32u /* of ", 12 more" */

static const char *const kind_names[SINK_KINDS] = {
    [SINK_LCM] = "lcm", [SINK_RECORD] = "record", [SINK_JOURNAL] = "journal",
    [SINK_EXPECT] = "expect-report"};

void sinks_add(sink_list *all, const sink_info *one)
{
    assert(all->count < SINKS_MAX);
    all->all[all->count++] = *one;
}

const char *sink_kind_name(sink_kind kind)
{
    return kind_names[kind];
}

/* Only recordings have `bytes`, and only journals have `gaps`. */
static json_t *sink_json(const sink_info *s)
{
    json_t *object = json_object();
    put_text(object, "kind", kind_names[s->kind]);
    put(object, "name", text_to_json(s->name, strlen(s->name)));
    put_text(object, "state", s->state);
    put_bool(object, "good", s->good);
    put_text(object, "why", s->why);
    put_count(object, "written", s->written);
    put_count(object, "lost", s->lost);
    if (s->kind == SINK_RECORD || s->kind == SINK_JOURNAL)
        put_count(object, "bytes", s->bytes);
    if (s->kind == SINK_JOURNAL)
        put_count(object, "gaps", s->gaps);
    return object;
}

json_t *sinks_json(const sink_list *all)
{
    json_t *array = json_array();
    for (size_t i = 0; i < all->count; i++)
        put_last(array, sink_json(&all->all[i]));
    return array;
}

/* Returns the name without its folders; a URL stays whole. */
static const char *short_name(const sink_info *s)
{
    const char *slash = s->kind == SINK_LCM ? NULL : strrchr(s->name, '/');
    return slash ? slash + 1 : s->name;
}

/* Prints a sink as a part of the line that systemctl shows, behind the one before. */
static size_t print_one(char text[ONE_BYTES], const sink_info *s)
{
    char lost[REST_BYTES] = "";
    if (s->lost > 0)
        (void)snprintf(lost, sizeof lost, ", %" PRIu64 " lost", s->lost);
    return chars_print(text, ONE_BYTES, 0, ", %s %.100s %s%s%.100s%s", kind_names[s->kind],
                       short_name(s), s->state, s->why ? ": " : "", s->why ? s->why : "", lost);
}

size_t sinks_print(char *out, size_t size, const sink_list *all)
{
    size_t used = 0, left_out = 0, bad = 0;
    out[0] = '\0';
    for (size_t i = 0; i < 2 * all->count; i++) {
        const sink_info *s = &all->all[i % all->count];
        char text[ONE_BYTES];
        if (s->good != (i >= all->count))
            continue;
        const size_t length = print_one(text, s);
        if (used + length + REST_BYTES > size) {
            left_out++;
            bad += !s->good;
            continue;
        }
        memcpy(out + used, text, length + 1);
        used += length;
    }
    if (left_out > 0)
        used = chars_print(out, size, used, ", %zu more (%zu bad)", left_out, bad);
    return used;
}
