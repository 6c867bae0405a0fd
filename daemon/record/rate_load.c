/* SPDX-License-Identifier: MIT
 *
 * rate_load.c - the load of a bus with CAN FD, divided into the bits of its two rates (D10).
 */
#include "record/rate_load.h"

static rate_load load_of(uint64_t bits, uint64_t ticks, uint64_t of_ticks)
{
    return (rate_load){.bits = bits,
                       .ticks = ticks,
                       .permille = of_ticks ? (unsigned)(ticks * 1000 / of_ticks) : 0};
}

rate_load rate_load_data(const cw_bus_stats *before, const cw_bus_stats *after)
{
    return load_of(after->data_bits - before->data_bits, after->data_ticks - before->data_ticks,
                   after->ticks - before->ticks);
}

rate_load rate_load_nominal(const cw_bus_stats *before, const cw_bus_stats *after)
{
    const uint64_t bits = after->busy_bits - before->busy_bits;
    const uint64_t ticks = after->busy_ticks - before->busy_ticks;
    const rate_load data = rate_load_data(before, after);

    return load_of(bits > data.bits ? bits - data.bits : 0,
                   ticks > data.ticks ? ticks - data.ticks : 0, after->ticks - before->ticks);
}
