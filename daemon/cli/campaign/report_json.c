/* SPDX-License-Identifier: MIT
 *
 * report_json.c - a report as JSON.
 */
#include "cli/campaign/report_view.h"

#include "base/text/jsonput.h"

#include <stdlib.h>

#define GAPS_SHOWN 100u

static void put_share(json_t *object, share s)
{
    put(object, "share", json_real(s.value));
    put(object, "low", json_real(s.low));
    put(object, "high", json_real(s.high));
}

/* Puts a count with its share of all. */
static json_t *counted(const report_view *v, uint64_t count, uint64_t all)
{
    json_t *object = json_object();
    put_count(object, "rows", count);
    put_share(object, share_of(count, all, v->confidence));
    return object;
}

/* Returns the classes with a rate, each with its count and share. */
static json_t *classes_of(const report_view *v, const class_counts *c)
{
    json_t *object = json_object();
    for (unsigned i = 0; i < CLASS_RATED; i++)
        put(object, class_name((row_class)i), counted(v, c->of[i], class_counts_rated(c)));
    return object;
}

/* Returns the counts of classes without a rate: rows of which nobody knows what they would have
 * done. */
static json_t *outside_of(const class_counts *c)
{
    json_t *object = json_object();
    for (unsigned i = CLASS_RATED; i < CLASS_COUNT; i++)
        put_count(object, class_name((row_class)i), c->of[i]);
    return object;
}

/* ---- Rows ------------------------------------------------------------------------------------ */

/* Puts the numbers of rows as [first, last]. */
static json_t *rows_of(const report *r)
{
    json_t *list = json_array();
    for (size_t i = 0; i < r->numbers.count && i < GAPS_SHOWN; i++) {
        json_t *pair = json_array();
        put_last(pair, json_integer((json_int_t)r->numbers.list[i].first));
        put_last(pair, json_integer((json_int_t)r->numbers.list[i].last));
        put_last(list, pair);
    }
    return list;
}

/* Puts which rows were read and whether any is missing. `possible` is null without the campaign. */
static void put_rows(json_t *object, const report *r)
{
    json_t *rows = json_object();
    span gap;
    put_count(rows, "read", r->rows);
    put(rows, "possible", r->campaign ? json_integer((json_int_t)report_possible(r)) : json_null());
    put_bool(rows, "missing", report_missing(r, &gap));
    put(rows, r->source.is_campaign ? "numbers" : "seeds", rows_of(r));
    put(object, "rows", rows);
}

/* ---- Latency --------------------------------------------------------------------------------- */

static void put_seconds(json_t *object, const char *key, uint64_t ns)
{
    put(object, key, json_real((double)ns / 1e9));
}

/* Returns the latencies as bins, of which empty ones are left out. */
static json_t *histogram_of(const latency *l)
{
    json_t *list = json_array();
    for (unsigned i = 0; i < LATENCY_CLASSES; i++) {
        if (l->classes[i] == 0)
            continue;
        json_t *bin = json_object();
        put_seconds(bin, "to", latency_class_end(i));
        put_count(bin, "rows", l->classes[i]);
        put_last(list, bin);
    }
    return list;
}

/* Returns the distribution in seconds. The keys about the limit are there when there is one. */
static json_t *latency_of(const report_view *v)
{
    const report *r = v->report;
    const latency *l = &r->latency;
    json_t *object = json_object();
    put_count(object, "rows", l->rows);
    put_seconds(object, "min", l->min_ns);
    put_seconds(object, "median", latency_percentile(l, 500));
    put_seconds(object, "p95", latency_percentile(l, 950));
    put_seconds(object, "p99", latency_percentile(l, 990));
    put_seconds(object, "max", l->max_ns);
    if (l->has_limit) {
        put_seconds(object, "limit", l->limit_ns);
        put(object, "within", counted(v, l->within, l->rows));
        put(object, "failed_within", counted(v, r->failed_within,
                                             class_counts_failed(&r->classes)));
    }
    put(object, "histogram", histogram_of(l));
    return object;
}

