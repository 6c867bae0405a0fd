/* SPDX-License-Identifier: MIT
 *
 * phases.h - the bit timing of both phases of a node: segments that keys give, or that are found.
 *
 * The clock of a node is known before. A message says what is wrong and what is allowed.
 */
#ifndef CANWIRE_CONFIG_PHASES_H
#define CANWIRE_CONFIG_PHASES_H

#include "config/config.h"

/* Completes the sjw of a phase as Linux does where it is 0, and checks the segments against the
 * controller. */
bool cfg_fit_phase(cfg_node_time *time, unsigned phase, char problem[TIMING_PROBLEM_MAX]);

/* Finds segments as Linux does, for clock, bit rate, sample point and sjw. */
bool cfg_find_phase(cfg_node_time *time, unsigned phase, char problem[TIMING_PROBLEM_MAX],
                    const cfg *config);

/* Returns the data phase that keys say; all 0 without one. */
cw_data_timing cfg_data_timing(const cfg_node_time *time);

/* When a transmitter compares a bit of the data phase, and when it can (D13); spans since the start
 * of the bit. */
typedef struct cfg_late_sample {
    uint64_t tdcv;   /* the delay, as given or as the node will measure it, in clocks */
    cw_span at;      /* the secondary sample point; with tdc-mode off the sample point */
    cw_span from;    /* the bit has come back to its node after this moment ... */
    cw_span until;   /* ... and the next one has not, up to this one */
} cfg_late_sample;

/* Finds that of a node with a data phase. */
cfg_late_sample cfg_find_late_sample(const cfg_node_time *time);

/* Returns the time to the nearer limit; at most 0: the bit is not there. */
cw_span cfg_late_margin(const cfg_late_sample *sample);

#endif
