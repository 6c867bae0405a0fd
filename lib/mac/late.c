/* SPDX-License-Identifier: MIT
 *
 * late.c - transmitter delay compensation (D13).
 */
#include "mac/late.h"

#include "mac/mac_private.h"

bool cw_late_valid(const cw_tdc *tdc, uint32_t bit_clocks)
{
    const uint64_t most = (uint64_t)CW_TDC_BITS_MAX * bit_clocks;
    return (unsigned)tdc->mode <= CW_TDC_MANUAL &&
           (tdc->mode == CW_TDC_OFF || (uint64_t)tdc->tdco + tdc->tdcv < most);
}

/* Begins to measure with the own edge from FDF to res. */
static void begin_res(cw_late_compare *late)
{
    late->res_at = late->now;
    late->measures = true;
    late->delay = late->tdc.mode == CW_TDC_MANUAL ? late->tdc.tdcv : 0;
}

void cw_late_begin_bit(cw_late_compare *late, const cw_mac *m, bool level)
{
    if (late->tdc.mode == CW_TDC_OFF || !cw_mac_is_sending(m))
        return;
    if (m->part == CW_PART_RES && !cw_mac_stuff_bit_due(m))
        begin_res(late);
    if (!cw_mac_is_fast(m))
        late->begun = late->compared = 0;
    if (!cw_mac_compares_late(m))
        return;
    if (late->begun == 0)
        late->first_at = late->now;
    late->sent = late->sent << 1 | level;
    late->begun++;
}

/* The delay is whole clocks up to the one at whose end the own edge is seen. */
static void measure(cw_late_compare *late, bool level)
{
    if (!late->measures || level == CW_RECESSIVE)
        return;
    late->measures = false;
    if (late->tdc.mode == CW_TDC_AUTO)
        late->delay = (uint32_t)(late->now - late->res_at - 1);
}

static bool is_due(const cw_late_compare *late)
{
    const uint64_t begin = late->first_at + (uint64_t)late->compared * late->bit;
    return late->compared < late->begun && late->now >= begin + late->delay + late->tdc.tdco;
}

bool cw_late_pass(cw_late_compare *late, const cw_mac *m, uint32_t clocks, bool level)
{
    bool wrong = false;
    late->now += clocks;
    if (late->tdc.mode == CW_TDC_OFF || !cw_mac_is_sending(m))
        return false;
    measure(late, level);
    for (; cw_mac_is_fast(m) && is_due(late); late->compared++) {
        const unsigned back = late->begun - 1 - late->compared;
        wrong = wrong || (back < 64 && (late->sent >> back & 1u) != level);
    }
    return wrong;
}
