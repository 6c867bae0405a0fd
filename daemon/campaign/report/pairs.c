/* SPDX-License-Identifier: MIT
 *
 * pairs.c - which values of two factors have met in a row, and the classes of these rows.
 */
#include "campaign/report/pairs.h"

#include "campaign/report/memory.h"

#include <stdlib.h>
#include <string.h>

#define ROW_BYTES (PAIRS_VALUES_MAX / 8u)

static size_t pairs_place_of(const pairs *p, size_t i, size_t k)
{
    return i * p->factors + k;
}

void pairs_begin(pairs *p, size_t factors)
{
    *p = (pairs){.factors = factors, .list = memory_list(NULL, factors * factors,
                                                         sizeof *p->list)};
    p->share = factors > 1 ? PAIRS_CELLS_EACH / (factors * (factors - 1) / 2) : 0;
    for (size_t i = 0; i < factors * factors; i++)
        p->list[i] = NULL;
    for (size_t i = 0; i < factors; i++) {
        for (size_t k = i + 1; k < factors; k++) {
            pair_cover *c = memory_list(NULL, 1, sizeof *c);
            memset(c, 0, sizeof *c);
            p->list[pairs_place_of(p, i, k)] = c;
        }
    }
}

/* ---- Which have met -------------------------------------------------------------------------- */

/* Returns the bits for a value of the first factor, or NULL when they are too many. */
static uint64_t *bits_of(pairs *p, pair_cover *c, uint32_t value)
{
    if (!c->rows[value] && p->bytes + ROW_BYTES <= PAIRS_BYTES_MAX) {
        c->rows[value] = memory_list(NULL, 1, ROW_BYTES);
        memset(c->rows[value], 0, ROW_BYTES);
        p->bytes += ROW_BYTES;
    }
    return c->rows[value];
}

/* Notes that rows have this pair of values. Beyond the limits a pair of factors is no longer
 * counted. */
static void add_met(pairs *p, pair_cover *c, uint32_t first, uint32_t second)
{
    const bool small = first < PAIRS_VALUES_MAX && second < PAIRS_VALUES_MAX;
    uint64_t *bits = small && !c->over ? bits_of(p, c, first) : NULL;
    if (!bits) {
        c->over = true;
        return;
    }
    const uint64_t bit = UINT64_C(1) << (second % 64);
    c->met += (bits[second / 64] & bit) == 0;
    bits[second / 64] |= bit;
}

/* ---- Their classes --------------------------------------------------------------------------- */

/* Returns true when one more pair of values is told apart, which then counts. */
static bool take_cell(pairs *p, const crosstab *t)
{
    const bool own = t->count < p->share;
    if (t->count >= PAIRS_CELLS_MAX || (!own && p->more >= PAIRS_CELLS_MORE))
        return false;
    p->more += own ? 0 : 1;
    return true;
}

/* Counts a row by the class it has, for its pair of values. Those without room are one cell. */
static void add_class(pairs *p, crosstab *t, uint32_t first, uint32_t second, row_class class)
{
    const bool known = first != DIMENSION_OTHER && second != DIMENSION_OTHER;
    class_counts *rows = known ? crosstab_find(t, first, second) : &t->other;
    if (!rows)
        rows = take_cell(p, t) ? crosstab_add(t, first, second) : &t->other;
    rows->of[class]++;
}

/* ---- Pairs ----------------------------------------------------------------------------------- */

void pairs_add(pairs *p, const uint32_t values[CAMPAIGN_FACTORS_MAX], row_class class)
{
    for (size_t i = 0; i < p->factors; i++) {
        for (size_t k = i + 1; k < p->factors; k++) {
            pair_cover *c = p->list[pairs_place_of(p, i, k)];
            add_met(p, c, values[i], values[k]);
            add_class(p, &c->classes, values[i], values[k], class);
        }
    }
}

const pair_cover *pairs_of(const pairs *p, size_t i, size_t k)
{
    return p->list[pairs_place_of(p, i, k)];
}

void pairs_free(pairs *p)
{
    for (size_t i = 0; i < p->factors * p->factors; i++) {
        for (size_t v = 0; p->list[i] && v < PAIRS_VALUES_MAX; v++)
            free(p->list[i]->rows[v]);
        if (p->list[i])
            crosstab_free(&p->list[i]->classes);
        free(p->list[i]);
    }
    free(p->list);
    *p = (pairs){.factors = 0};
}
