/* SPDX-License-Identifier: MIT
 *
 * report_map.h - the heat maps of a report: how much has failed for each pair of values.
 */
#ifndef CANWIRE_CLI_CAMPAIGN_REPORT_MAP_H
#define CANWIRE_CLI_CAMPAIGN_REPORT_MAP_H

#include "cli/campaign/report_pairs.h"

/* Writes a table of HTML for each pair of factors, up to a limit. Each cell has the share as a
 * number, on a ground that is the darker the higher it is, and all counts in its title. */
void map_pairs(FILE *out, const report_view *v, const pair_measure *m);

#endif
