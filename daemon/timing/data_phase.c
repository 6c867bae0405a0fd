/* SPDX-License-Identifier: MIT
 *
 * data_phase.c - both bit timings of a CAN FD node: how they are found, and their tolerance.
 */
#include "timing/data_phase.h"

#include <stdio.h>

#define ERROR_DATA_BITS 6u /* from the last edge to a bit error in the data phase */
#define ERROR_BITS 7u      /* from there to the bit behind the error flag */
#define SWITCH_BITS 2u     /* from the last edge to the change of the rate */
#define SWITCH_DATA_BITS 4u

/* ---- Segments -------------------------------------------------------------------------------- */

/* Finds a bit timing with this prescaler alone; 0: any. */
static bool with_brp(bit_timing *out, char problem[TIMING_PROBLEM_MAX],
                     const timing_request *request, uint32_t brp)
{
    timing_limits limits = *request->limits;
    timing_request narrow = *request;

    if (brp > 0)
        limits.brp_min = limits.brp_max = (uint16_t)brp;
    narrow.limits = &limits;
    return timing_by_kernel(out, problem, &narrow);
}

/* Says which phase a message is about. */
static bool refuse_data(char problem[TIMING_PROBLEM_MAX], const char *why)
{
    (void)snprintf(problem, TIMING_PROBLEM_MAX, "data phase: %.180s", why);
    return false;
}

static bool find_data(bit_timing *out, char problem[TIMING_PROBLEM_MAX],
                      const timing_request *request, uint32_t brp)
{
    char why[TIMING_PROBLEM_MAX];

    return with_brp(out, why, request, brp) || refuse_data(problem, why);
}

bool timing_by_rates(bit_timing *nominal, bit_timing *data, char problem[TIMING_PROBLEM_MAX],
                     const timing_request *slow, const timing_request *fast)
{
    const uint32_t brp = timing_common_brp(slow, fast);

    return with_brp(nominal, problem, slow, brp) && find_data(data, problem, fast, brp);
}

bool timing_data_beside(bit_timing *data, char problem[TIMING_PROBLEM_MAX],
                        const bit_timing *nominal, const timing_request *fast)
{
    if (timing_has_brp(fast->limits, nominal->brp) &&
        with_brp(data, problem, fast, nominal->brp) && timing_bitrate_is(data, fast->bitrate_bps))
        return true;
    return find_data(data, problem, fast, 0);
}

/* ---- Tolerance ------------------------------------------------------------------------------- */

/* Spans are in clocks, which both phases have in common. The bit behind an error flag is a nominal
 * one, so its phase segments take what the clocks have run apart. */
uint32_t timing_tolerance_of_data_error_ppb(const bit_timing *nominal, const bit_timing *data)
{
    const uint64_t slack =
        (uint64_t)timing_least(nominal->phase_seg1, nominal->phase_seg2) * nominal->brp;
    const uint64_t data_tq = ERROR_DATA_BITS * (uint64_t)timing_quanta(data) - data->phase_seg2;
    const uint64_t span = data_tq * data->brp + ERROR_BITS * timing_bit_clocks(nominal);

    return (uint32_t)(slack * TIMING_ONE_PPB / (2 * span));
}

uint32_t timing_tolerance_of_switch_ppb(const bit_timing *nominal, const bit_timing *data)
{
    const uint64_t coarser = nominal->brp > data->brp ? nominal->brp - data->brp : 0;
    const uint64_t jump = (uint64_t)data->sjw * data->brp;
    const uint64_t slow_tq = SWITCH_BITS * (uint64_t)timing_quanta(nominal) - nominal->phase_seg2;
    const uint64_t fast_tq = SWITCH_DATA_BITS * (uint64_t)timing_quanta(data) + data->phase_seg2;
    const uint64_t span = slow_tq * nominal->brp + fast_tq * data->brp;

    return jump > coarser ? (uint32_t)((jump - coarser) * TIMING_ONE_PPB / (2 * span)) : 0;
}

uint32_t timing_data_tolerance_ppb(const bit_timing *nominal, const bit_timing *data)
{
    return timing_least(timing_tolerance_of_sjw_ppb(data),
                        timing_least(timing_tolerance_of_data_error_ppb(nominal, data),
                                     timing_tolerance_of_switch_ppb(nominal, data)));
}
