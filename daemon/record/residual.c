/* SPDX-License-Identifier: MIT
 *
 * residual.c - how many frames are destroyed, and how many errors nobody can be expected to find.
 */
#include "record/residual.h"

#define MILLION 1000000u
#define UNDETECTED_PPT 47u /* 4.7 * 10^-11, of the frame error rate */

uint64_t residual_error_ppm(const cw_bus_stats *stats)
{
    const uint64_t all = stats->frames + stats->error_frames;
    return all ? stats->error_frames * MILLION / all : 0;
}

uint64_t residual_expected_ppt(const cw_bus_stats *stats)
{
    return stats->error_frames * UNDETECTED_PPT;
}
