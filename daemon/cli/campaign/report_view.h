/* SPDX-License-Identifier: MIT
 *
 * report_view.h - a report in the forms in which `canwire campaign report` writes it.
 */
#ifndef CANWIRE_CLI_CAMPAIGN_REPORT_VIEW_H
#define CANWIRE_CLI_CAMPAIGN_REPORT_VIEW_H

#include "campaign/space/normal.h"
#include "campaign/report/shortest.h"

#include <stdio.h>

#define REPORT_PERCENT_BYTES 48

typedef struct report_view {
    const report *report;
    const shortest *shortest; /* NULL: they were not asked for */
    double confidence; /* of the intervals, above 0 and below 1 */
} report_view;

/* Pairs of values are compared with this: failures, or the worst that the rows have instead. */
typedef struct pair_measure {
    const char *name;
    uint64_t (*count)(const class_counts *c);
} pair_measure;

/* Write the report to a stream, which keeps the error of a failed write. */
void campaign_report_text(FILE *out, const report_view *v);
void campaign_report_json(FILE *out, const report_view *v);
void campaign_report_html(FILE *out, const report_view *v);
void campaign_report_junit(FILE *out, const report_view *v);

/* Sentences about the meaning of the numbers, NULL at the end. */
extern const char *const report_remarks[];

/* Returns a sentence about missing rows, or about the campaign's file, to be freed; NULL: there is
 * nothing to say. */
char *report_missing_text(const report *r);

/* Prints "12.50 % (11.20 to 13.94 %)". */
void report_print_share(char out[REPORT_PERCENT_BYTES], share s);

/* Returns the share of the rows of a class in the rates. */
share report_class_share(const report_view *v, const class_counts *c, row_class class);

/* Returns the values of a dimension as numbers, most failures first, to be freed; *count of them.
 * Values without a row are left out. */
uint32_t *report_worst_values(size_t *count, const dimension *d);

/* Returns "FACTOR with FACTOR", to be freed. */
char *report_pair_name(const report *r, size_t i, size_t k);

/* Returns the name of a file for scenario i: its class and its number there, to be freed. A rig has
 * a folder of its own. */
char *report_scenario_name(const shortest *s, size_t i);

/* Returns ": " with the expectation that fails, or why it is degraded, or "", to be freed. */
char *report_scenario_why(const shortest_scenario *one);

/* Returns what the report has done with it, in the comment of its YAML. */
const char *report_scenario_state(const shortest_scenario *one);

/* Returns a sentence about rows that are not scenarios, to be freed; NULL: there are none. */
char *report_others_text(const shortest *s);

/* Returns its YAML with the command that runs it, as a comment before it, to be freed. */
char *report_scenario_text(const report *r, const shortest *s, size_t i);

/* Returns that command for a file, to be freed. */
char *report_scenario_command(const shortest *s, size_t i, const char *file);

/* Returns the number of pairs of values that are possible, or 0 when it is not known. */
uint64_t report_pairs_possible(const report *r, size_t i, size_t k);

/* Calls `write` for the expectations, if there are any, for groups of faults, and for factors. */
typedef void report_write_dimension(FILE *out, const report_view *v, const dimension *d);
void report_each_dimension(FILE *out, const report_view *v, report_write_dimension *write);

/* ---- report_figures.c: figures as SVG and HTML ----------------------------------------------- */

/* Writes a table of HTML for each pair of factors, up to a limit. Each cell has the share as a
 * number, on a ground that is the darker the higher it is, and all counts in its title. */
void map_pairs(FILE *out, const report_view *v, const pair_measure *m);

/* Draws the share of each class with its interval. */
void plot_shares(FILE *out, const report_view *v);

/* Draws the distribution of latencies over a logarithmic axis, with the limit. */
void plot_latency(FILE *out, const latency *l);

/* Draws the classes of each value, the first ones of a list. */
void plot_values(FILE *out, const dimension *d, const uint32_t *list, size_t count);

#endif
