/* SPDX-License-Identifier: MIT
 *
 * data_timing.h - the bit timing of a node in the data phase of CAN FD frames (D10, D13).
 */
#ifndef CANWIRE_RECORD_DATA_TIMING_H
#define CANWIRE_RECORD_DATA_TIMING_H

#include "config/config.h"

typedef struct data_timing {
    bit_timing bit;
    cw_tdc tdc;         /* in clocks */
    uint32_t tdcv;      /* clocks: measured last, or as given; 0: none */
} data_timing;

/* Reads the data phase of a node as it is now. Returns false when the node has no data rate. */
bool data_timing_now(data_timing *out, const cfg *config, const cw_bus *bus, unsigned node);

/* Returns "off", "auto" or "manual". */
const char *data_timing_tdc_name(cw_tdc_mode mode);

#endif
