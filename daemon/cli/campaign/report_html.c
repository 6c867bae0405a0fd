/* SPDX-License-Identifier: MIT
 *
 * report_html.c - a report as a page of HTML that needs no other file and no script.
 *
 * It is here and not in the Python package, since a rig or a CI machine with the tool alone gets
 * the page, too. The numbers are those of report_view.c; the page adds less than a template would.
 */
#include "base/text/counted.h"
#include "cli/campaign/report_view.h"

#include "base/text/decimal.h"
#include "base/text/xmltext.h"
#include "cli/campaign/report_pairs.h"

#include <inttypes.h>
#include <stdlib.h>

#define VALUES_SHOWN 500u

static const char style[] =
    "<style>\n"
    "body { font: 15px/1.5 system-ui, sans-serif; max-width: 70em; margin: 2em auto;"
    " padding: 0 1em; color: #222; }\n"
    "table { border-collapse: collapse; margin: 1em 0; }\n"
    "th, td { padding: .2em .8em; text-align: right; border-bottom: 1px solid #ddd;"
    " font-variant-numeric: tabular-nums; }\n"
    "th:first-child, td:first-child { text-align: left; }\n"
    "pre { background: #f5f5f5; padding: .8em; overflow-x: auto; }\n"
    ".map { overflow-x: auto; }\n"
    ".map th, .map td { padding: .2em .4em; max-width: 12em; overflow-wrap: anywhere; }\n"
    "svg text { font: 12px system-ui, sans-serif; }\n"
    "</style>\n";

static void write_cell(FILE *out, const char *text)
{
    fputs("<td>", out);
    xml_text(out, text);
    fputs("</td>", out);
}

static void write_share(FILE *out, share s)
{
    char text[REPORT_PERCENT_BYTES];
    report_print_share(text, s);
    write_cell(out, text);
}

/* ---- Classes --------------------------------------------------------------------------------- */

/* Writes title and style, how many rows there are or are missing, and remarks on their meaning. */
static void report_html_write_head(FILE *out, const report_view *v)
{
    const report *r = v->report;
    char *missing = report_missing_text(r);
    fputs("<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>", out);
    xml_text(out, r->source.file);
    fprintf(out, "</title>\n%s</head>\n<body>\n<h1>", style);
    xml_text(out, r->source.file);
    fprintf(out, "</h1>\n<p>%s, %s.",
            counted(r->rows, r->source.is_campaign ? "row" : "seed").text,
            counted(r->factor_count, "factor").text);
    if (missing) {
        fputs(" <strong>", out);
        xml_text(out, missing);
        fputs("</strong>", out);
    }
    fputs("</p>\n", out);
    free(missing);
    for (size_t i = 0; report_remarks[i]; i++)
        fprintf(out, "<p>%s</p>\n", report_remarks[i]);
}

/* Classes without a rate follow the others: they say nothing about the system under test. */
static void write_classes(FILE *out, const report_view *v)
{
    const class_counts *c = &v->report->classes;
    fprintf(out, "<h2>Classes</h2>\n<table>\n<tr><th>class</th><th>rows</th>"
            "<th>share (interval of %g %%)</th></tr>\n", 100 * v->confidence);
    for (unsigned i = 0; i < CLASS_RATED; i++) {
        fprintf(out, "<tr><td>%s</td><td>%" PRIu64 "</td>", class_name((row_class)i), c->of[i]);
        write_share(out, report_class_share(v, c, (row_class)i));
        fputs("</tr>\n", out);
    }
    for (unsigned i = CLASS_RATED; i < CLASS_COUNT; i++)
        fprintf(out, "<tr><td>%s</td><td>%" PRIu64 "</td><td>without a rate</td></tr>\n",
                class_name((row_class)i), c->of[i]);
    fputs("</table>\n", out);
    plot_shares(out, v);
    fprintf(out, "<p>Of %" PRIu64 " that failed, %" PRIu64 " were detected.</p>\n",
            class_counts_failed(c), c->of[CLASS_DETECTED]);
}

/* ---- Latency --------------------------------------------------------------------------------- */

static void write_ms(FILE *out, const char *name, uint64_t ns)
{
    fprintf(out, "<tr><td>%s</td><td>%s ms</td></tr>\n", name, decimal(ns, 6).text);
}