/* ---- Factors --------------------------------------------------------------------------------- */

/* Adds the counts of a value. Classes without a row are left out. */
static void put_counts(json_t *object, const report_view *v, const class_counts *c)
{
    put_count(object, "rows", class_counts_all(c));
    for (unsigned i = 0; i < CLASS_COUNT; i++)
        if (c->of[i] > 0)
            put_count(object, class_name((row_class)i), c->of[i]);
    put(object, "failed", counted(v, class_counts_failed(c), class_counts_rated(c)));
}

static json_t *report_json_value_of(const report_view *v, const char *text, const class_counts *c)
{
    json_t *object = json_object();
    put_text(object, "value", text);
    put_counts(object, v, c);
    return object;
}

/* Returns the values of a factor. The value null stands for those that are not told apart. */
static json_t *dimension_of(const report_view *v, const dimension *d)
{
    json_t *object = json_object();
    json_t *values = json_array();
    put_text(object, "name", d->name);
    put_count(object, "seen", dimension_seen(d));
    put(object, "possible", d->possible > 0 ? json_integer((json_int_t)d->possible) : json_null());
    for (size_t i = 0; i < d->count; i++)
        put_last(values, report_json_value_of(v, d->values[i].text, &d->values[i].rows));
    if (class_counts_all(&d->other) > 0)
        put_last(values, report_json_value_of(v, NULL, &d->other));
    put(object, "values", values);
    return object;
}

static json_t *dimensions_of(const report_view *v, const dimension *list, size_t count)
{
    json_t *array = json_array();
    for (size_t i = 0; i < count; i++)
        put_last(array, dimension_of(v, &list[i]));
    return array;
}

/* ---- Pairs of factors ------------------------------------------------------------------------ */

/* Puts the rows of two values; NULL: those of all pairs that are not told apart. */
static json_t *cell_of(const report_view *v, const char *first, const char *second,
                       const class_counts *c)
{
    json_t *object = json_object();
    json_t *texts = first ? json_array() : json_null();
    if (first) {
        put_text_last(texts, first);
        put_text_last(texts, second);
    }
    put(object, "values", texts);
    put_counts(object, v, c);
    return object;
}

/* Returns the counts of each pair of values of two factors, in the order of values. */
static json_t *cells_of(const report_view *v, size_t i, size_t k)
{
    const report *r = v->report;
    const crosstab *t = &pairs_of(&r->pairs, i, k)->classes;
    const crosstab_cell **cells = crosstab_sorted(t);
    json_t *list = json_array();
    for (size_t n = 0; n < t->count; n++)
        put_last(list, cell_of(v, r->factors[i].values[cells[n]->first].text,
                               r->factors[k].values[cells[n]->second].text, &cells[n]->rows));
    if (class_counts_all(&t->other) > 0)
        put_last(list, cell_of(v, NULL, NULL, &t->other));
    free(cells);
    return list;
}

/* Returns two factors with the pairs of values that rows have met; null: more than were counted. */
static json_t *pair_of(const report_view *v, size_t i, size_t k)
{
    const report *r = v->report;
    const pair_cover *c = pairs_of(&r->pairs, i, k);
    const uint64_t possible = report_pairs_possible(r, i, k);
    json_t *object = json_object();
    json_t *names = json_array();
    put_text_last(names, r->factors[i].name);
    put_text_last(names, r->factors[k].name);
    put(object, "factors", names);
    put(object, "met", c->over ? json_null() : json_integer((json_int_t)c->met));
    put(object, "possible", possible > 0 ? json_integer((json_int_t)possible) : json_null());
    put(object, "values", cells_of(v, i, k));
    return object;
}

/* Returns all pairs of factors, the first one before the second. */
static json_t *pairs_list(const report_view *v)
{
    const report *r = v->report;
    json_t *array = json_array();
    for (size_t i = 0; i < r->factor_count; i++)
        for (size_t k = i + 1; k < r->factor_count; k++)
            put_last(array, pair_of(v, i, k));
    return array;
}

