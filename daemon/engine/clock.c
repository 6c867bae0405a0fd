/* SPDX-License-Identifier: MIT
 *
 * clock.c - bus time and the clocks of the machine.
 */
#include "engine/clock.h"

#include "base/epoch.h"
#include "base/text/number.h"

#include <stdlib.h>

#define NS_PER_S INT64_C(1000000000)
#define CLOCK_STEP_NS 1000000 /* largest difference of wall clock and bus time in recordings */

clock_pair clock_read(void)
{
    return (clock_pair){.monotonic_ns = clock_ns(CLOCK_MONOTONIC),
                        .realtime_ns = clock_ns(CLOCK_REALTIME)};
}

void clock_begin(engine_clock *c)
{
    c->epoch_ns = clock_ns(CLOCK_MONOTONIC);
    c->realtime_offset_ns = clock_ns(CLOCK_REALTIME) - c->epoch_ns;
}

void clock_begin_virtual(engine_clock *c)
{
    c->epoch_ns = EPOCH_MONOTONIC_NS;
    c->realtime_offset_ns = EPOCH_REALTIME_NS - EPOCH_MONOTONIC_NS;
}

clock_pair clock_at(const engine_clock *c, int64_t bus_ns)
{
    const int64_t monotonic_ns = c->epoch_ns + bus_ns;
    return (clock_pair){.monotonic_ns = monotonic_ns,
                        .realtime_ns = monotonic_ns + c->realtime_offset_ns};
}

void clock_follow(engine_clock *c, const clock_pair *now)
{
    int64_t offset_ns = now->realtime_ns - now->monotonic_ns;
    if (llabs(offset_ns - c->realtime_offset_ns) > CLOCK_STEP_NS)
        c->realtime_offset_ns = offset_ns;
}

uint64_t clock_tick(const engine_clock *c, int64_t monotonic_ns)
{
    int64_t ns = monotonic_ns - c->epoch_ns;
    return ns > 0 ? (uint64_t)ns * 2 / 25 : 0;
}

int64_t clock_monotonic_ns(const engine_clock *c, uint64_t tick)
{
    return c->epoch_ns + (int64_t)((tick * 25 + 1) / 2);
}

uint64_t clock_realtime_ns(const engine_clock *c, uint64_t tick)
{
    int64_t ns = c->epoch_ns + c->realtime_offset_ns + (int64_t)text_ticks_ns(tick);
    return ns > 0 ? (uint64_t)ns : 0;
}
