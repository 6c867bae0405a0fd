/* SPDX-License-Identifier: MIT
 *
 * report_map.c - the heat maps of a report: how much has failed for each pair of values.
 */
#include "cli/campaign/report_map.h"

#include "base/text/counted.h"
#include "base/text/xmltext.h"

#include <inttypes.h>
#include <stdlib.h>

#define MAPS_MAX 50u
#define ROWS_MAX 40u
#define COLUMNS_MAX 16u
#define DARKEST 0.6 /* opacity; black text stays readable */

/* The values of a factor along one side, in the order of the campaign. */
typedef struct axis {
    const dimension *factor;
    uint32_t values[ROWS_MAX];
    size_t count;
    size_t all; /* values that rows have */
} axis;

/* The factor with more values has the rows. */
typedef struct heat_map {
    const report_view *view;
    const pair_measure *measure;
    const crosstab *table;
    size_t i; /* the factors, i < k */
    size_t k;
    axis rows;
    axis columns;
    bool turned; /* factor k has the rows */
    double highest; /* share of a cell that is shown */
} heat_map;

/* ---- Which values ---------------------------------------------------------------------------- */

static int report_map_compare(const void *left, const void *right)
{
    const uint32_t a = *(const uint32_t *)left;
    const uint32_t b = *(const uint32_t *)right;
    return a < b ? -1 : a > b;
}

/* Takes the worst values, as many as there is room for. */
static void fill_axis(axis *a, const dimension *d, size_t limit)
{
    uint32_t *list = report_worst_values(&a->all, d);
    a->factor = d;
    a->count = a->all < limit ? a->all : limit;
    for (size_t i = 0; i < a->count; i++)
        a->values[i] = list[i];
    qsort(a->values, a->count, sizeof a->values[0], report_map_compare);
    free(list);
}

/* ---- Cells ----------------------------------------------------------------------------------- */

static char *report_map_name_of(const heat_map *h, uint32_t row, uint32_t column)
{
    return report_pair_values(h->view->report, h->i, h->k, h->turned ? column : row,
                              h->turned ? row : column);
}

static const class_counts *counts_of(const heat_map *h, uint32_t row, uint32_t column)
{
    return h->turned ? crosstab_find(h->table, column, row) : crosstab_find(h->table, row, column);
}

static void find_highest(heat_map *h)
{
    h->highest = 0;
    for (size_t i = 0; i < h->rows.count; i++) {
        for (size_t k = 0; k < h->columns.count; k++) {
            const class_counts *c = counts_of(h, h->rows.values[i], h->columns.values[k]);
            const uint64_t rated = c ? class_counts_rated(c) : 0;
            const double value = rated > 0 ? (double)h->measure->count(c) / (double)rated : 0;
            h->highest = value > h->highest ? value : h->highest;
        }
    }
}

/* Writes percent in few characters. Only no row at all makes a 0. */
static void write_percent(FILE *out, double value)
{
    if (value > 0 && value < 0.0005)
        fputs("&lt;0.1", out);
    else
        fprintf(out, value > 0 && value < 1 ? "%.1f" : "%.0f", 100 * value);
}

/* Writes the attribute `title`. */
static void write_title(FILE *out, const heat_map *h, const char *name, const class_counts *c)
{
    char text[REPORT_PERCENT_BYTES];
    report_print_share(text, report_measure_share(h->view, h->measure, c));
    fputs(" title=\"", out);
    xml_value(out, name);
    fprintf(out, ": %s; %s %" PRIu64 ", %s", counted(class_counts_all(c), "row").text,
            h->measure->name, h->measure->count(c), text);
    for (unsigned i = 0; i < CLASS_COUNT; i++)
        if (c->of[i] > 0)
            fprintf(out, "; %s %" PRIu64, class_name((row_class)i), c->of[i]);
    fputs("\">", out);
}

static void report_map_write_counts(FILE *out, const heat_map *h, const char *name,
                                    const class_counts *c)
{
    const uint64_t rated = class_counts_rated(c);
    const double value = rated > 0 ? (double)h->measure->count(c) / (double)rated : 0;
    fputs("<td", out);
    if (value > 0)
        fprintf(out, " style=\"background: rgba(176, 32, 32, %.2f)\"",
                DARKEST * value / h->highest);
    write_title(out, h, name, c);
    if (rated > 0)
        write_percent(out, value);
    else
        fputs("&ndash;", out);
    fputs("</td>", out);
}

