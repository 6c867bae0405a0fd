/* SPDX-License-Identifier: MIT
 *
 * candidates.c - rows that stand for all rows of a class: one for each kind of failure.
 */
#include "campaign/report/candidates.h"

#include "base/text/jsontext.h"
#include "campaign/report/memory.h"
#include "base/text/buffer.h"

#include <stdlib.h>
#include <string.h>

static unsigned degraded_of(const report_row *row)
{
    return row->class == CLASS_DEGRADED ? row->facts.degraded : 0;
}

/* Writes the kind of a row. */
static void write_kind(buffer *kind, const report_row *row, const row_signs *signs)
{
    static const char *const keys[] = {"type", "field", "role", "node"};
    const jsonread_value *failed = jsonread_first(row->failed);
    jsontext_number(kind, "degraded", degraded_of(row));
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

static const char *first_failed(const report_row *row, const row_signs *signs)
{
    const jsonread_value *failed = jsonread_first(row->failed);
    for (; failed; failed = jsonread_next(row->failed, failed))
        if (!row_signs_has(signs, row_failed_name(failed)))
            return row_failed_name(failed);
    return NULL;
}

static uint64_t candidates_name_of(const report_row *row)
{
    return row->has_number ? row->number : row->seed;
}

/* Returns true when a row comes before a candidate. */
static bool is_before(const report_row *row, const candidate *c)
{
    return row->end_ns != c->end_ns ? row->end_ns < c->end_ns : candidates_name_of(row) < c->number;
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

static void put_in(candidates *c, const candidate *added, const report_row *row)
{
    size_t at = c->count;
    while (at > 0 && is_before(row, &c->list[at - 1]))
        at--;
    memmove(c->list + at + 1, c->list + at, (c->count - at) * sizeof *c->list);
    c->list[at] = *added;
    c->count++;
}

/* Makes room for a row of a kind. Returns false when others stand for the class. */
static bool candidates_make_room(candidates *c, const report_row *row, const char *kind)
{
    for (size_t i = 0; i < c->count; i++) {
        if (strcmp(c->list[i].kind, kind) != 0)
            continue;
        if (!is_before(row, &c->list[i]))
            return false;
        take_out(c, i);
        return true;
    }
    if (c->count < CANDIDATES_MAX)
        return true;
    if (!is_before(row, &c->list[c->count - 1]))
        return false;
    take_out(c, c->count - 1);
    return true;
}

void candidates_add(candidates *c, const report_row *row, const row_signs *signs)
{
    buffer text = {.data = NULL};
    write_kind(&text, row, signs);
    char *kind = memory_of_buffer(&text);
    if (candidates_make_room(c, row, kind)) {
        const char *failed = first_failed(row, signs);
        const candidate added = {.kind = memory_text(kind),
                                 .expectation = failed ? memory_text(failed) : NULL,
                                 .repeat = memory_text(row->repeat),
                                 .degraded = degraded_of(row),
                                 .number = candidates_name_of(row),
                                 .seed = row->seed,
                                 .end_ns = row->end_ns};
        put_in(c, &added, row);
    }
    free(kind);
}

void candidates_free(candidates *c)
{
    for (size_t i = 0; i < c->count; i++)
        candidates_forget(&c->list[i]);
    c->count = 0;
}