/* Writes the distribution of latencies, and the share within the limit when there is one. */
static void write_latency(FILE *out, const report_view *v)
{
    const latency *l = &v->report->latency;
    fprintf(out, "<h2>Detection latency</h2>\n<p>From the first hit of a fault to the first error:"
            " %s.</p>\n", counted(l->rows, "row").text);
    if (l->rows == 0)
        return;
    fputs("<table>\n", out);
    write_ms(out, "minimum", l->min_ns);
    write_ms(out, "median", latency_percentile(l, 500));
    write_ms(out, "95 %", latency_percentile(l, 950));
    write_ms(out, "99 %", latency_percentile(l, 990));
    write_ms(out, "maximum", l->max_ns);
    if (l->has_limit) {
        fprintf(out, "<tr><td>within %s ms</td>", decimal(l->limit_ns, 6).text);
        write_share(out, share_of(l->within, l->rows, v->confidence));
        fputs("</tr>\n<tr><td>of those that failed</td>", out);
        write_share(out, share_of(v->report->failed_within,
                                  class_counts_failed(&v->report->classes), v->confidence));
        fputs("</tr>\n", out);
    }
    fputs("</table>\n", out);
    plot_latency(out, l);
}

/* ---- Tables ---------------------------------------------------------------------------------- */

/* Writes a row: a value, its rows by class, and the share that failed. */
static void report_html_write_counts(FILE *out, const report_view *v, const char *name,
                                     const class_counts *c)
{
    fputs("<tr>", out);
    write_cell(out, name);
    fprintf(out, "<td>%" PRIu64 "</td>", class_counts_all(c));
    for (unsigned i = 0; i < CLASS_RATED; i++)
        fprintf(out, "<td>%" PRIu64 "</td>", c->of[i]);
    write_share(out, share_of(class_counts_failed(c), class_counts_rated(c), v->confidence));
    fputs("</tr>\n", out);
}

/* Writes the worst values as a table. All that are not told apart are one row. */
static void write_table(FILE *out, const report_view *v, const dimension *d, const uint32_t *list,
                        size_t count)
{
    fputs("<table>\n<tr><th>value</th><th>rows</th>", out);
    for (unsigned i = 0; i < CLASS_RATED; i++)
        fprintf(out, "<th>%s</th>", class_name((row_class)i));
    fputs("<th>failed</th></tr>\n", out);
    for (size_t i = 0; i < count && i < VALUES_SHOWN; i++)
        report_html_write_counts(out, v, d->values[list[i]].text, &d->values[list[i]].rows);
    if (class_counts_all(&d->other) > 0)
        report_html_write_counts(out, v, "all further values", &d->other);
    fputs("</table>\n", out);
    if (count > VALUES_SHOWN)
        fprintf(out, "<p>and %zu further values</p>\n", count - VALUES_SHOWN);
}

/* Writes the section of a factor, or of something like it: a plot, with the table folded away. */
static void write_dimension(FILE *out, const report_view *v, const dimension *d)
{
    size_t count = 0;
    uint32_t *list = report_worst_values(&count, d);
    fputs("<h2>", out);
    xml_text(out, d->name);
    fputs("</h2>\n", out);
    plot_values(out, d, list, count);
    fputs("<details><summary>as a table</summary>\n", out);
    write_table(out, v, d, list, count);
    fputs("</details>\n", out);
    free(list);
}

/* ---- Coverage -------------------------------------------------------------------------------- */

/* Writes how many values are there, of how many; an unknown number stays empty. */
static void write_of(FILE *out, const char *name, uint64_t seen, uint64_t possible, bool over)
{
    fputs("<tr>", out);
    write_cell(out, name);
    fprintf(out, "<td>%s%" PRIu64 "</td><td>", over ? "more than " : "", seen);
    if (possible > 0)
        fprintf(out, "%" PRIu64, possible);
    fputs("</td></tr>\n", out);
}

