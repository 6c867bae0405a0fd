/* SPDX-License-Identifier: MIT
 *
 * variant.c - the scenario of a row as a text.
 */
#include "campaign/space/variant.h"

#include <assert.h>
#include <string.h>

static bool is_in_text(const factor *f)
{
    return f->edit.before != NULL;
}

/* Returns true when an edit comes before another one in the text. At one place, what is put in
 * comes before what is replaced, and all spaces come before other keys: their rules are one
 * list. */
static bool comes_before(const factor *a, const factor *b)
{
    if (a->edit.begin != b->edit.begin)
        return a->edit.begin < b->edit.begin;
    if (a->edit.end != b->edit.end)
        return a->edit.end < b->edit.end;
    return a->rules && !b->rules;
}

size_t variant_next_edit(const campaign *c, uint64_t done)
{
    size_t next = SIZE_MAX;
    for (size_t i = 0; i < c->factor_count; i++)
        if (is_in_text(&c->factors[i]) && !(done >> i & 1) &&
            (next == SIZE_MAX || comes_before(&c->factors[i], &c->factors[next])))
            next = i;
    return next;
}

/* Writes the rules of a space, which are lines. */
static void put_rules(buffer *out, const char *rules, const char *between)
{
    const char *end = strchr(rules, '\n');
    (void)buffer_append(out, rules, end ? (size_t)(end - rules) : strlen(rules));
    if (!end)
        return;
    buffer_put(out, between);
    buffer_put(out, end + 1);
}

void variant_text(buffer *out, const campaign *c, const choice *choices)
{
    variant_text_without(out, c, choices, 0);
}

void variant_text_without(buffer *out, const campaign *c, const choice *choices,
                          uint64_t without)
{
    uint64_t done = without;
    size_t at = 0;
    for (size_t i; (i = variant_next_edit(c, done)) != SIZE_MAX; done |= UINT64_C(1) << i) {
        const factor *f = &c->factors[i];
        assert(at <= f->edit.begin);
        (void)buffer_append(out, c->text + at, f->edit.begin - at);
        buffer_put(out, f->edit.before);
        if (f->rules)
            put_rules(out, f->rules[choices[i].index], f->edit.between);
        else
            sample_value(out, f, &choices[i]);
        buffer_put(out, f->edit.after);
        at = f->edit.end;
    }
    (void)buffer_append(out, c->text + at, c->size - at);
}

bool variant_seed(uint64_t *seed, const campaign *c, const choice *choices)
{
    for (size_t i = 0; i < c->factor_count; i++) {
        char room[NUMBER_TEXT_MAX];
        if (!c->factors[i].is_seed)
            continue;
        const char *text = sample_text(room, &c->factors[i], &choices[i]);
        text += *text == '"';
        return text_take_digits(seed, &text, UINT64_MAX);
    }
    return false;
}
