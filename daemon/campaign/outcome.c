/* SPDX-License-Identifier: MIT
 *
 * outcome.c - the outcome of one scenario, as a part of its row.
 */
#include "campaign/outcome.h"

#include "base/text/jsontext.h"

#include <assert.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const char *outcome_name(outcome o)
{
    static const char *const names[OUTCOME_COUNT] = {
        [OUTCOME_PASSED] = "passed",   [OUTCOME_FAILED] = "failed",
        [OUTCOME_INVALID] = "invalid", [OUTCOME_BROKEN] = "broken",
        [OUTCOME_CRASHED] = "crashed", [OUTCOME_TIMEOUT] = "time-out",
    };
    return names[o];
}

/* ---- Expectations ---------------------------------------------------------------------------- */

/* Writes an expectation that is not met, with what there was instead. */
static void write_failed(buffer *row, const expect_outcome *e)
{
    jsontext_item(row, "{");
    jsontext_string(row, "name", e->name);
    jsontext_string(row, "got", e->got);
    buffer_put(row, "}");
}

/* Writes how many expectations were met, and those that were not by name. */
static void write_expectations(buffer *row, const expect_report *report)
{
    jsontext_value(row, "expectations", "{");
    jsontext_number(row, "met", report->count - report->failed);
    jsontext_value(row, "failed", "[");
    for (size_t i = 0; i < report->count && report->failed > 0; i++)
        if (!report->outcomes[i].met)
            write_failed(row, &report->outcomes[i]);
    buffer_put(row, "]}");
}

/* ---- The bus --------------------------------------------------------------------------------- */

/* Adds up the counters of all buses: a row of a rig has one figure for each. */
static cw_bus_stats sum_of_buses(const scenario *s)
{
    cw_bus_stats sum = {.bits = 0};
    for (size_t i = 0; i < s->count; i++) {
        cw_bus_stats one;
        cw_bus_get_stats(s->buses[i].run.bus, &one);
#define ADD(name) sum.name += one.name;
        OUTCOME_BUS_COUNTERS(ADD)
    }
    return sum;
}

static void write_bus(buffer *row, const scenario *s)
{
    const cw_bus_stats sum = sum_of_buses(s);
    jsontext_seconds(row, "t", scenario_now(s));
#define WRITE(name) jsontext_number(row, #name, sum.name);
    OUTCOME_BUS_COUNTERS(WRITE)
}

/* ---- The first error ------------------------------------------------------------------------- */

/* Returns the bus with the first error, or NULL. */
static const scenario_bus *find_first_error(const scenario *s)
{
    const scenario_bus *first = NULL;
    for (size_t i = 0; i < s->count; i++) {
        const scenario_bus *b = &s->buses[i];
        if (b->seen.has_error && (!first || b->seen.error_tick < first->seen.error_tick))
            first = b;
    }
    return first;
}

/* Returns the tick of the first hit of a rule, or CW_NEVER. */
static uint64_t find_first_fault(const scenario *s)
{
    uint64_t first = CW_NEVER;
    for (size_t i = 0; i < s->count; i++)
        if (s->buses[i].seen.has_fault && s->buses[i].seen.fault_tick < first)
            first = s->buses[i].seen.fault_tick;
    return first;
}

/* Writes the first error: when, where in the frame, and who has seen it. */
static void write_error(buffer *row, const scenario_bus *b)
{
    const observation *seen = &b->seen;
    const unsigned node = (unsigned)__builtin_ctzll(seen->error_nodes);
    buffer_put(row, "{");
    jsontext_seconds(row, "t", seen->error_tick);
    if (b->all->rig)
        jsontext_string(row, "bus", b->config->bus_name);
    jsontext_string(row, "node", b->config->nodes[node].name);
    jsontext_string(row, "role", seen->error.role == CW_ROLE_TRANSMITTER ? "tx" : "rx");
    jsontext_string(row, "type", cw_error_type_name(seen->error.type));
    jsontext_string(row, "field", cw_field_name(seen->error.place.field));
    jsontext_number(row, "index", seen->error.place.index);
    if (seen->error.place.stuff)
        jsontext_value(row, "stuff", "true");
    buffer_put(row, "}");
}

