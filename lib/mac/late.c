/* SPDX-License-Identifier: MIT
 *
 * late.c - transmitter delay compensation (D13).
 */
#include "mac/late.h"

#include "mac/mac_private.h"
#include "time/moment.h"

#define KEPT (2 * CW_TDC_BITS_MAX) /* bits */

bool cw_late_valid(const cw_tdc *tdc, uint32_t bit_clocks)
{
    const uint64_t most = (uint64_t)CW_TDC_BITS_MAX * bit_clocks;
    return (unsigned)tdc->mode <= CW_TDC_MANUAL &&
           (tdc->mode == CW_TDC_OFF || (uint64_t)tdc->tdco + tdc->tdcv < most);
}

void cw_late_init(cw_late_compare *late, const cw_tdc *tdc, int64_t clock)
{
    *late = (cw_late_compare){.delay = 0};
    cw_late_change(late, tdc, clock);
}

void cw_late_change(cw_late_compare *late, const cw_tdc *tdc, int64_t clock)
{
    late->tdc = *tdc;
    late->clock = clock;
    if (tdc->mode == CW_TDC_MANUAL)
        late->delay = tdc->tdcv;
}

void cw_late_forget(cw_late_compare *late)
{
    late->begun = late->compared = 0;
    late->measures = false;
}

void cw_late_measured(cw_late_compare *late, uint32_t delay)
{
    late->delay = late->tdc.mode == CW_TDC_AUTO ? delay : late->delay;
}

/* Begins to measure with the own edge from FDF to res. */
static void begin_res(cw_late_compare *late, int64_t moment)
{
    late->measured_to = moment;
    late->measures = late->tdc.mode == CW_TDC_AUTO;
    late->passed = 0;
}

void cw_late_begin_bit(cw_late_compare *late, const cw_mac *m, bool level, int64_t moment)
{
    if (late->tdc.mode == CW_TDC_OFF || !cw_mac_is_sending(m))
        return;
    if (m->part == CW_PART_RES && (m->fd->offer.flags & CW_FRAME_BRS))
        begin_res(late, moment);
    if (m->part == CW_PART_SOF)
        late->measures = false; /* an error has ended the frame before */
    if (!cw_mac_is_fast(m))
        late->begun = late->compared = 0;
    if (!cw_mac_compares_late(m))
        return;
    late->begun_at[late->begun % KEPT] = moment;
    late->sent = late->sent << 1 | level;
    late->fixed = late->fixed << 1 | (cw_mac_has_fixed_stuffing(m) && cw_mac_stuff_bit_due(m));
    late->begun++;
}

bool cw_late_measures(const cw_late_compare *late, const cw_mac *m, int64_t *moment)
{
    *moment = late->measured_to + late->clock;
    return late->measures && cw_mac_is_sending(m);
}

/* The delay is whole clocks up to the one at whose end the own edge is seen. */
void cw_late_measure(cw_late_compare *late, bool level)
{
    late->measured_to += late->clock;
    late->measures = level == CW_RECESSIVE;
    if (!late->measures)
        late->delay = late->passed;
    late->passed++;
}

/* A bit is compared one clock after its start at the earliest. */
bool cw_late_is_due(const cw_late_compare *late, const cw_mac *m, int64_t *moment)
{
    const uint64_t after = (uint64_t)late->delay + late->tdc.tdco;
    *moment = late->begun_at[late->compared % KEPT] +
              (int64_t)(after ? after : 1) * late->clock;
    return cw_mac_is_fast(m) && cw_mac_is_sending(m) && late->compared < late->begun;
}

bool cw_late_compare_next(cw_late_compare *late, bool level, cw_error_type *error)
{
    const unsigned back = late->begun - 1 - late->compared;
    late->compared++;
    *error = back < KEPT && (late->fixed >> back & 1u) ? CW_ERROR_FORM : CW_ERROR_BIT;
    return back < KEPT && (late->sent >> back & 1u) != level;
}

uint32_t cw_late_delay(const cw_late_compare *late)
{
    return late->delay;
}

void cw_late_rebase(cw_late_compare *late, int64_t by)
{
    cw_moment_rebase(&late->measured_to, by);
    for (unsigned n = 0; n < KEPT; n++)
        cw_moment_rebase(&late->begun_at[n], by);
}
