/* SPDX-License-Identifier: MIT
 *
 * rates.c - one time quantum for both bit rates of CAN FD.
 */
#include "timing/request.h"

/* Finds the bit timing with this prescaler alone. */
static bool find_with(bit_timing *out, const timing_request *request, uint32_t brp)
{
    char problem[TIMING_PROBLEM_MAX];
    timing_limits limits = *request->limits;
    timing_request narrow = *request;

    if (!timing_has_brp(&limits, brp))
        return false;
    limits.brp_min = limits.brp_max = (uint16_t)brp;
    narrow.limits = &limits;
    return timing_by_kernel(out, problem, &narrow);
}

/* Returns true when the prescaler gives the rate, and the sample point of the best timing. */
static bool serves(const timing_request *request, uint32_t brp, const bit_timing *best)
{
    bit_timing found;

    return find_with(&found, request, brp) && timing_bitrate_is(&found, request->bitrate_bps) &&
           timing_sample_point_ppb(&found) == timing_sample_point_ppb(best);
}

uint32_t timing_common_brp(const timing_request *nominal, const timing_request *data)
{
    char problem[TIMING_PROBLEM_MAX];
    bit_timing slow, fast;

    if (!timing_by_kernel(&slow, problem, nominal) || !timing_by_kernel(&fast, problem, data))
        return 0;
    for (uint32_t brp = data->limits->brp_min; brp <= data->clock_hz / data->bitrate_bps; brp++)
        if (serves(data, brp, &fast) && serves(nominal, brp, &slow))
            return brp;
    return 0;
}
