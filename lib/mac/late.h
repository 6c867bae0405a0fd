/* SPDX-License-Identifier: MIT
 *
 * late.h - transmitter delay compensation (D13).
 *
 * A transmitter compares its bits of the data phase at a secondary sample point, which may lie in a
 * later bit. Moments are counted in units of the caller, of which a clock has a whole number.
 */
#ifndef CANWIRE_MAC_LATE_H
#define CANWIRE_MAC_LATE_H

#include "mac/mac.h"

/* Returns true when the values are in their ranges, with data bits of that many clocks. */
bool cw_late_valid(const cw_tdc *tdc, uint32_t bit_clocks);

/* Begins with no bits. clock: units of a clock. */
void cw_late_init(cw_late_compare *late, const cw_tdc *tdc, int64_t clock);

/* Changes values and clock, for bits that are still to be compared, too. */
void cw_late_change(cw_late_compare *late, const cw_tdc *tdc, int64_t clock);

/* Forgets the bits so far: none will be compared. */
void cw_late_forget(cw_late_compare *late);

/* Notes a delay in clocks that has been measured in another way. */
void cw_late_measured(cw_late_compare *late, uint32_t delay);

/* Notes that the transmitter begins a bit with this level at a moment. */
void cw_late_begin_bit(cw_late_compare *late, const cw_mac *mac, bool level, int64_t moment);

/* Returns true while the delay of the own edge to res is measured. The controller waits for the
 * first clock at whose end it sees a dominant level. *moment is the end of the next clock. */
bool cw_late_measures(const cw_late_compare *late, const cw_mac *mac, int64_t *moment);

/* Notes what the controller sees at the end of that clock. */
void cw_late_measure(cw_late_compare *late, bool level);

/* Returns true when a bit is still to be compared. *moment is its secondary sample point. */
bool cw_late_is_due(const cw_late_compare *late, const cw_mac *mac, int64_t *moment);

/* Compares that bit with what the controller sees there. Returns true when it is wrong: that is a
 * form error in a fixed stuff bit (D14), else a bit error. */
bool cw_late_compare_next(cw_late_compare *late, bool level, cw_error_type *error);

/* Returns the delay in clocks: as measured last, or as given. */
uint32_t cw_late_delay(const cw_late_compare *late);

/* Moves the origin of moments forward. */
void cw_late_rebase(cw_late_compare *late, int64_t by);

#endif
