/* SPDX-License-Identifier: MIT
 *
 * pairwise.c - rows that have each pair of values of each two factors at least once.
 *
 * Rows are made one after the other. A row begins with the first pair that no row has. The other
 * factors, in their order, get the value with the most pairs that no row has.
 */
#include "campaign/space/pairwise.h"

#include <stdlib.h>
#include <string.h>

#define UNSET UINT32_MAX

typedef struct search {
    campaign *c;
    size_t factors;
    size_t first[CAMPAIGN_FACTORS_MAX + 1]; /* number of the first value of each factor */
    size_t values;
    bool *seen; /* of each two values */
    size_t from; /* all pairs before it are seen */
    size_t room; /* rows in c->pairs */
} search;

static bool *pair(const search *s, size_t a, size_t b)
{
    return &s->seen[a < b ? a * s->values + b : b * s->values + a];
}

/* Returns the number of new pairs that a value makes with those that a row has. */
static unsigned gain(const search *s, const uint32_t *row, size_t f, uint32_t value)
{
    unsigned count = 0;
    for (size_t other = 0; other < s->factors; other++)
        if (other != f && row[other] != UNSET)
            count += !*pair(s, s->first[f] + value, s->first[other] + row[other]);
    return count;
}

/* Returns the value that makes the most new pairs; the lowest of several, so that rows are
 * repeatable. */
static uint32_t best_value(const search *s, const uint32_t *row, size_t f)
{
    uint32_t best = 0;
    unsigned most = 0;
    for (uint32_t value = 0; value < s->c->factors[f].count; value++) {
        const unsigned count = gain(s, row, f, value);
        if (count > most) {
            most = count;
            best = value;
        }
    }
    return best;
}

/* Values of all factors are numbered consecutively. Returns the factor of this one. */
static size_t factor_of(const search *s, size_t value)
{
    size_t f = 0;
    while (value >= s->first[f + 1])
        f++;
    return f;
}

/* Begins a row with the first pair that is not seen. Returns false when there is none. */
static bool begin_row(search *s, uint32_t *row)
{
    for (; s->from < s->values * s->values; s->from++) {
        const size_t a = s->from / s->values;
        const size_t b = s->from % s->values;
        const size_t fa = factor_of(s, a);
        const size_t fb = factor_of(s, b);
        if (fa >= fb || s->seen[s->from])
            continue;
        for (size_t f = 0; f < s->factors; f++)
            row[f] = UNSET;
        row[fa] = (uint32_t)(a - s->first[fa]);
        row[fb] = (uint32_t)(b - s->first[fb]);
        return true;
    }
    return false;
}

/* Gives values to the other factors in their order, and marks all pairs of the row as seen. */
static void finish_row(const search *s, uint32_t *row)
{
    for (size_t f = 0; f < s->factors; f++)
        if (row[f] == UNSET)
            row[f] = best_value(s, row, f);
    for (size_t a = 0; a < s->factors; a++)
        for (size_t b = a + 1; b < s->factors; b++)
            *pair(s, s->first[a] + row[a], s->first[b] + row[b]) = true;
}

/* Returns memory for one more row, whose values are not set; NULL: there is none. */
static uint32_t *next_row(search *s)
{
    campaign *c = s->c;
    if (c->rows == s->room) {
        const size_t room = s->room > 0 ? 2 * s->room : 64;
        uint32_t *pairs = realloc(c->pairs, room * s->factors * sizeof *pairs);
        if (!pairs)
            return NULL;
        c->pairs = pairs;
        s->room = room;
    }
    return &c->pairs[c->rows * s->factors];
}

/* Makes rows until all pairs are seen. Returns NULL, or the reason why it could not. */
static const char *search_rows(search *s)
{
    for (;;) {
        uint32_t *row = next_row(s);
        if (!row)
            return "out of memory";
        if (!begin_row(s, row))
            return NULL;
        finish_row(s, row);
        s->c->rows++;
    }
}

/* One factor has no pairs: each value is a row. */
static const char *rows_of_one(search *s)
{
    for (uint32_t i = 0; i < s->c->factors[0].count; i++) {
        uint32_t *row = next_row(s);
        if (!row)
            return "out of memory";
        *row = i;
        s->c->rows++;
    }
    return NULL;
}

const char *pairwise_prepare(campaign *c)
{
    search s = {.c = c, .factors = c->factor_count};
    for (size_t i = 0; i < s.factors; i++) {
        s.first[i] = s.values;
        if (c->factors[i].count > PAIRWISE_PAIRS_MAX)
            return "pairwise is for factors with few values";
        s.values += (size_t)c->factors[i].count;
    }
    s.first[s.factors] = s.values;
    if ((uint64_t)s.values * s.values > PAIRWISE_PAIRS_MAX)
        return "pairwise is for factors with up to 2000 values together";
    if (s.factors < 2)
        return rows_of_one(&s);
    s.seen = calloc(s.values * s.values, sizeof *s.seen);
    const char *wrong = s.seen ? search_rows(&s) : "out of memory";
    free(s.seen);
    return wrong;
}
