/* SPDX-License-Identifier: MIT
 *
 * wire.h - the position of the wire in time. It is always between two bits: one has ended at the
 * present tick, and the next one begins at it.
 */
#ifndef CANWIRE_TIME_WIRE_H
#define CANWIRE_TIME_WIRE_H

#include "time/rate.h"

typedef struct cw_wire_time {
    uint64_t now;
    cw_rate rate;
    uint32_t short_by; /* ticks by which the bit that begins now is shorter than others (D10) */
} cw_wire_time;

/* Returns the time at tick 0. */
static inline cw_wire_time cw_wire_begin(cw_rate rate)
{
    return (cw_wire_time){.now = 0, .rate = rate};
}

static inline uint64_t cw_wire_now(const cw_wire_time *t)
{
    return t->now;
}

static inline cw_rate cw_wire_rate(const cw_wire_time *t)
{
    return t->rate;
}

/* Goes to a tick, and back, for what happens in the middle of a bit time. */
static inline void cw_wire_go_to(cw_wire_time *t, uint64_t tick)
{
    t->now = tick;
}

/* Moves on by that many bits. */
static inline void cw_wire_pass(cw_wire_time *t, uint64_t bits)
{
    t->now += cw_rate_ticks(t->rate, bits);
}

/* Returns the tick at which that many bits to come will have passed. */
static inline uint64_t cw_wire_tick(const cw_wire_time *t, uint64_t bits)
{
    return t->now + cw_rate_ticks(t->rate, bits);
}

/* Returns the same for any number of bits, and CW_NEVER beyond the end of time. */
static inline uint64_t cw_wire_tick_or_never(const cw_wire_time *t, uint64_t bits)
{
    return cw_after(t->now, cw_rate_ticks_or_never(t->rate, bits));
}

/* Returns the tick at which the bit that begins now ends. */
static inline uint64_t cw_wire_bit_end(const cw_wire_time *t)
{
    return cw_wire_tick(t, 1) - t->short_by;
}

/* Ends the bit that has begun. */
static inline void cw_wire_end_bit(cw_wire_time *t)
{
    t->now = cw_wire_bit_end(t);
    t->short_by = 0;
}

/* Returns true when that many bits will have passed by a tick, which has not passed yet. */
static inline bool cw_wire_fits(const cw_wire_time *t, uint64_t bits, uint64_t tick)
{
    return tick - t->now >= cw_rate_ticks(t->rate, bits);
}

/* Returns true when one nominal bit will have passed by any tick. */
static inline bool cw_wire_fits_bit(const cw_wire_time *t, uint64_t tick)
{
    return tick >= t->now && tick - t->now >= cw_rate_ticks(t->rate, 1);
}

/* Returns the whole bits up to a tick, which has not passed yet. */
static inline uint64_t cw_wire_bits_to(const cw_wire_time *t, uint64_t tick)
{
    return cw_rate_bits(t->rate, tick - t->now);
}

/* Returns the whole bits up to any tick, and CW_BITS_FOREVER for CW_NEVER. */
static inline uint64_t cw_wire_bits_before(const cw_wire_time *t, uint64_t tick)
{
    if (tick == CW_NEVER)
        return CW_BITS_FOREVER;
    return tick > t->now ? cw_rate_bits(t->rate, tick - t->now) : 0;
}

/* Returns the same, with the bit that the tick is in. */
static inline uint64_t cw_wire_bits_until(const cw_wire_time *t, uint64_t tick)
{
    if (tick == CW_NEVER)
        return CW_BITS_FOREVER;
    return tick > t->now ? cw_rate_bits_begun(t->rate, tick - t->now) : 0;
}

#endif