/* Writes a cell without rows, or with rows that are not told apart from others. */
static void write_empty(FILE *out, const heat_map *h, const char *name)
{
    const bool unknown = class_counts_all(&h->table->other) > 0;
    fputs("<td title=\"", out);
    xml_value(out, name);
    fprintf(out, ": %s\">%s</td>", unknown ? "not told apart" : "no row", unknown ? "?" : "");
}

static void write_cell(FILE *out, const heat_map *h, uint32_t row, uint32_t column)
{
    const class_counts *c = counts_of(h, row, column);
    char *name = report_map_name_of(h, row, column);
    if (c)
        report_map_write_counts(out, h, name, c);
    else
        write_empty(out, h, name);
    free(name);
}

/* ---- Maps ------------------------------------------------------------------------------------ */

static void write_value(FILE *out, const axis *a, size_t i, const char *scope)
{
    fprintf(out, "<th scope=\"%s\">", scope);
    xml_text(out, a->factor->values[a->values[i]].text);
    fputs("</th>", out);
}

static void report_map_write_head(FILE *out, const heat_map *h)
{
    fputs("<tr><th>", out);
    xml_text(out, h->rows.factor->name);
    fputs(" \\ ", out);
    xml_text(out, h->columns.factor->name);
    fputs("</th>", out);
    for (size_t k = 0; k < h->columns.count; k++)
        write_value(out, &h->columns, k, "col");
    fputs("</tr>\n", out);
}

static void write_left_off(FILE *out, const axis *a)
{
    if (a->count == a->all)
        return;
    fprintf(out, "<p>The %zu worst of %zu values of ", a->count, a->all);
    xml_text(out, a->factor->name);
    fputs(".</p>\n", out);
}

static void write_map(FILE *out, const heat_map *h)
{
    char *name = report_pair_name(h->view->report, h->i, h->k);
    const uint64_t other = class_counts_all(&h->table->other);
    fputs("<h3>", out);
    xml_text(out, name);
    fputs("</h3>\n<div class=\"map\"><table>\n", out);
    report_map_write_head(out, h);
    for (size_t i = 0; i < h->rows.count; i++) {
        fputs("<tr>", out);
        write_value(out, &h->rows, i, "row");
        for (size_t k = 0; k < h->columns.count; k++)
            write_cell(out, h, h->rows.values[i], h->columns.values[k]);
        fputs("</tr>\n", out);
    }
    fputs("</table></div>\n", out);
    write_left_off(out, &h->rows);
    write_left_off(out, &h->columns);
    if (other > 0)
        fprintf(out, "<p>%s %s further pairs of values, which are not told apart.</p>\n",
                counted(other, "row").text, other == 1 ? "has" : "have");
    free(name);
}

static void map_pair(FILE *out, const report_view *v, const pair_measure *m, size_t i, size_t k)
{
    const report *r = v->report;
    heat_map h = {.view = v, .measure = m, .i = i, .k = k,
                  .table = &pairs_of(&r->pairs, i, k)->classes,
                  .turned = dimension_seen(&r->factors[k]) > dimension_seen(&r->factors[i])};
    fill_axis(&h.rows, &r->factors[h.turned ? k : i], ROWS_MAX);
    fill_axis(&h.columns, &r->factors[h.turned ? i : k], COLUMNS_MAX);
    find_highest(&h);
    write_map(out, &h);
}

void map_pairs(FILE *out, const report_view *v, const pair_measure *m)
{
    const report *r = v->report;
    size_t shown = 0;
    for (size_t i = 0; i < r->factor_count; i++)
        for (size_t k = i + 1; k < r->factor_count; k++)
            if (report_pair_tells(r, i, k) && shown++ < MAPS_MAX)
                map_pair(out, v, m, i, k);
    if (shown > MAPS_MAX)
        fprintf(out, "<p>and %zu further pairs of factors</p>\n", shown - MAPS_MAX);
}
