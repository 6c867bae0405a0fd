/* SPDX-License-Identifier: MIT
 *
 * report_text.c - a report as text for people.
 */
#include "base/text/counted.h"
#include "cli/campaign/report_view.h"

#include "base/text/decimal.h"
#include "base/text/plain.h"
#include "cli/campaign/report_pairs.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define VALUES_SHOWN 10u
#define PAIRS_SHOWN 20u
#define SHORT_NAME 28
#define PAIR_NAME 44

static const char *const short_names[CLASS_RATED] = {
    [CLASS_NO_EFFECT] = "none", [CLASS_CORRECTED] = "corrected", [CLASS_DEGRADED] = "degraded",
    [CLASS_DETECTED] = "detected", [CLASS_UNDETECTED] = "undetected", [CLASS_TIMEOUT] = "time-out",
};

/* ---- Classes --------------------------------------------------------------------------------- */

/* Prints the source of the rows, their number, and those that are missing. */
static void report_text_write_head(FILE *out, const report_view *v)
{
    const report *r = v->report;
    char *missing = report_missing_text(r);
    plain_print(out, "%s: %s, %s\n", r->source.file,
                counted(r->rows, r->source.is_campaign ? "row" : "seed").text,
                counted(r->factor_count, "factor").text);
    if (missing)
        plain_print(out, "%s\n", missing);
    free(missing);
}

/* Prints the classes with their shares. Those without a rate follow in one line. */
static void write_classes(FILE *out, const report_view *v)
{
    const class_counts *c = &v->report->classes;
    fprintf(out, "\n%-32s %10s  share (interval of %g %%)\n", "class", "rows",
            100 * v->confidence);
    for (unsigned i = 0; i < CLASS_RATED; i++) {
        char text[REPORT_PERCENT_BYTES];
        report_print_share(text, report_class_share(v, c, (row_class)i));
        fprintf(out, "%-32s %10" PRIu64 "  %s\n", class_name((row_class)i), c->of[i], text);
    }
    if (class_counts_all(c) == class_counts_rated(c))
        return;
    fputs("without a rate:", out);
    for (unsigned i = CLASS_RATED; i < CLASS_COUNT; i++)
        fprintf(out, " %s %" PRIu64 "%s", class_name((row_class)i), c->of[i],
                i + 1 < CLASS_COUNT ? "," : "\n");
}

/* Prints the share of failures that were detected; nothing when nothing failed. */
static void write_failed(FILE *out, const report_view *v)
{
    const class_counts *c = &v->report->classes;
    const uint64_t failed = class_counts_failed(c);
    char text[REPORT_PERCENT_BYTES];
    if (failed == 0)
        return;
    report_print_share(text, share_of(c->of[CLASS_DETECTED], failed, v->confidence));
    fprintf(out, "\nof %" PRIu64 " that failed, %" PRIu64 " were detected: %s\n", failed,
            c->of[CLASS_DETECTED], text);
}

/* ---- Latency --------------------------------------------------------------------------------- */

static void write_ms(FILE *out, const char *name, uint64_t ns)
{
    fprintf(out, " %s %s ms", name, decimal(ns, 6).text);
}

/* Prints how many of the rows kept the limit of latency. */
static void write_limit(FILE *out, const report_view *v)
{
    const report *r = v->report;
    const latency *l = &r->latency;
    const uint64_t failed = class_counts_failed(&r->classes);
    char text[REPORT_PERCENT_BYTES];
    report_print_share(text, share_of(l->within, l->rows, v->confidence));
    fprintf(out, "  within the limit of %s ms: %" PRIu64 ", %s\n", decimal(l->limit_ns, 6).text,
            l->within, text);
    if (failed == 0)
        return;
    report_print_share(text, share_of(r->failed_within, failed, v->confidence));
    fprintf(out, "  of %" PRIu64 " that failed, an error within the limit: %" PRIu64 ", %s\n",
            failed, r->failed_within, text);
}

