/* SPDX-License-Identifier: MIT
 *
 * sample.c - the values of the factors in a row of a campaign, by the number of the row alone.
 */
#include "campaign/space/sample.h"

#include "campaign/space/normal.h"
#include "campaign/space/pairwise.h"

#include <math.h>
#include <string.h>

static bool is_drawn(const factor *f)
{
    return f->kind == FACTOR_UNIFORM || f->kind == FACTOR_NORMAL;
}

/* Returns the upper half of a product: an index below `count`. */
static uint64_t scale(uint64_t drawn, uint64_t count)
{
    const uint64_t low = (drawn & UINT32_MAX) * (count & UINT32_MAX);
    const uint64_t one = (drawn >> 32) * (count & UINT32_MAX) + (low >> 32);
    const uint64_t two = (drawn & UINT32_MAX) * (count >> 32) + (one & UINT32_MAX);
    return (drawn >> 32) * (count >> 32) + (one >> 32) + (two >> 32);
}

/* ---- Rows ------------------------------------------------------------------------------------ */

/* Multiplies up to the limit. */
static uint64_t times(uint64_t a, uint64_t b)
{
    return b > 0 && a > CAMPAIGN_ROWS_MAX / b ? CAMPAIGN_ROWS_MAX : a * b;
}

/* The number of rows is a product, and so is the one without pruning. times() limits both. */
static const char *prepare_full(campaign *c)
{
    uint64_t all = 1;
    uint64_t whole = 1;
    for (size_t i = 0; i < c->factor_count; i++) {
        all = times(all, c->factors[i].count);
        whole = times(whole, c->factors[i].count + c->factors[i].pruned);
    }
    c->rows = all;
    c->pruned = whole - all;
    return all < CAMPAIGN_ROWS_MAX ? NULL : "the full product has more than 2^62 rows";
}

const char *sample_prepare(campaign *c)
{
    if (c->sample == SAMPLE_FULL)
        return prepare_full(c);
    if (c->sample == SAMPLE_PAIRWISE)
        return pairwise_prepare(c);
    c->rows = c->sample_count;
    return NULL;
}

/* ---- Samples --------------------------------------------------------------------------------- */

/* Sets a choice by a number of 2^64. */
static void choose_at(choice *out, const factor *f, uint64_t drawn)
{
    out->drawn = drawn;
    out->index = is_drawn(f) ? 0 : scale(drawn, f->count);
}

/* Sets a choice by an index. Distributions draw a number for each. */
static void choose_index(choice *out, const campaign *c, const factor *f, uint64_t index)
{
    out->index = index;
    out->drawn = is_drawn(f) ? cw_random(c->seed, f->name, index) : 0;
}

/* The number of a row has a digit for each factor, the last one of which changes fastest. */
static void choose_full(choice *out, const campaign *c, uint64_t row)
{
    for (size_t i = c->factor_count; i-- > 0;) {
        const factor *f = &c->factors[i];
        choose_index(&out[i], c, f, row % f->count);
        row /= f->count;
    }
}

/* Returns the root of x^(dimensions + 1) = x + 1 (the generalised golden ratio) by Newton's method.
 * These are plain operations, with the same result everywhere. */
static double golden(size_t dimensions)
{
    double x = 1.5;
    for (unsigned i = 0; i < 64; i++) {
        double power = 1;
        for (size_t k = 0; k < dimensions; k++)
            power *= x;
        x -= (power * x - x - 1) / ((double)(dimensions + 1) * power - 1);
    }
    return x;
}

/* The additive recurrence of Roberts: factor i goes on by golden^-(i + 1) from row to row. */
static void choose_low_discrepancy(choice *out, const campaign *c, uint64_t row)
{
    const double ratio = golden(c->factor_count);
    double part = 1;
    for (size_t i = 0; i < c->factor_count; i++) {
        const factor *f = &c->factors[i];
        part /= ratio;
        const uint64_t step = (uint64_t)(part * 0x1p63) << 1 | 1;
        choose_at(&out[i], f, cw_random(c->seed, f->name, 0) + (row + 1) * step);
    }
}

void sample_choose(choice out[CAMPAIGN_FACTORS_MAX], const campaign *c, uint64_t row)
{
    if (c->sample == SAMPLE_FULL) {
        choose_full(out, c, row);
        return;
    }
    if (c->sample == SAMPLE_LOW_DISCREPANCY) {
        choose_low_discrepancy(out, c, row);
        return;
    }
    for (size_t i = 0; i < c->factor_count; i++) {
        const factor *f = &c->factors[i];
        if (c->sample == SAMPLE_PAIRWISE)
            choose_index(&out[i], c, f, c->pairs[row * c->factor_count + i]);
        else
            choose_at(&out[i], f, cw_random(c->seed, f->name, row));
    }
}

/* ---- Values ---------------------------------------------------------------------------------- */

/* Rounds to whole steps. */
static int64_t round_to(double value, int64_t step)
{
    return (int64_t)floor(value / (double)step + 0.5) * step;
}

/* Makes a value of 64 random bits. The middle of each step of 2^-53 is taken, since quantiles of 0
 * and 1 are infinite. */
static int64_t drawn_mantissa(const factor *f, uint64_t drawn)
{
    const double part = ((double)(drawn >> 11) + 0.5) * 0x1p-53;
    const double from = (double)f->from.mantissa;
    const double to = (double)f->to.mantissa;
    if (f->kind == FACTOR_NORMAL)
        return round_to(from + to * normal_quantile(part), f->step.mantissa);
    const int64_t steps = (f->to.mantissa - f->from.mantissa) / f->step.mantissa + 1;
    return f->from.mantissa + (int64_t)scale(drawn, (uint64_t)steps) * f->step.mantissa;
}

const char *sample_text(char out[NUMBER_TEXT_MAX], const factor *f, const choice *chosen)
{
    number_text n = f->from;
    if (f->kind == FACTOR_LIST)
        return f->texts[chosen->index];
    if (f->kind == FACTOR_RANGE)
        n.mantissa += (int64_t)chosen->index * f->step.mantissa;
    else
        n.mantissa = drawn_mantissa(f, chosen->drawn);
    number_text_print(out, &n);
    return out;
}

void sample_value(buffer *out, const factor *f, const choice *chosen)
{
    char text[NUMBER_TEXT_MAX];
    buffer_put(out, sample_text(text, f, chosen));
}
