/* SPDX-License-Identifier: MIT
 *
 * phases.h - the bit timing of both phases of a node: segments that keys give, or that are found.
 *
 * The clock of a node is known before. A message says what is wrong and what is allowed.
 */
#ifndef CANWIRE_CONFIG_PHASES_H
#define CANWIRE_CONFIG_PHASES_H

#include "config/config.h"

/* Completes sjw as Linux does where it is 0, and checks the segments against the controller. */
bool cfg_fit_segments(cfg_node_time *time, char problem[TIMING_PROBLEM_MAX]);

/* Finds segments as Linux does, for clock, bit rate, sample point and sjw. */
bool cfg_find_segments(cfg_node_time *time, char problem[TIMING_PROBLEM_MAX], const cfg *config);

/* Do the same for the data phase, in time->data. */
bool cfg_fit_data(cfg_node_time *time, char problem[TIMING_PROBLEM_MAX]);
bool cfg_find_data(cfg_node_time *time, char problem[TIMING_PROBLEM_MAX], const cfg *config);

/* Returns the data phase that keys say; all 0 without one. */
cw_data_timing cfg_data_timing(const cfg_node_time *time);

#endif
