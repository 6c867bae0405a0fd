/* SPDX-License-Identifier: MIT
 *
 * residual.h - how many frames are destroyed, and how many errors nobody can be expected to find.
 */
#ifndef CANWIRE_RECORD_RESIDUAL_H
#define CANWIRE_RECORD_RESIDUAL_H

#include "canwire.h"

/* Returns the frame error rate: error frames in a million of frames that were carried or
 * destroyed. */
uint64_t residual_error_ppm(const cw_bus_stats *stats);

/* Returns the expected number of errors that no node finds, in 10^-12. It is the limit that is
 * known for classical base frames: 4.7 * 10^-11 of the destroyed ones. */
uint64_t residual_expected_ppt(const cw_bus_stats *stats);

#endif
