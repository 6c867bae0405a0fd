/* SPDX-License-Identifier: MIT
 *
 * drift.c - lengths of time by clocks with an error.
 */
#include "config/change/retime.h"

#define MILLION 1000000

cw_span cfg_drifted(cw_span quantum, cw_span ppm)
{
    return quantum - quantum / (MILLION + ppm) * ppm;
}

cw_span cfg_local_unit(const cfg_node *node, int32_t ppm)
{
    return cfg_drifted(node->local.unit, ppm);
}
