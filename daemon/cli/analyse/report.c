/* SPDX-License-Identifier: MIT
 *
 * report.c - what an analysis has found, as a table and as JSON.
 */
#include "cli/analyse/report.h"

#include "trace/frametext.h"

#include <inttypes.h>
#include <string.h>

#define CELL_MAX 40
#define PPM 1000000u

/* ---- Values ---------------------------------------------------------------------------------- */

static bool is_late(const response_message *m)
{
    return m->response == CW_NEVER || (m->period != CW_NEVER && m->response > m->period);
}

static bool exceeds(const source *s, const response_message *m)
{
    return m->response != CW_NEVER && s->seen > m->response;
}

bool report_is_bad(const analysis *a)
{
    bool bad = false;
    for (size_t i = 0; i < a->sources->count; i++)
        bad = bad || is_late(&a->sources->messages[i]) ||
              exceeds(&a->sources->list[i], &a->sources->messages[i]);
    return bad;
}

/* Returns the part of the bus that frames of a node take, in ppm; CW_NODES_MAX: all nodes. */
static uint64_t load_ppm(const sources *s, unsigned node, bool longest)
{
    uint64_t sum = 0;
    for (size_t i = 0; i < s->count; i++) {
        const response_message *m = &s->messages[i];
        const uint64_t length = longest ? m->length : s->list[i].length;
        if (m->period != CW_NEVER && (node == CW_NODES_MAX || m->node == node))
            sum += length * PPM / m->period;
    }
    return sum;
}

/* ---- Table ----------------------------------------------------------------------------------- */

static const char *print_time(char out[CELL_MAX], uint64_t ticks)
{
    const uint64_t ns = ticks == CW_NEVER ? 0 : text_ticks_ns(ticks);
    if (ticks == CW_NEVER)
        snprintf(out, CELL_MAX, "-");
    else
        snprintf(out, CELL_MAX, "%" PRIu64 ".%03" PRIu64, ns / 1000000, ns / 1000 % 1000);
    return out;
}

static const char *print_percent(char out[CELL_MAX], uint64_t ppm)
{
    snprintf(out, CELL_MAX, "%" PRIu64 ".%" PRIu64 " %%", ppm / 10000, ppm / 1000 % 10);
    return out;
}

static void print_message(FILE *out, const analysis *a, size_t i)
{
    const source *s = &a->sources->list[i];
    const response_message *m = &a->sources->messages[i];
    char frame[FRAME_TEXT_MAX], every[CELL_MAX], blocking[CELL_MAX], response[CELL_MAX],
        seen[CELL_MAX];
    text_print_frame(frame, &s->traffic->frame);
    frame[strcspn(frame, "#")] = '\0';
    fprintf(out, "%-12s %-8s %9s %5u %8s %9s", s->node->name, frame, print_time(every, m->period),
            s->bits, print_time(blocking, m->blocking), print_time(response, m->response));
    if (a->simulated)
        fprintf(out, " %9s", s->seen_count ? print_time(seen, s->seen) : "-");
    fputs(m->response == CW_NEVER ? "  no bound" : is_late(m) ? "  late" : "", out);
    fputs(exceeds(s, m) ? "  above its bound\n" : "\n", out);
}

static void print_loads(FILE *out, const analysis *a)
{
    const sources *s = a->sources;
    char mean[CELL_MAX], worst[CELL_MAX];
    fputs("\nLOAD             as it is   longest\n", out);
    for (unsigned i = 0; i <= s->config->node_count; i++) {
        const bool all = i == s->config->node_count;
        const unsigned node = all ? CW_NODES_MAX : i;
        if (all || load_ppm(s, node, true))
            fprintf(out, "%-15s %9s %9s\n", all ? "bus" : s->config->nodes[i].name,
                    print_percent(mean, load_ppm(s, node, false)),
                    print_percent(worst, load_ppm(s, node, true)));
    }
}

void report_print(FILE *out, const analysis *a)
{
    fprintf(out, "%-12s %-8s %9s %5s %8s %9s", "NODE", "FRAME", "EVERY", "BITS", "BLOCKED",
            "RESPONSE");
    fputs(a->simulated ? "      SEEN\n" : "\n", out);
    for (size_t i = 0; i < a->sources->count; i++)
        print_message(out, a, i);
    print_loads(out, a);
    fputs("\nTimes are in ms, bits and times with the most stuff bits.\n", out);
    if (a->sources->incomplete)
        fputs("Frames of ports, replays and replies are not among them: what they add is not "
              "known.\n", out);
}

/* ---- JSON ------------------------------------------------------------------------------------ */

static json_t *json_of_ticks(uint64_t ticks)
{
    return ticks == CW_NEVER ? json_null() : json_integer((json_int_t)text_ticks_ns(ticks));
}

static json_t *json_of_message(const analysis *a, size_t i)
{
    const source *s = &a->sources->list[i];
    const response_message *m = &a->sources->messages[i];
    char frame[FRAME_TEXT_MAX];
    text_print_frame(frame, &s->traffic->frame);
    frame[strcspn(frame, "#")] = '\0';
    json_t *object = json_pack("{s:s, s:s, s:i}", "node", s->node->name, "id", frame, "bits",
                               (int)s->bits);
    json_object_set_new(object, "period_ns", json_of_ticks(m->period));
    json_object_set_new(object, "jitter_ns", json_of_ticks(m->jitter));
    json_object_set_new(object, "length_ns", json_of_ticks(m->length));
    json_object_set_new(object, "blocking_ns", json_of_ticks(m->blocking));
    json_object_set_new(object, "response_ns", json_of_ticks(m->response));
    json_object_set_new(object, "late", json_boolean(is_late(m)));
    if (a->simulated)
        json_object_set_new(object, "seen_ns",
                            s->seen_count ? json_of_ticks(s->seen) : json_null());
    return object;
}

static json_t *json_of_load(const sources *s, unsigned node)
{
    return json_pack("{s:I, s:I}", "load_ppm", (json_int_t)load_ppm(s, node, false),
                     "load_longest_ppm", (json_int_t)load_ppm(s, node, true));
}

json_t *report_json(const analysis *a)
{
    const sources *s = a->sources;
    json_t *object = json_of_load(s, CW_NODES_MAX);
    json_t *messages = json_array(), *nodes = json_array();
    for (size_t i = 0; i < s->count; i++)
        json_array_append_new(messages, json_of_message(a, i));
    for (unsigned i = 0; i < s->config->node_count; i++) {
        json_t *node = json_of_load(s, i);
        json_object_set_new(node, "name", json_string(s->config->nodes[i].name));
        json_array_append_new(nodes, node);
    }
    json_object_set_new(object, "bus", json_string(s->config->bus_name));
    json_object_set_new(object, "complete", json_boolean(!s->incomplete));
    json_object_set_new(object, "error_every_ns", json_of_ticks(a->error_every));
    if (a->simulated)
        json_object_set_new(object, "simulated_ns", json_of_ticks(a->simulated));
    json_object_set_new(object, "messages", messages);
    json_object_set_new(object, "nodes", nodes);
    return object;
}
