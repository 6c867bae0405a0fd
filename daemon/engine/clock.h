/* SPDX-License-Identifier: MIT
 *
 * clock.h - bus time and the clocks of the machine.
 */
#ifndef CANWIRE_ENGINE_CLOCK_H
#define CANWIRE_ENGINE_CLOCK_H

#include "base/moment.h"

/* The place of bus time on the machine's clocks, in ns. */
typedef struct engine_clock {
    int64_t epoch_ns;           /* CLOCK_MONOTONIC at bus time 0 */
    int64_t realtime_offset_ns; /* CLOCK_REALTIME minus CLOCK_MONOTONIC */
} engine_clock;

/* A moment on both clocks; time stamps of frames are CLOCK_REALTIME. */
typedef struct clock_pair {
    int64_t monotonic_ns;
    int64_t realtime_ns;
} clock_pair;

clock_pair clock_read(void);

/* Makes the present moment bus time 0. */
void clock_begin(engine_clock *c);

/* Takes the constants of virtual time in place of the present moment. */
void clock_begin_virtual(engine_clock *c);

/* Returns a moment of virtual time, bus time in ns. */
clock_pair clock_at(const engine_clock *c, int64_t bus_ns);

/* Follows CLOCK_REALTIME, which somebody may have set: recordings adopt it when it differs by a
 * millisecond. */
void clock_follow(engine_clock *c, const clock_pair *now);

/* Returns the tick at a time, 12.5 ns each. It is rounded down: the bus is never ahead of the
 * clock. */
uint64_t clock_tick(const engine_clock *c, int64_t monotonic_ns);

/* Returns CLOCK_MONOTONIC at a tick. It is rounded up: a timer is never early. */
int64_t clock_monotonic_ns(const engine_clock *c, uint64_t tick);

/* Returns CLOCK_REALTIME at a tick, in ns since 1970. */
uint64_t clock_realtime_ns(const engine_clock *c, uint64_t tick);

#endif