/* Writes how much of the values, and of their pairs, the rows have met. */
static void write_coverage(FILE *out, const report *r)
{
    fputs("<h2>Coverage</h2>\n<table>\n<tr><th>factor, or two of them</th><th>values that rows "
          "have</th><th>possible</th></tr>\n", out);
    for (size_t i = 0; i < r->factor_count; i++)
        write_of(out, r->factors[i].name, dimension_seen(&r->factors[i]), r->factors[i].possible,
                 class_counts_all(&r->factors[i].other) > 0);
    for (size_t i = 0; i < r->factor_count; i++) {
        for (size_t k = i + 1; k < r->factor_count; k++) {
            const pair_cover *c = pairs_of(&r->pairs, i, k);
            char *name = report_pair_name(r, i, k);
            write_of(out, name, c->met, report_pairs_possible(r, i, k), c->over);
            free(name);
        }
    }
    fputs("</table>\n", out);
}

/* ---- Pairs of values ------------------------------------------------------------------------- */

/* Writes a row: the two values, their rows, and how many of these are bad by the measure. */
static void write_worst_pair(FILE *out, const report *r, const pair_measure *m,
                             const worst_pair *p)
{
    char *name = report_pair_values(r, p->i, p->k, p->cell->first, p->cell->second);
    fputs("<tr>", out);
    write_cell(out, name);
    fprintf(out, "<td>%" PRIu64 "</td><td>%" PRIu64 "</td>", class_counts_all(&p->cell->rows),
            m->count(&p->cell->rows));
    write_share(out, p->share);
    fputs("</tr>\n", out);
    free(name);
}

/* Writes the worst pairs and the heat maps; nothing when no pair has a measure. */
static void write_pairs(FILE *out, const report_view *v)
{
    worst_pair list[REPORT_PAIRS_WORST];
    const pair_measure *m = report_pair_measure(v->report);
    const size_t count = m ? report_worst_pairs(list, v, m) : 0;
    if (count == 0)
        return;
    fprintf(out, "<h2>Pairs of values</h2>\n<p>The worst ones, by the lower end of the interval."
            "</p>\n<table>\n<tr><th>values</th><th>rows</th><th>%s</th><th>share</th></tr>\n",
            m->name);
    for (size_t i = 0; i < count; i++)
        write_worst_pair(out, v->report, m, &list[i]);
    fprintf(out, "</table>\n<p>Each cell below has the share of its rows in percent: %s. The title "
            "of a cell has its counts.</p>\n", m->name);
    map_pairs(out, v, m);
}

/* ---- Scenarios ------------------------------------------------------------------------------- */

static void write_note(FILE *out, const char *text)
{
    if (!text)
        return;
    fputs("<p>", out);
    xml_text(out, text);
    fputs("</p>\n", out);
}

/* Writes the text of a scenario. Those of the buses of a rig follow it. */
static void report_html_write_scenario(FILE *out, const report_view *v, size_t i)
{
    const bundle_text *t = &v->shortest->list[i].found.text;
    char *text = report_scenario_text(v->report, v->shortest, i);
    fputs("<pre>", out);
    xml_text(out, text);
    for (size_t k = 0; k < t->count; k++) {
        fprintf(out, "# %s\n", t->buses[k].name);
        xml_text(out, t->buses[k].text);
    }
    fputs("</pre>\n", out);
    free(text);
}

/* Writes the shortest scenarios, and why there are no more of them. */
static void write_scenarios(FILE *out, const report_view *v)
{
    const shortest *s = v->shortest;
    char *others = report_others_text(s);
    fputs("<h2>The shortest scenarios</h2>\n", out);
    write_note(out, s->why);
    for (size_t i = 0; i < s->count; i++)
        report_html_write_scenario(out, v, i);
    if (s->count == 0 && !s->why)
        fputs("<p>There are none.</p>\n", out);
    write_note(out, others);
    free(others);
}

void campaign_report_html(FILE *out, const report_view *v)
{
    const report *r = v->report;
    report_html_write_head(out, v);
    write_classes(out, v);
    write_latency(out, v);
    if (v->shortest)
        write_scenarios(out, v);
    if (r->errors.count > 0)
        write_dimension(out, v, &r->errors);
    report_each_dimension(out, v, write_dimension);
    if (r->factor_count > 0)
        write_coverage(out, r);
    write_pairs(out, v);
    fputs("</body>\n</html>\n", out);
}
