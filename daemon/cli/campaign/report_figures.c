/* SPDX-License-Identifier: MIT
 *
 * report_figures.c - the figures of a report: heat maps and plots.
 */
#include "cli/campaign/report_pairs.h"

#include "base/text/counted.h"
#include "base/text/decimal.h"
#include "base/text/xmltext.h"

#include <inttypes.h>
#include <math.h>
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

static int report_figures_compare(const void *left, const void *right)
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
    qsort(a->values, a->count, sizeof a->values[0], report_figures_compare);
    free(list);
}

/* ---- Cells ----------------------------------------------------------------------------------- */

static char *report_figures_name_of(const heat_map *h, uint32_t row, uint32_t column)
{
    return report_pair_values(h->view->report, h->i, h->k, h->turned ? column : row,
                              h->turned ? row : column);
}

static const class_counts *counts_of(const heat_map *h, uint32_t row, uint32_t column)
{
    return h->turned ? crosstab_find(h->table, column, row) : crosstab_find(h->table, row, column);
}

/* Finds the highest share of the cells that are shown: it gets the darkest ground. */
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

/* Writes a cell that has rows. Its ground and its number say the share, its title the counts. */
static void report_figures_write_counts(FILE *out, const heat_map *h, const char *name,
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

/* Writes a cell: its counts, or that no row has both values. */
static void write_cell(FILE *out, const heat_map *h, uint32_t row, uint32_t column)
{
    const class_counts *c = counts_of(h, row, column);
    char *name = report_figures_name_of(h, row, column);
    if (c)
        report_figures_write_counts(out, h, name, c);
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

/* Writes the row of titles: both factors, and the values of the second one. */
static void report_figures_write_head(FILE *out, const heat_map *h)
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

/* Says how many values there would be, where not all are shown. */
static void write_left_off(FILE *out, const axis *a)
{
    if (a->count == a->all)
        return;
    fprintf(out, "<p>The %zu worst of %zu values of ", a->count, a->all);
    xml_text(out, a->factor->name);
    fputs(".</p>\n", out);
}

/* Writes the table of one pair of factors, and below it the values that it leaves out. */
static void write_map(FILE *out, const heat_map *h)
{
    char *name = report_pair_name(h->view->report, h->i, h->k);
    const uint64_t other = class_counts_all(&h->table->other);
    fputs("<h3>", out);
    xml_text(out, name);
    fputs("</h3>\n<div class=\"map\"><table>\n", out);
    report_figures_write_head(out, h);
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

/* Draws the map of two factors. The one with more values has the rows, as a page is longer than
 * wide. */
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

/* ---- Plots ----------------------------------------------------------------------------------- */

#define LABEL 240.0 /* pixels of names, left of the bars */
#define WIDTH 480.0 /* of a whole bar */
#define ROW 20.0
#define BAR 14.0
#define VALUES_DRAWN 40u
#define BINS 96u /* of latencies: four for each power of two */
#define BINS_A_POWER 4.0
#define HEIGHT 160.0

static const char *const colours[CLASS_RATED] = {
    [CLASS_NO_EFFECT] = "#9bc19b", [CLASS_CORRECTED] = "#4d9a6a", [CLASS_DEGRADED] = "#e0b040",
    [CLASS_DETECTED] = "#d9763a",  [CLASS_UNDETECTED] = "#b02020", [CLASS_TIMEOUT] = "#606060",
};

static void report_plot_begin(FILE *out, double height, const char *title)
{
    fprintf(out, "<svg role=\"img\" width=\"%.0f\" height=\"%.0f\"><title>%s</title>\n",
            LABEL + WIDTH + 20, height, title);
}

static void write_bar(FILE *out, double x, double y, double width, const char *colour)
{
    fprintf(out, "<rect x=\"%.2f\" y=\"%.1f\" width=\"%.2f\" height=\"%.0f\" fill=\"%s\"/>\n", x,
            y, width, BAR, colour);
}

static void write_label(FILE *out, double x, double y, const char *anchor, const char *text)
{
    fprintf(out, "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">", x, y, anchor);
    xml_text(out, text);
    fputs("</text>\n", out);
}

static void write_line(FILE *out, double x1, double y1, double x2, double y2)
{
    fprintf(out, "<line x1=\"%.2f\" y1=\"%.1f\" x2=\"%.2f\" y2=\"%.1f\" stroke=\"#222\"/>\n", x1,
            y1, x2, y2);
}

void plot_shares(FILE *out, const report_view *v)
{
    report_plot_begin(out, ROW * CLASS_RATED, "the share of each class, with its interval");
    for (unsigned i = 0; i < CLASS_RATED; i++) {
        const share s = report_class_share(v, &v->report->classes, (row_class)i);
        const double y = ROW * i;
        write_label(out, LABEL - 8, y + BAR - 2, "end", class_name((row_class)i));
        write_bar(out, LABEL, y, WIDTH * s.value, colours[i]);
        write_line(out, LABEL + WIDTH * s.low, y + BAR / 2, LABEL + WIDTH * s.high, y + BAR / 2);
    }
    fputs("</svg>\n", out);
}

/* ---- Values ---------------------------------------------------------------------------------- */

/* Draws one value as a bar, whose parts are the shares of the classes. */
static void plot_value(FILE *out, const dimension_value *value, double y)
{
    const double rated = (double)class_counts_rated(&value->rows);
    double x = LABEL;
    write_label(out, LABEL - 8, y + BAR - 2, "end", value->text);
    for (unsigned i = 0; i < CLASS_RATED && rated > 0; i++) {
        const double width = WIDTH * (double)value->rows.of[i] / rated;
        if (width > 0)
            write_bar(out, x, y, width, colours[i]);
        x += width;
    }
}

/* Writes the colour of each class that the plots have. */
static void write_legend(FILE *out)
{
    fputs("<p>", out);
    for (unsigned i = 0; i < CLASS_RATED; i++)
        fprintf(out, "<span style=\"color: %s\">&#9632;</span> %s ", colours[i],
                class_name((row_class)i));
    fputs("</p>\n", out);
}

void plot_values(FILE *out, const dimension *d, const uint32_t *list, size_t count)
{
    const size_t shown = count < VALUES_DRAWN ? count : VALUES_DRAWN;
    write_legend(out);
    report_plot_begin(out, ROW * (double)shown, "the classes of each value");
    for (size_t i = 0; i < shown; i++)
        plot_value(out, &d->values[list[i]], ROW * (double)i);
    fputs("</svg>\n", out);
    if (count > shown)
        fprintf(out, "<p>The %zu worst of %zu values.</p>\n", shown, count);
}

/* ---- Latencies ------------------------------------------------------------------------------- */

/* Returns the bin of a latency, which may lie before the first or behind the last one. */
static double report_plot_place_of(uint64_t ns, double first)
{
    return (ns > 0 ? log2((double)ns) * BINS_A_POWER : 0) - first;
}

/* Adds the classes of latency up for the columns of the plot; the first and last one take what lies
 * outside. Returns the highest column. */
static uint64_t fill_bins(uint64_t bins[BINS], const latency *l, double first)
{
    uint64_t most = 1;
    for (unsigned i = 0; i < LATENCY_CLASSES; i++) {
        const double at = report_plot_place_of(latency_class_end(i), first);
        const unsigned bin = at < 0 ? 0 : at >= BINS ? BINS - 1 : (unsigned)at;
        if (l->classes[i] == 0)
            continue;
        bins[bin] += l->classes[i];
        most = bins[bin] > most ? bins[bin] : most;
    }
    return most;
}

static void write_time(FILE *out, double x, uint64_t ns, const char *anchor, double y)
{
    char text[DECIMAL_TEXT_MAX + 4];
    (void)snprintf(text, sizeof text, "%s ms", decimal(ns, 6).text);
    write_label(out, x, y, anchor, text);
}

/* Draws the limit, where there is one on the axis. */
static void write_limit(FILE *out, const latency *l, double first, double step)
{
    const double at = report_plot_place_of(l->limit_ns, first);
    if (!l->has_limit || at < 0 || at > BINS)
        return;
    write_line(out, at * step, 0, at * step, HEIGHT);
    write_time(out, at * step + 4, l->limit_ns, "start", 12);
}

void plot_latency(FILE *out, const latency *l)
{
    uint64_t bins[BINS] = {0};
    const double width = LABEL + WIDTH;
    const double first = floor(report_plot_place_of(l->min_ns, 0));
    const double last = floor(report_plot_place_of(l->max_ns, first)) + 1;
    const double step = width / (last < BINS ? last : BINS);
    const uint64_t most = fill_bins(bins, l, first);
    report_plot_begin(out, HEIGHT + 20, "the distribution of latencies, over a logarithmic axis");
    for (unsigned i = 0; i < BINS; i++) {
        const double height = (HEIGHT - 20) * (double)bins[i] / (double)most;
        if (bins[i] > 0)
            fprintf(out, "<rect x=\"%.2f\" y=\"%.2f\" width=\"%.2f\" height=\"%.2f\" "
                    "fill=\"#4d7a9a\"><title>%s</title></rect>\n", i * step,
                    HEIGHT - height, step - 1, height, counted(bins[i], "row").text);
    }
    write_limit(out, l, first, step);
    write_time(out, 0, l->min_ns, "start", HEIGHT + 15);
    write_time(out, width, l->max_ns, "end", HEIGHT + 15);
    fputs("</svg>\n", out);
}