/* ---- Scenarios ------------------------------------------------------------------------------- */

/* Returns why a row counts as degraded. */
static json_t *reasons_of(unsigned degraded)
{
    json_t *list = json_array();
    for (unsigned i = 0; i < DEGRADED_REASONS; i++)
        if (degraded >> i & 1u)
            put_text_last(list, class_reason_name(i));
    return list;
}

/* Returns the files of the buses of a rig, by their names in the rig. */
static json_t *buses_of(const bundle_text *t)
{
    json_t *object = json_object();
    for (size_t i = 0; i < t->count; i++)
        put_text(object, t->buses[i].name, t->buses[i].text);
    return object;
}

/* Returns a scenario: where it comes from, what has been tried with it, and how to run it again. */
static json_t *scenario_of(const report_view *v, size_t i)
{
    const shortest_scenario *one = &v->shortest->list[i];
    char *name = report_scenario_name(v->shortest, i);
    char *command = report_scenario_command(v->shortest, i, name);
    char *text = report_scenario_text(v->report, v->shortest, i);
    json_t *object = json_object();
    put_text(object, "name", name);
    put_text(object, "class", class_name(one->class));
    put_count(object, v->report->source.is_campaign ? "number" : "seed", one->number);
    put_text(object, "expectation", one->expectation);
    put(object, "degraded_by", reasons_of(one->degraded));
    put_count(object, "rules", one->found.rules);
    put_count(object, "traffic", one->found.traffic);
    put_bool(object, "run_again", one->found.tried);
    put_bool(object, "minimised", one->found.whole);
    put_text(object, "command", command);
    put_text(object, "repeat", one->repeat);
    put_text(object, "yaml", text);
    if (one->found.text.count > 0)
        put(object, "buses", buses_of(&one->found.text));
    free(name);
    free(command);
    free(text);
    return object;
}

/* Puts the shortest scenarios, and why there are none or fewer. */
static void put_scenarios(json_t *object, const report_view *v)
{
    json_t *list = json_array();
    for (size_t i = 0; i < v->shortest->count; i++)
        put_last(list, scenario_of(v, i));
    put(object, "scenarios", list);
    put_text(object, "scenarios_missing", v->shortest->why);
    put_count(object, "scenarios_not_repeated", v->shortest->others);
}

/* ---- All of it ------------------------------------------------------------------------------- */

/* Returns what limits the meaning of the rates, the missing rows first. */
static json_t *remarks_of(const report *r)
{
    json_t *list = json_array();
    char *missing = report_missing_text(r);
    if (missing)
        put_text_last(list, missing);
    for (size_t i = 0; report_remarks[i]; i++)
        put_text_last(list, report_remarks[i]);
    free(missing);
    return list;
}

void campaign_report_json(FILE *out, const report_view *v)
{
    const report *r = v->report;
    json_t *object = json_object();
    put_text(object, r->source.is_campaign ? "campaign" : "scenario",
             r->campaign ? r->campaign->file : r->source.file);
    put_rows(object, r);
    put(object, "confidence", json_real(v->confidence));
    put(object, "classes", classes_of(v, &r->classes));
    put(object, "without_rate", outside_of(&r->classes));
    put(object, "failed_detected", counted(v, r->classes.of[CLASS_DETECTED],
                                           class_counts_failed(&r->classes)));
    put(object, "latency", latency_of(v));
    put(object, "expectations", dimensions_of(v, &r->expectations, 1));
    put(object, "first_errors", dimensions_of(v, &r->errors, 1));
    if (r->lost.count > 0)
        put(object, "lost", dimensions_of(v, &r->lost, 1));
    put(object, "factors", dimensions_of(v, r->factors, r->factor_count));
    put(object, "groups", dimensions_of(v, r->groups, r->group_count));
    put(object, "pairs", pairs_list(v));
    if (v->shortest)
        put_scenarios(object, v);
    put(object, "remarks", remarks_of(r));
    put_out(out, object);
    json_decref(object);
}
