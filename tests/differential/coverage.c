/* SPDX-License-Identifier: MIT
 *
 * coverage.c - what was exercised: a comparison of nothing finds nothing.
 */
#include "differential.h"

#include <ctype.h>
#include <inttypes.h>

const char *diff_action_name(cw_action action)
{
    static char name[16];
    const char *from = cw_action_name(action);
    unsigned i = 0;
    for (; from[i] && i < sizeof name - 1; i++)
        name[i] = from[i] == '-' ? '_' : (char)toupper((unsigned char)from[i]);
    name[i] = '\0';
    return name;
}

const char *diff_op_name(diff_op_kind kind)
{
    static const char *const names[DIFF_OP_COUNT] = {
        "send",   "restart",    "add rule",  "clear rule",    "stop rule", "fire rule", "set",
        "flush",  "attach",     "set events", "take over",    "bring forward", "stepping",
        "watching", "check"};
    return names[kind];
}

static const char *trigger_name(unsigned trigger)
{
    static const char *const names[] = {"frame", "time", "armed", "error"};
    return names[trigger];
}

static const char *status_name(unsigned status)
{
    static const char *const names[] = {"ok", "full", "invalid", "refused", "again"};
    return names[status];
}

static void cover_fault(diff_coverage *c, const cw_rule *rule)
{
    c->actions[rule->action]++;
    c->triggers[rule->trigger]++;
    if (cw_action_kind_of(rule->action) == CW_KIND_POSITION)
        c->fields[rule->field]++;
}

void diff_cover_event(diff_coverage *c, const cw_event *e, const cw_rule *rule)
{
    c->events[e->kind]++;
    if (e->kind == CW_EVENT_FAULT && rule)
        cover_fault(c, rule);
    if (e->kind == CW_EVENT_ERROR)
        c->errors[e->error.type]++;
    if (e->kind == CW_EVENT_DROP)
        c->drops[e->why]++;
    if (e->kind == CW_EVENT_STATE)
        c->states[e->state]++;
}

/* One line of counters, with their names. Returns how many are 0, and writes those to missing. */
typedef struct table {
    const char *title;
    const uint64_t *counts;
    unsigned first;
    unsigned count;
    const char *(*name)(unsigned);
} table;

static const char *event_name(unsigned i)
{
    return cw_event_name((cw_event_kind)i);
}
static const char *action_name(unsigned i)
{
    return diff_action_name((cw_action)i);
}
static const char *field_name(unsigned i)
{
    return cw_field_name((cw_field)i);
}
static const char *error_name(unsigned i)
{
    return cw_error_type_name((cw_error_type)i);
}
static const char *drop_name(unsigned i)
{
    return cw_drop_name((cw_drop)i);
}
static const char *state_name(unsigned i)
{
    return cw_state_name((cw_state)i);
}
static const char *op_name(unsigned i)
{
    return diff_op_name((diff_op_kind)i);
}

static const char *mark_name(unsigned i)
{
    static const char *const names[DIFF_MARK_COUNT] = {"comparisons", "in short cuts", "full rings",
                                                       "full buses", "foretold", "foreseen"};
    return names[i];
}

#define TABLES 10u

static void fill_tables(table tables[TABLES], const diff_coverage *c)
{
    const table all[TABLES] = {
        {"events", c->events, 0, CW_EVENT_SKIP, event_name}, /* all but the kind that only hosts
                                                                make */
        {"faults", c->actions, 0, CW_ACTION_COUNT, action_name},
        {"positions", c->fields, CW_FIELD_SOF, CW_FIELD_COUNT, field_name},
        {"triggers", c->triggers, 0, CW_TRIGGER_ERROR + 1, trigger_name},
        {"errors", c->errors, 0, CW_ERROR_COUNT, error_name},
        {"drops", c->drops, 0, CW_DROP_COUNT, drop_name},
        {"states", c->states, 0, CW_STATE_COUNT, state_name},
        {"operations", c->ops, 0, DIFF_OP_COUNT, op_name},
        {"besides", c->marks, 0, DIFF_MARK_COUNT, mark_name},
        {"statuses", c->refusals, 0, CW_AGAIN + 1, status_name},
    };
    for (unsigned i = 0; i < TABLES; i++)
        tables[i] = all[i];
}

static void write_table(const table *t, FILE *out)
{
    fprintf(out, "%-10s", t->title);
    unsigned column = 10;
    for (unsigned i = t->first; i < t->count; i++) {
        if (column > 84)
            column = (unsigned)fprintf(out, "\n%-10s", "") - 1;
        column += (unsigned)fprintf(out, " %s %" PRIu64, t->name(i), t->counts[i]);
    }
    fputc('\n', out);
}

static unsigned missing_of(const table *t, FILE *out)
{
    unsigned missing = 0;
    for (unsigned i = t->first; i < t->count; i++) {
        if (t->counts[i] > 0)
            continue;
        fprintf(out, "never exercised: %s: %s\n", t->title, t->name(i));
        missing++;
    }
    return missing;
}

void diff_cover_write(const diff_coverage *c, FILE *out)
{
    table tables[TABLES];
    fill_tables(tables, c);
    fprintf(out,
            "%" PRIu64 " scenarios, %" PRIu64 " bits, %" PRIu64 " frames, %" PRIu64
            " error frames\n",
            c->scenarios, c->bits, c->frames, c->error_frames);
    for (unsigned i = 0; i < TABLES; i++)
        write_table(&tables[i], out);
    for (unsigned i = 0; i < DIFF_STYLES; i++)
        fprintf(out, "%-22s %10" PRIu64 " bits %8" PRIu64 " frames\n", diff_style_name(i),
                c->style_bits[i], c->style_frames[i]);
}

unsigned diff_cover_missing(const diff_coverage *c, FILE *out)
{
    table tables[TABLES];
    unsigned missing = 0;
    fill_tables(tables, c);
    for (unsigned i = 0; i < TABLES; i++)
        missing += missing_of(&tables[i], out);
    return missing;
}
