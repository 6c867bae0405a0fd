/* SPDX-License-Identifier: MIT
 *
 * data_phase.h - both bit timings of a CAN FD node: how they are found, and their tolerance. Rules
 *                D10 and T10.
 */
#ifndef CANWIRE_TIMING_DATA_PHASE_H
#define CANWIRE_TIMING_DATA_PHASE_H

#include "timing/request.h"

/* Finds both as a configuration does: with a common prescaler where timing_common_brp() knows one,
 * otherwise each as timing_by_kernel(). */
bool timing_by_rates(bit_timing *nominal, bit_timing *data, char problem[TIMING_PROBLEM_MAX],
                     const timing_request *slow, const timing_request *fast);

/* Finds the data phase of a nominal bit timing that is known: with its prescaler if that gives
 * exactly the rate, otherwise as timing_by_kernel(). */
bool timing_data_beside(bit_timing *data, char problem[TIMING_PROBLEM_MAX],
                        const bit_timing *nominal, const timing_request *fast);

/* Return how far the clock of each node may be off in the data phase (T10), in ppb, rounded down.
 * Behind a bit error it is min(phase_seg1, phase_seg2) / (2 ((6 dbits - dphase_seg2) dbrp / brp +
 * 7 bits)). At the change of the rate it is (dsjw - max(0, brp / dbrp - 1)) / (2 ((2 bits -
 * phase_seg2) brp / dbrp + dphase_seg2 + 4 dbits)), or 0. */
uint32_t timing_tolerance_of_data_error_ppb(const bit_timing *nominal, const bit_timing *data);
uint32_t timing_tolerance_of_switch_ppb(const bit_timing *nominal, const bit_timing *data);

/* Returns the smallest of both, and of timing_tolerance_of_sjw_ppb(data). */
uint32_t timing_data_tolerance_ppb(const bit_timing *nominal, const bit_timing *data);

#endif