/* Returns the tick of the first error at or after a hit of a rule, or CW_NEVER. Of a bus without
 * hits only the first error is known. */
static uint64_t find_later_error(const scenario *s, uint64_t fault)
{
    uint64_t first = CW_NEVER;
    for (size_t i = 0; i < s->count; i++) {
        const observation *seen = &s->buses[i].seen;
        if (seen->has_error && seen->error_tick >= fault && seen->error_tick < first)
            first = seen->error_tick;
        if (seen->has_later && seen->later_tick < first)
            first = seen->later_tick;
    }
    return first;
}

/* The latency is the time from the first hit of a rule to the first error after it. */
static void write_first_error(buffer *row, const scenario *s)
{
    const scenario_bus *b = find_first_error(s);
    const uint64_t fault = find_first_fault(s);
    const uint64_t error = fault == CW_NEVER ? CW_NEVER : find_later_error(s, fault);
    jsontext_key(row, "first_error");
    if (b)
        write_error(row, b);
    else
        buffer_put(row, "null");
    if (error != CW_NEVER) {
        jsontext_seconds(row, "latency", error - fault);
        return;
    }
    jsontext_value(row, "latency", "null");
}

/* ---- Nodes ----------------------------------------------------------------------------------- */

#define COUNTER_MAX (CHARS_DECIMAL_MAX + 24u) /* bytes of a counter with its key */
#define COUNT_ONE(key, member, count) +1
#define COUNTERS_MAX ((4u OUTCOME_NODE_COUNTERS(COUNT_ONE)) * COUNTER_MAX + 64u) /* with a state */

/* Returns the sum of counters of 32 or 64 bits. */
static inline uint64_t sum_of(const void *values, size_t size, unsigned count)
{
    uint64_t sum = 0;
    assert(size == sizeof(uint32_t) || size == sizeof sum);
    for (unsigned i = 0; i < count; i++)
        sum += size == sizeof sum ? ((const uint64_t *)values)[i] : ((const uint32_t *)values)[i];
    return sum;
}

/* Writes state and counters of a node. This is the longest part of a row, so it is written without
 * checks of room in between. */
