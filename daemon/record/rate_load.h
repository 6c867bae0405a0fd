/* SPDX-License-Identifier: MIT
 *
 * rate_load.h - the load of a bus with CAN FD, divided into the bits of its two rates (D10).
 */
#ifndef CANWIRE_RECORD_RATE_LOAD_H
#define CANWIRE_RECORD_RATE_LOAD_H

#include "canwire.h"

/* The bits of one rate between two readings that were not idle. */
typedef struct rate_load {
    uint64_t bits;
    uint64_t ticks;
    unsigned permille; /* of the time between the readings */
} rate_load;

/* Return the busy bits that began at the nominal and at the data rate. Both loads together are
 * cw_load_permille(), but for the rounding down of each. `before` may be all 0. */
rate_load rate_load_nominal(const cw_bus_stats *before, const cw_bus_stats *after);
rate_load rate_load_data(const cw_bus_stats *before, const cw_bus_stats *after);

#endif
