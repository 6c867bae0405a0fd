/* SPDX-License-Identifier: MIT
 *
 * report_plot.c - the plots of a report, as SVG within HTML.
 */
#include "cli/campaign/report_plot.h"

#include "base/text/counted.h"
#include "base/text/decimal.h"
#include "base/text/xmltext.h"

#include <inttypes.h>
#include <math.h>

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

static void write_value(FILE *out, const dimension_value *value, double y)
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
        write_value(out, &d->values[list[i]], ROW * (double)i);
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
