/* SPDX-License-Identifier: MIT
 *
 * local.h - the local time of a node: a counter that its own clock drives (L2). Arithmetic is exact
 * where the clock stays as it is.
 */
#ifndef CANWIRE_TIME_LOCAL_H
#define CANWIRE_TIME_LOCAL_H

#include "canwire.h"

/* A moment of bus time, to 2^-32 ticks. */
typedef struct cw_instant {
    uint64_t tick;
    uint32_t fraction;
} cw_instant;

/* A counter that does not wrap; its host sees the lowest bits of it. */
typedef struct cw_local_clock {
    cw_span unit;       /* of the counter, as long as it is now */
    cw_span nominal;    /* ... and as long as it is by a time quantum of the node of ... */
    cw_span quantum;
    cw_instant since;
    uint64_t count;     /* whole units up to then ... */
    uint64_t part;      /* ... and the one under way, less than `unit` */
} cw_local_clock;

/* Starts a counter at tick 0. unit: at least CW_TICK. quantum: of the node. */
cw_local_clock cw_local_begin(cw_span unit, cw_span quantum, uint64_t start);

/* Returns the instant a span, not negative, after a tick. */
static inline cw_instant cw_instant_after(uint64_t tick, cw_span span)
{
    return (cw_instant){.tick = tick + (uint64_t)(span / CW_TICK),
                        .fraction = (uint32_t)(span % CW_TICK)};
}

/* Returns the counter at an instant; before `since` it is that of `since`. */
uint64_t cw_local_at(const cw_local_clock *clock, cw_instant instant);

/* Returns the first tick at or after the instant at which the counter has a value; CW_NEVER beyond
 * the end of time. An earlier value has the tick of `since`. */
uint64_t cw_local_tick(const cw_local_clock *clock, uint64_t value);

/* Lets the clock go on at the rate that belongs to another time quantum, from an instant on. */
void cw_local_retime(cw_local_clock *clock, cw_span quantum, cw_instant from);

/* Does this when the time quantum alone is another one, with as many clocks of the node as make the
 * given unit. */
void cw_local_give_unit(cw_local_clock *clock, cw_span unit, cw_span quantum);

/* Returns a * b / c, rounded down; UINT64_MAX when that is too large. c is not 0. */
uint64_t cw_multiply_divide(uint64_t a, uint64_t b, uint64_t c);

#endif