static void write_counters(buffer *row, const cw_node_stats *n, const observation *seen,
                           unsigned node)
{
    if (!buffer_reserve(row, COUNTERS_MAX))
        return;
    char *at = row->data + row->end;
    at = jsontext_end_word(chars_text(at, "{\"state\":\""), cw_state_name(n->state));
    at = AT_NUMBER(at, "tec", n->tec);
    at = AT_NUMBER(at, "rec", n->rec);
    at = AT_NUMBER(at, "tec_max", seen->tec_max[node]);
    at = AT_NUMBER(at, "rec_max", seen->rec_max[node]);
#define WRITE_COUNTER(key, member, count)                                                          \
    at = AT_NUMBER(at, #key, sum_of(&n->member, sizeof n->member / (count), count));
    OUTCOME_NODE_COUNTERS(WRITE_COUNTER)
    *at++ = '}';
    row->end = (size_t)(at - row->data);
}

/* Writes a node's counters. In a rig the name of its bus is before its own, as nodes are unique on
 * a bus only. */
static void write_node(buffer *row, const scenario_bus *b, unsigned node)
{
    cw_node_stats stats;
    char key[2 * CFG_NODE_NAME_MAX + 2];
    if (cw_node_get_stats(b->run.bus, node, &stats) != CW_OK)
        return;
    if (b->all->rig)
        (void)snprintf(key, sizeof key, "%s:%s", b->config->bus_name, b->config->nodes[node].name);
    jsontext_key(row, b->all->rig ? key : b->config->nodes[node].name);
    write_counters(row, &stats, &b->seen, node);
}

static void write_nodes(buffer *row, const scenario *s)
{
    jsontext_value(row, "nodes", "{");
    for (size_t i = 0; i < s->count; i++)
        for (unsigned node = 0; node < s->buses[i].config->node_count; node++)
            write_node(row, &s->buses[i], node);
    buffer_put(row, "}");
}

/* ---- Losses ---------------------------------------------------------------------------------- */

/* Writes frames that a node has lost, or a rule that has not acted, with the reason. */
static void write_loss(void *user, const loss_words *w)
{
    buffer *row = user;
    jsontext_item(row, "{");
    jsontext_string(row, w->is_rule ? "rule" : "node", w->name);
    jsontext_string(row, "why", w->why);
    if (!w->is_rule)
        jsontext_number(row, "frames", w->frames);
    if (w->ids[0])
        jsontext_string(row, "ids", w->ids);
    if (w->help[0])
        jsontext_string(row, "help", w->help);
    buffer_put(row, "}");
}

/* Writes the losses on all buses, in the order of the buses. */
static void write_losses(buffer *row, const scenario *s)
{
    char before[CFG_NODE_NAME_MAX + 2] = "";
    jsontext_value(row, "lost", "[");
    for (size_t i = 0; i < s->count; i++) {
        const scenario_bus *b = &s->buses[i];
        if (s->rig)
            (void)snprintf(before, sizeof before, "%s:", b->config->bus_name);
        losses_tell(&b->lost, b->run.bus, before, write_loss, row);
    }
    buffer_put(row, "]");
}

/* ---- Notes ----------------------------------------------------------------------------------- */

/* Writes what was left out of files that the scenario replays; no key where nothing was. */
static void write_notes(buffer *row, const scenario *s)
{
    const size_t begin = strlen(SIM_NOTE);
    bool any = false;
    for (const char *line = scenario_notes(s); *line; line += strcspn(line, "\n") + 1) {
        const size_t length = strcspn(line, "\n");
        char *note = strncmp(line, SIM_NOTE, begin) == 0 && line[length]
                         ? strndup(line + begin, length - begin)
                         : NULL;
        if (!note)
            continue;
        if (!any)
            jsontext_value(row, "notes", "[");
        jsontext_item(row, "");
        jsontext_quoted(row, note);
        free(note);
        any = true;
    }
    buffer_put(row, any ? "]" : "");
}

/* ---- All of it ------------------------------------------------------------------------------- */

outcome outcome_write(buffer *row, const scenario *s)
{
    return outcome_write_as(row, s, s->report.failed > 0 ? OUTCOME_FAILED : OUTCOME_PASSED, "");
}

outcome outcome_write_as(buffer *row, const scenario *s, outcome o, const char *why)
{
    outcome_write_none(row, o, why);
    write_expectations(row, &s->report);
    write_bus(row, s);
    write_first_error(row, s);
    write_nodes(row, s);
    write_losses(row, s);
    write_notes(row, s);
    return o;
}

void outcome_write_none(buffer *row, outcome o, const char *why)
{
    jsontext_string(row, "outcome", outcome_name(o));
    if (*why)
        jsontext_string(row, "why", why);
}

bool outcome_is_shortage(const char *message)
{
    static const int errors[] = {ENOMEM, EMFILE, ENFILE, EAGAIN, EINTR, EIO, ENOBUFS, ENOSPC};
    bool found = strstr(message, "out of memory");
    for (size_t i = 0; i < sizeof errors / sizeof *errors; i++)
        found = found || strstr(message, strerrordesc_np(errors[i]));
    return found;
}

const char *outcome_first_error(char *messages)
{
    char *line = messages;
    for (char *end; (end = strchr(line, '\n')); line = end + 1) {
        *end = '\0';
        if (!strstr(line, ": warning: "))
            break;
    }
    return line;
}

outcome outcome_write_invalid(buffer *row, char *messages)
{
    const bool lacks = !messages || !*messages || outcome_is_shortage(messages);
    outcome_write_none(row, OUTCOME_INVALID, lacks ? "" : outcome_first_error(messages));
    row->no_memory = row->no_memory || lacks;
    return OUTCOME_INVALID;
}

outcome outcome_write_broken(buffer *row, scenario *s)
{
    char *why = scenario_why(s);
    outcome_write_none(row, OUTCOME_BROKEN, why ? why : "");
    row->no_memory = row->no_memory || !why || outcome_is_shortage(why);
    free(why);
    return OUTCOME_BROKEN;
}

void outcome_end_row(buffer *row, buffer *command)
{
    const char *repeat = buffer_text(command);
    row->no_memory = row->no_memory || !repeat;
    jsontext_string(row, "repeat", repeat ? repeat : "");
    buffer_put(row, "}\n");
}
