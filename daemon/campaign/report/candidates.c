/* SPDX-License-Identifier: MIT
 *
 * candidates.c - rows that stand for all rows of a class: one for each kind of failure.
 */
#include "campaign/report/candidates.h"

#include "base/text/jsontext.h"
#include "campaign/report/memory.h"

#include <stdlib.h>
#include <string.h>

void candidate_put_kind(buffer *kind, const report_row *row, const row_signs *signs)
{
    static const char *const keys[] = {"type", "field", "role", "node"};
    const jsonread_value *failed = jsonread_first(row->failed);
    jsontext_number(kind, "degraded", row->class == CLASS_DEGRADED ? row->facts.degraded : 0);
    buffer_put(kind, "\n");
    for (; failed; failed = jsonread_next(row->failed, failed)) {
        if (row_signs_has(signs, row_failed_name(failed)))
            continue;
        buffer_put(kind, row_failed_name(failed));
        buffer_put(kind, "\n");
    }
    for (size_t i = 0; i < sizeof keys / sizeof keys[0] && row->first_error; i++) {
        buffer_put(kind, jsonread_string(jsonread_get(row->first_error, keys[i])));
        buffer_put(kind, "\n");
    }
}

const char *candidate_expectation(const report_row *row, const row_signs *signs)
{
    const jsonread_value *failed = jsonread_first(row->failed);
    for (; failed; failed = jsonread_next(row->failed, failed))
        if (!row_signs_has(signs, row_failed_name(failed)))
            return row_failed_name(failed);
    return NULL;
}

/* Returns true when a row comes before another one. */
static bool is_before(const candidate *a, const candidate *b)
{
    return a->end_ns != b->end_ns ? a->end_ns < b->end_ns : a->number < b->number;
}

static void candidates_forget(candidate *c)
{
    free(c->kind);
    free(c->expectation);
    free(c->repeat);
}

static void take_out(candidates *c, size_t at)
{
    candidates_forget(&c->list[at]);
    memmove(c->list + at, c->list + at + 1, (c->count - at - 1) * sizeof *c->list);
    c->count--;
}

/* Puts a candidate into its place: the list is in order. */
static void put_in(candidates *c, const candidate *added)
{
    size_t at = c->count;
    while (at > 0 && is_before(added, &c->list[at - 1]))
        at--;
    memmove(c->list + at + 1, c->list + at, (c->count - at) * sizeof *c->list);
    c->list[at] = *added;
    c->count++;
}

/* Makes room for a row. Returns false when others stand for the class. */
static bool candidates_make_room(candidates *c, const candidate *one)
{
    for (size_t i = 0; i < c->count; i++) {
        if (strcmp(c->list[i].kind, one->kind) != 0)
            continue;
        if (!is_before(one, &c->list[i]))
            return false;
        take_out(c, i);
        return true;
    }
    if (c->count < CANDIDATES_MAX)
        return true;
    if (!is_before(one, &c->list[c->count - 1]))
        return false;
    take_out(c, c->count - 1);
    return true;
}

void candidates_add(candidates *c, const candidate *one)
{
    if (!candidates_make_room(c, one))
        return;
    candidate added = *one;
    added.kind = memory_text(one->kind);
    added.expectation = one->expectation ? memory_text(one->expectation) : NULL;
    added.repeat = memory_text(one->repeat);
    put_in(c, &added);
}

void candidates_free(candidates *c)
{
    for (size_t i = 0; i < c->count; i++)
        candidates_forget(&c->list[i]);
    c->count = 0;
}
