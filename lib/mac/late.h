/* SPDX-License-Identifier: MIT
 *
 * late.h - transmitter delay compensation (D13).
 *
 * A transmitter compares its bits of the data phase at a secondary sample point, which may lie in a
 * later bit. It does not synchronise in the data phase (D12). So its bits there follow each other
 * at equal distances, and the n-th of them is compared at a fixed time after the first.
 */
#ifndef CANWIRE_MAC_LATE_H
#define CANWIRE_MAC_LATE_H

#include "mac/mac.h"

/* Returns true when the values are in their ranges, with data bits of so many clocks. */
bool cw_late_valid(const cw_tdc *tdc, uint32_t bit_clocks);

/* Notes that the transmitter begins a bit with this level. */
void cw_late_begin_bit(cw_late_compare *late, const cw_mac *mac, bool level);

/* Lets a clock pass, or several, at whose end the controller sees a level. Returns true when a
 * comparison has found a bit error. */
bool cw_late_pass(cw_late_compare *late, const cw_mac *mac, uint32_t clocks, bool level);

#endif
