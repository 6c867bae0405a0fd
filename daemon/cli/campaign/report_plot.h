/* SPDX-License-Identifier: MIT
 *
 * report_plot.h - the plots of a report, as SVG within HTML.
 */
#ifndef CANWIRE_CLI_CAMPAIGN_REPORT_PLOT_H
#define CANWIRE_CLI_CAMPAIGN_REPORT_PLOT_H

#include "cli/campaign/report_view.h"

/* Draws the share of each class with its interval. */
void plot_shares(FILE *out, const report_view *v);

/* Draws the distribution of latencies over a logarithmic axis, with the limit. */
void plot_latency(FILE *out, const latency *l);

/* Draws the classes of each value, the first ones of a list. */
void plot_values(FILE *out, const dimension *d, const uint32_t *list, size_t count);

#endif
