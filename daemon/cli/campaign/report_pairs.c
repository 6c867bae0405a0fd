/* SPDX-License-Identifier: MIT
 *
 * report_pairs.c - which pairs of values of two factors are the worst ones.
 */
#include "cli/campaign/report_pairs.h"

#include "campaign/report/memory.h"

#include <stdlib.h>
#include <string.h>

/* ---- The measure ----------------------------------------------------------------------------- */

static uint64_t count_timeouts(const class_counts *c)
{
    return c->of[CLASS_TIMEOUT];
}

static uint64_t count_degraded(const class_counts *c)
{
    return c->of[CLASS_DEGRADED];
}

const pair_measure *report_pair_measure(const report *r)
{
    static const pair_measure measures[] = {
        {"failed", class_counts_failed}, {"time-out", count_timeouts}, {"degraded", count_degraded},
    };
    for (size_t i = 0; i < sizeof measures / sizeof measures[0]; i++)
        if (measures[i].count(&r->classes) > 0)
            return &measures[i];
    return NULL;
}

share report_measure_share(const report_view *v, const pair_measure *m, const class_counts *c)
{
    return share_of(m->count(c), class_counts_rated(c), v->confidence);
}

/* ---- The worst ones -------------------------------------------------------------------------- */

bool report_pair_tells(const report *r, size_t i, size_t k)
{
    return dimension_seen(&r->factors[i]) > 1 && dimension_seen(&r->factors[k]) > 1;
}

/* Equal ones stay in the order of factors and values, but more rows say more. */
static bool is_worse(const worst_pair *a, const worst_pair *b)
{
    if (a->share.low > b->share.low || a->share.low < b->share.low)
        return a->share.low > b->share.low;
    return class_counts_rated(&a->cell->rows) > class_counts_rated(&b->cell->rows);
}

/* Puts a pair into the list at its place. */
static void report_pairs_insert(worst_pair list[REPORT_PAIRS_WORST], size_t *count,
                                const worst_pair *new)
{
    size_t at = *count;
    while (at > 0 && is_worse(new, &list[at - 1]))
        at--;
    if (at == REPORT_PAIRS_WORST)
        return;
    const size_t behind = *count - at - (*count == REPORT_PAIRS_WORST);
    memmove(&list[at + 1], &list[at], behind * sizeof *list);
    list[at] = *new;
    *count += *count < REPORT_PAIRS_WORST;
}

/* An interval costs much more than this. Its lower limit is not higher than the share. Nor is it
 * higher than that of another one with at least this share and so many rows. */
static bool may_be_worse(const class_counts *c, const pair_measure *m, const worst_pair *other)
{
    const double count = (double)m->count(c);
    const double rated = (double)class_counts_rated(c);
    const double other_count = (double)m->count(&other->cell->rows);
    const double other_rated = (double)class_counts_rated(&other->cell->rows);
    return count > other->share.low * rated * (1 - 1e-9) &&
           (rated > other_rated || count * other_rated > other_count * rated);
}

/* Considers all pairs of values of two factors for the list of the worst ones. */
static void look_at(worst_pair list[REPORT_PAIRS_WORST], size_t *count, const report_view *v,
                    const pair_measure *m, size_t i, size_t k)
{
    const crosstab *t = &pairs_of(&v->report->pairs, i, k)->classes;
    const crosstab_cell **cells = crosstab_sorted(t);
    for (size_t n = 0; n < t->count; n++) {
        const class_counts *c = &cells[n]->rows;
        const bool full = *count == REPORT_PAIRS_WORST;
        if (m->count(c) == 0 || (full && !may_be_worse(c, m, &list[REPORT_PAIRS_WORST - 1])))
            continue;
        report_pairs_insert(
            list, count,
            &(worst_pair){
                .i = i, .k = k, .cell = cells[n], .share = report_measure_share(v, m, c)});
    }
    free(cells);
}

size_t report_worst_pairs(worst_pair out[REPORT_PAIRS_WORST], const report_view *v,
                          const pair_measure *m)
{
    const report *r = v->report;
    size_t count = 0;
    for (size_t i = 0; i < r->factor_count; i++)
        for (size_t k = i + 1; k < r->factor_count; k++)
            if (report_pair_tells(r, i, k))
                look_at(out, &count, v, m, i, k);
    return count;
}

/* ---- Names and limits ------------------------------------------------------------------------ */

char *report_pair_values(const report *r, size_t i, size_t k, uint32_t first, uint32_t second)
{
    const dimension *a = &r->factors[i];
    const dimension *b = &r->factors[k];
    return memory_print("%s %s, %s %s", a->name, a->values[first].text, b->name,
                        b->values[second].text);
}

size_t report_pairs_cut(const report *r)
{
    size_t count = 0;
    for (size_t i = 0; i < r->factor_count; i++)
        for (size_t k = i + 1; k < r->factor_count; k++)
            count += class_counts_all(&pairs_of(&r->pairs, i, k)->classes.other) > 0;
    return count;
}