/* Prints the distribution of latencies in a line, and that of the limit in the next one. */
static void write_latency(FILE *out, const report_view *v)
{
    const latency *l = &v->report->latency;
    fprintf(out, "\nfrom the first hit of a fault to the first error: %s",
            counted(l->rows, "row").text);
    if (l->rows > 0) {
        fputs(";", out);
        write_ms(out, "min", l->min_ns);
        write_ms(out, "median", latency_percentile(l, 500));
        write_ms(out, "p95", latency_percentile(l, 950));
        write_ms(out, "p99", latency_percentile(l, 990));
        write_ms(out, "max", l->max_ns);
    }
    fputc('\n', out);
    if (l->has_limit)
        write_limit(out, v);
}

/* ---- Tables ---------------------------------------------------------------------------------- */

static void write_counts_head(FILE *out, const char *name)
{
    plain_print(out, "\n%-*s %9s", SHORT_NAME, name, "rows");
    for (unsigned i = 0; i < CLASS_RATED; i++)
        fprintf(out, " %10s", short_names[i]);
    fputs("  failed\n", out);
}

/* Prints a row below the head: a value, its rows by class, and the share that failed. */
static void report_text_write_counts(FILE *out, const report_view *v, const char *name,
                                     const class_counts *c)
{
    char text[REPORT_PERCENT_BYTES];
    report_print_share(text, share_of(class_counts_failed(c), class_counts_rated(c),
                                      v->confidence));
    plain_print(out, "%-*s %9" PRIu64, SHORT_NAME, name, class_counts_all(c));
    for (unsigned i = 0; i < CLASS_RATED; i++)
        fprintf(out, " %10" PRIu64, c->of[i]);
    fprintf(out, "  %s\n", text);
}

/* Writes the values of a factor, the worst ones first. */
static void write_dimension(FILE *out, const report_view *v, const dimension *d)
{
    size_t count = 0;
    uint32_t *list = report_worst_values(&count, d);
    write_counts_head(out, d->name);
    for (size_t i = 0; i < count && i < VALUES_SHOWN; i++)
        report_text_write_counts(out, v, d->values[list[i]].text, &d->values[list[i]].rows);
    if (class_counts_all(&d->other) > 0)
        report_text_write_counts(out, v, "all further values", &d->other);
    if (count > VALUES_SHOWN)
        fprintf(out, "and %zu further values\n", count - VALUES_SHOWN);
    free(list);
}

/* ---- Pairs of values ------------------------------------------------------------------------- */

/* Prints a row: the two values, their rows, and how many of these are bad by the measure. */
static void write_worst_pair(FILE *out, const report *r, const pair_measure *m,
                             const worst_pair *p)
{
    char text[REPORT_PERCENT_BYTES];
    char *name = report_pair_values(r, p->i, p->k, p->cell->first, p->cell->second);
    report_print_share(text, p->share);
    plain_print(out, "%-*s %9" PRIu64 " %10" PRIu64 "  %s\n", PAIR_NAME, name,
                class_counts_all(&p->cell->rows), m->count(&p->cell->rows), text);
    free(name);
}

/* Prints the worst pairs of values, and for how many factors not all pairs are known. */
static void write_worst_pairs(FILE *out, const report_view *v)
{
    worst_pair list[REPORT_PAIRS_WORST];
    const pair_measure *m = report_pair_measure(v->report);
    const size_t count = m ? report_worst_pairs(list, v, m) : 0;
    const size_t cut = report_pairs_cut(v->report);
    if (count == 0)
        return;
    fprintf(out, "\n%-*s %9s %10s  share\n", PAIR_NAME, "the worst pairs of values", "rows",
            m->name);
    for (size_t i = 0; i < count; i++)
        write_worst_pair(out, v->report, m, &list[i]);
    if (cut > 0)
        fprintf(out, "%s of factors %s more pairs of values than are told apart\n",
                counted(cut, "pair").text, cut == 1 ? "has" : "have");
}

