/* SPDX-License-Identifier: MIT
 *
 * variant.c - the scenario of a row as a text.
 */
#include "campaign/variant.h"

#include <string.h>

static void put_bytes(rowtext *out, const char *bytes, size_t count)
{
    if (!buffer_append(&out->bytes, bytes, count))
        out->no_memory = true;
}

static bool is_in_text(const factor *f)
{
    return f->edit.before != NULL;
}

/* Returns the next factor in the text behind a place, or SIZE_MAX. Those at one place come in the
 * order of the file. */
static size_t next_edit(const campaign *c, uint64_t done)
{
    size_t next = SIZE_MAX;
    for (size_t i = 0; i < c->factor_count; i++) {
        const factor *f = &c->factors[i];
        if (is_in_text(f) && !(done >> i & 1) &&
            (next == SIZE_MAX || f->edit.begin < c->factors[next].edit.begin))
            next = i;
    }
    return next;
}

void variant_text(rowtext *out, const campaign *c, const choice *choices)
{
    uint64_t done = 0;
    size_t at = 0;
    for (size_t i; (i = next_edit(c, done)) != SIZE_MAX; done |= UINT64_C(1) << i) {
        const factor *f = &c->factors[i];
        put_bytes(out, c->text + at, f->edit.begin - at);
        rowtext_put(out, f->edit.before);
        if (f->rules)
            rowtext_put(out, f->rules[choices[i].index]);
        else
            sample_value(out, f, &choices[i]);
        rowtext_put(out, f->edit.after);
        at = f->edit.end;
    }
    put_bytes(out, c->text + at, c->size - at);
}

/* Reads digits, with or without quotes. */
static uint64_t read_digits(const char *at, size_t length)
{
    uint64_t value = 0;
    for (size_t i = 0; i < length; i++)
        if (at[i] >= '0' && at[i] <= '9')
            value = value * 10 + (uint64_t)(at[i] - '0');
    return value;
}

bool variant_seed(uint64_t *seed, const campaign *c, const choice *choices)
{
    for (size_t i = 0; i < c->factor_count; i++) {
        rowtext text = {.no_memory = false};
        if (!c->factors[i].is_seed)
            continue;
        sample_value(&text, &c->factors[i], &choices[i]);
        *seed = read_digits(buffer_first(&text.bytes), buffer_length(&text.bytes));
        rowtext_free(&text);
        return true;
    }
    return false;
}
