/* SPDX-License-Identifier: MIT
 *
 * report.c - what the rows of a campaign show together.
 */
#include "campaign/report/report.h"

#include "campaign/report/memory.h"
#include "campaign/report/valuetext.h"
#include "campaign/space/sample.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- The start ------------------------------------------------------------------------------- */

/* Returns the number of different values that a factor may have, or 0. */
static uint64_t possible_values(const factor *f)
{
    if (f->kind == FACTOR_NORMAL)
        return 0;
    if (f->kind != FACTOR_UNIFORM)
        return f->count;
    return (uint64_t)((f->to.mantissa - f->from.mantissa) / f->step.mantissa) + 1;
}

/* Reads the value of a factor. */
static const jsonread_value *report_value(jsonread *reader, buffer *text)
{
    jsonread_problem problem;
    const char *seen = memory_seen(text);
    return memory_json(reader, &problem, seen, buffer_length(text));
}

/* Adds the values that a campaign lists, so that values without a row are known. */
static void add_values(dimension *d, const factor *f)
{
    buffer text = {.data = NULL};
    buffer shown = {.data = NULL};
    jsonread reader = {.copy = NULL};
    d->possible = possible_values(f);
    if ((f->kind != FACTOR_LIST && f->kind != FACTOR_RANGE) || f->count > DIMENSION_VALUES_MAX)
        return;
    for (uint64_t i = 0; i < f->count; i++) {
        buffer_clear(&text);
        sample_value(&text, f, &(choice){.index = i});
        (void)dimension_find(d, value_text(&shown, report_value(&reader, &text)));
    }
    d->possible = d->count; /* a list may have a value twice */
    jsonread_free(&reader);
    buffer_free(&shown);
    buffer_free(&text);
}

static void add_group(report *r, const char *name, const char *part)
{
    if (r->group_count < REPORT_GROUPS_MAX)
        r->groups[r->group_count++] =
            (dimension){.name = memory_print("%s.%s", name, part)};
}

/* Adds a factor. One that is a place in a frame has two groups more, by frame and by field. */
static void begin_factor(report *r, const report_row *first, const char *name)
{
    r->factors[r->factor_count++].name = memory_text(name);
    if (!value_is_space(jsonread_get(first->factors, name)))
        return;
    add_group(r, name, "frame");
    add_group(r, name, "field");
}

/* The factors have the order of the campaign, or that of the first row. */
static void begin_factors(report *r, const report_row *first)
{
    const campaign *c = r->campaign;
    const jsonread_value *all = first->factors;
    for (size_t i = 0; c && i < c->factor_count; i++) {
        begin_factor(r, first, c->factors[i].name);
        add_values(&r->factors[i], &c->factors[i]);
    }
    for (const jsonread_value *f = c ? NULL : jsonread_first(all); f; f = jsonread_next(all, f))
        if (r->factor_count < CAMPAIGN_FACTORS_MAX)
            begin_factor(r, first, f->key);
}

void report_begin(report *r, const report_row *first, const campaign *c)
{
    r->campaign = c;
    r->expectations.name = memory_text("expectation");
    r->errors.name = memory_text("first error");
    r->lost.name = memory_text("lost");
    if (first->factors)
        begin_factors(r, first);
    pairs_begin(&r->pairs, r->factor_count);
}

char *report_unread_text(const report *r)
{
    if (r->unread == ENOENT)
        return memory_print("%s is not there", r->source.file);
    return memory_print("%s cannot be read%s%s", r->source.file, r->unread ? ": " : "",
                        r->unread ? strerror(r->unread) : "");
}

/* ---- What is missing ------------------------------------------------------------------------- */

uint64_t report_possible(const report *r)
{
    return r->campaign ? r->campaign->rows : 0;
}

bool report_missing(const report *r, span *out)
{
    const spans *n = &r->numbers;
    const uint64_t end = report_possible(r);
    if (n->count == 0)
        return false;
    if (r->source.is_campaign && n->list[0].first > 0) {
        *out = (span){.first = 0, .last = n->list[0].first - 1};
        return true;
    }
    if (n->count > 1) {
        *out = (span){.first = n->list[0].last + 1, .last = n->list[1].first - 1};
        return true;
    }
    *out = (span){.first = n->list[0].last + 1, .last = end - 1};
    return end > 0 && out->first < end;
}

/* The campaign belongs to its owner, and is not freed. */
void report_free(report *r)
{
    for (size_t i = 0; i < r->factor_count; i++)
        dimension_free(&r->factors[i]);
    for (size_t i = 0; i < r->group_count; i++)
        dimension_free(&r->groups[i]);
    for (unsigned i = 0; i < CLASS_COUNT; i++)
        candidates_free(&r->candidates[i]);
    dimension_free(&r->expectations);
    dimension_free(&r->errors);
    dimension_free(&r->lost);
    pairs_free(&r->pairs);
    spans_free(&r->numbers);
    row_source_free(&r->source);
}