/* ---- Coverage -------------------------------------------------------------------------------- */

static void write_of(FILE *out, uint64_t seen, uint64_t possible, bool over)
{
    fprintf(out, "%s%" PRIu64, over ? "more than " : "", seen);
    if (possible > 0)
        fprintf(out, " of %" PRIu64, possible);
}

/* Prints how many pairs of values the rows have met, for the first pairs of factors. */
static void write_pairs(FILE *out, const report *r)
{
    unsigned shown = 0;
    for (size_t i = 0; i < r->factor_count; i++) {
        for (size_t k = i + 1; k < r->factor_count; k++) {
            const pair_cover *c = pairs_of(&r->pairs, i, k);
            if (shown++ >= PAIRS_SHOWN)
                continue;
            char *name = report_pair_name(r, i, k);
            plain_print(out, "  %s: ", name);
            free(name);
            write_of(out, c->met, report_pairs_possible(r, i, k), c->over);
            fputs(" pairs of values\n", out);
        }
    }
    if (shown > PAIRS_SHOWN)
        fprintf(out, "  and %s of factors\n", counted(shown - PAIRS_SHOWN, "further pair").text);
}

/* Prints how many of the possible values rows have, as far as their number is known. */
static void write_coverage(FILE *out, const report *r)
{
    fputs("\nvalues that rows have\n", out);
    for (size_t i = 0; i < r->factor_count; i++) {
        const dimension *d = &r->factors[i];
        plain_print(out, "  %s: ", d->name);
        write_of(out, dimension_seen(d), d->possible, class_counts_all(&d->other) > 0);
        fputc('\n', out);
    }
    write_pairs(out, r);
}

/* ---- Scenarios ------------------------------------------------------------------------------- */

static const char *state_of(const shortest_scenario *one)
{
    if (!one->found.tried)
        return " (not run again for lack of time)";
    return one->found.whole ? "" : " (not as short as possible)";
}

/* Prints a scenario in a line: its size, the row it comes from, and its state. */
static void report_text_write_scenario(FILE *out, const shortest *s, size_t i)
{
    const shortest_scenario *one = &s->list[i];
    char *name = report_scenario_name(s, i);
    plain_print(out, "  %s: %s, %s of traffic", name,
                counted(one->found.rules, "rule").text, counted(one->found.traffic, "entry").text);
    if (one->found.text.count > 0)
        fprintf(out, ", %s", counted(one->found.text.count, "bus").text);
    if (one->found.has_until)
        fprintf(out, ", %s ms", decimal(one->found.until_ns, 6).text);
    char *why = report_scenario_why(one);
    fprintf(out, "; number %" PRIu64, one->number);
    if (*why)
        plain_print(out, "; %s", why + strlen(": "));
    free(why);
    fprintf(out, "%s\n", state_of(one));
    free(name);
}

/* Prints the shortest scenarios, and why there are none or fewer. */
static void write_scenarios(FILE *out, const shortest *s)
{
    fputs("\nthe shortest scenarios\n", out);
    for (size_t i = 0; i < s->count; i++)
        report_text_write_scenario(out, s, i);
    char *others = report_others_text(s);
    if (others)
        fprintf(out, "  %s\n", others);
    free(others);
    if (s->why)
        plain_print(out, "  %s\n", s->why);
    else if (s->count == 0)
        fputs("  none\n", out);
}

void campaign_report_text(FILE *out, const report_view *v)
{
    const report *r = v->report;
    report_text_write_head(out, v);
    write_classes(out, v);
    write_failed(out, v);
    write_latency(out, v);
    report_each_dimension(out, v, write_dimension);
    write_worst_pairs(out, v);
    if (r->factor_count > 0)
        write_coverage(out, r);
    if (v->shortest)
        write_scenarios(out, v->shortest);
    fputc('\n', out);
    for (size_t i = 0; report_remarks[i]; i++)
        fprintf(out, "%s\n", report_remarks[i]);
}
