/* SPDX-License-Identifier: MIT
 *
 * local.c - the local time of a node (L2), and the global time by two captures (L7).
 */
#include "time/local.h"

#include <assert.h>

/* ---- Numbers of 128 bits --------------------------------------------------------------------- */

typedef struct wide {
    uint64_t high;
    uint64_t low;
} wide;

/* Returns the product in 128 bits, by hand: not every compiler has such a type. */
static wide multiply(uint64_t a, uint64_t b)
{
    const uint64_t a_low = a & UINT32_MAX, a_high = a >> 32;
    const uint64_t b_low = b & UINT32_MAX, b_high = b >> 32;
    const uint64_t low = a_low * b_low;
    const uint64_t middle = a_high * b_low + (low >> 32);
    const uint64_t other = a_low * b_high + (middle & UINT32_MAX);
    return (wide){.high = a_high * b_high + (middle >> 32) + (other >> 32),
                  .low = other << 32 | (low & UINT32_MAX)};
}

/* Add to and subtract from a number of 128 bits. */
static wide local_add(wide a, uint64_t b)
{
    const uint64_t low = a.low + b;
    return (wide){.high = a.high + (low < b), .low = low};
}

static wide subtract(wide a, uint64_t b)
{
    return (wide){.high = a.high - (a.low < b), .low = a.low - b};
}

/* Returns the quotient, which must fit: a.high < d. */
static uint64_t divide(wide a, uint64_t d, uint64_t *rest)
{
    uint64_t quotient = 0;
    if (a.high == 0) {
        *rest = a.low % d;
        return a.low / d;
    }
    for (unsigned i = 0; i < 64; i++) {
        const bool carry = a.high >> 63;
        a.high = a.high << 1 | a.low >> 63;
        a.low <<= 1;
        const bool fits = carry || a.high >= d;
        a.high -= fits ? d : 0;
        quotient = quotient << 1 | fits;
    }
    *rest = a.high;
    return quotient;
}

uint64_t cw_multiply_divide(uint64_t a, uint64_t b, uint64_t c)
{
    uint64_t rest;
    const wide product = multiply(a, b);
    return product.high < c ? divide(product, c, &rest) : UINT64_MAX;
}

/* ---- The counter ----------------------------------------------------------------------------- */

static bool is_before(cw_instant a, cw_instant b)
{
    return a.tick != b.tick ? a.tick < b.tick : a.fraction < b.fraction;
}

/* Returns the time from the start of the unit that `since` is in. */
static wide elapsed(const cw_local_clock *c, cw_instant instant)
{
    const uint64_t ticks = instant.tick - c->since.tick;
    const wide whole = {.high = ticks >> 32, .low = ticks << 32};
    return local_add(subtract(local_add(whole, instant.fraction), c->since.fraction), c->part);
}

cw_local_clock cw_local_begin(cw_span unit, cw_span quantum, uint64_t start)
{
    return (cw_local_clock){.unit = unit, .nominal = unit, .quantum = quantum, .count = start};
}

uint64_t cw_local_at(const cw_local_clock *c, cw_instant instant)
{
    uint64_t rest;
    if (is_before(instant, c->since))
        return c->count;
    return c->count + divide(elapsed(c, instant), (uint64_t)c->unit, &rest);
}

uint64_t cw_local_tick(const cw_local_clock *c, uint64_t value)
{
    if (value <= c->count)
        return c->since.tick;
    wide span = multiply(value - c->count, (uint64_t)c->unit);
    span = local_add(subtract(span, c->part), c->since.fraction);
    span = local_add(span, CW_TICK - 1); /* rounds up */
    if (span.high >> 32)
        return CW_NEVER;
    return cw_after(c->since.tick, span.high << 32 | span.low >> 32);
}

/* Returns the unit by a time quantum, to the nearest 2^-32 tick. */
static cw_span unit_by(const cw_local_clock *c, cw_span quantum)
{
    const uint64_t of = (uint64_t)c->quantum;
    uint64_t rest;
    if (quantum == c->quantum)
        return c->nominal;
    const wide product = local_add(multiply((uint64_t)c->nominal, (uint64_t)quantum), of / 2);
    const uint64_t unit = product.high < of ? divide(product, of, &rest) : INT64_MAX;
    return unit < CW_TICK / 4 ? CW_TICK / 4 : unit > INT64_MAX ? INT64_MAX : (cw_span)unit;
}

void cw_local_retime(cw_local_clock *c, cw_span quantum, cw_instant from)
{
    const cw_span unit = unit_by(c, quantum);
    if (unit == c->unit)
        return;
    if (!is_before(from, c->since)) {
        c->count += divide(elapsed(c, from), (uint64_t)c->unit, &c->part);
        c->since = from;
    }
    c->part = cw_multiply_divide(c->part, (uint64_t)unit, (uint64_t)c->unit);
    c->unit = unit;
}

void cw_local_give_unit(cw_local_clock *c, cw_span unit, cw_span quantum)
{
    c->nominal = unit;
    c->quantum = quantum;
}

/* ---- Global time ----------------------------------------------------------------------------- */

/* Returns the values that a counter of 1 to 64 bits can have, as a mask. */
static uint64_t mask_of(unsigned bits)
{
    return UINT64_MAX >> (64 - bits);
}

bool cw_global_time(const cw_time_pair pairs[2], unsigned bits_a, unsigned bits_b, uint64_t b,
                    uint64_t *a)
{
    const uint64_t of_a = (pairs[1].a - pairs[0].a) & mask_of(bits_a);
    const uint64_t of_b = (pairs[1].b - pairs[0].b) & mask_of(bits_b);
    assert(bits_a >= 1 && bits_a <= 64 && bits_b >= 1 && bits_b <= 64);
    if (of_b == 0)
        return false;
    const uint64_t since = cw_multiply_divide((b - pairs[1].b) & mask_of(bits_b), of_a, of_b);
    *a = (since + pairs[1].a) & mask_of(bits_a);
    return true;
}
