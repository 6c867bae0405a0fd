/* SPDX-License-Identifier: MIT
 *
 * report_figures.h - the figures of a report as SVG and HTML: plots, and heat maps that show how
 * much has failed for each pair of values.
 */
#ifndef CANWIRE_CLI_CAMPAIGN_REPORT_FIGURES_H
#define CANWIRE_CLI_CAMPAIGN_REPORT_FIGURES_H

#include "cli/campaign/report_pairs.h"
#include "cli/campaign/report_view.h"

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
