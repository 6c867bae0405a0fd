/* SPDX-License-Identifier: MIT
 *
 * noise.c - single bits flipped at random.
 *
 * Each bit of bus time costs a draw, and nearly all of them flip nothing. So the draws of bits to
 * come are looked at beforehand: up to the first that flips, the bus may go as if there were no
 * noise. To look at them changes nothing; they are consumed when their bits have passed.
 */
#include "rule/private.h"

#include "format/bitset.h"

#define LOOK_AHEAD_BITS 4096u
#define FIRST_LOOK_BITS 128u /* about a frame */
#define LOOK_AHEAD_DRAWS 65536u /* of all rules: CW_RULES_MAX with a draw for each node */
#define DRAWS_OF_A_PIECE 64u    /* of work */

/* One draw for the wire, or one for each node. */
static unsigned draws_of_bit(const cw_bus *bus, const cw_fault *f)
{
    return f->rule.at == 0 ? 1 : cw_count_bits(f->rule.at & bus->all);
}

static bool draw(const cw_rule *r, cw_prng *prng)
{
    return cw_prng_next(prng) < r->error_rate;
}

/* The draws of one bit; the nodes whose level is flipped. */
static inline uint64_t draw_bit(const cw_bus *bus, const cw_rule *r, cw_prng *prng)
{
    uint64_t flipped = 0;
    if (r->at == 0)
        return draw(r, prng) ? UINT64_MAX : 0;
    for (uint64_t rest = r->at & bus->all; rest; rest &= rest - 1)
        if (draw(r, prng))
            flipped |= rest & (~rest + 1);
    return flipped;
}

static void flip(cw_bus *bus, cw_fault *f, uint64_t *levels, uint64_t flipped)
{
    *levels ^= flipped;
    f->hit_now = true;
    cw_fault_count_hit(bus, cw_fault_index(bus, f), cw_bit_end(bus));
    if (cw_fault_is_over(f))
        cw_fault_end_action(bus, cw_fault_index(bus, f));
}

void cw_flip_at_random(cw_bus *bus, cw_fault *f, uint64_t *levels, uint64_t nodes)
{
    (void)nodes; /* those that it draws */
    const uint64_t flipped = draw_bit(bus, &f->rule, &f->prng);
    if (flipped)
        flip(bus, f, levels, flipped);
}

/* ---- Looking ahead --------------------------------------------------------------------------- */

static bool is_steady_noise(const cw_fault *f)
{
    return cw_fault_is(f, CW_RANDOM_BITS) && f->active && !f->for_attempt && !f->hit_now &&
           f->bits_left == 0 && f->bound == 0;
}

/* The first bit that a rule flips, of so many behind those that have been looked at; else the
 * number of them. */
static uint64_t first_flip(const cw_bus *bus, const cw_fault *f, uint64_t from, uint64_t bits)
{
    cw_prng prng = f->prng;
    cw_prng_skip(&prng, from * draws_of_bit(bus, f));
    for (uint64_t i = 0; i < bits; i++)
        if (draw_bit(bus, &f->rule, &prng))
            return i;
    return bits;
}

/* The same for all rules. */
static uint64_t first_flip_of_any(const cw_bus *bus, uint64_t from, uint64_t bits)
{
    const cw_fault_set *set = &bus->faults;
    for (unsigned i = 0; bits > 0 && i < set->awake_count; i++) {
        const cw_fault *f = &set->faults[set->awake[i]];
        if (is_steady_noise(f))
            bits = first_flip(bus, f, from, bits);
    }
    return bits;
}

/* Looks further each time, so that a rule which seldom flips a bit is not asked for many of them
 * when another one flips the next. */
uint64_t cw_noise_free(const cw_bus *bus, uint64_t bits)
{
    const cw_fault_set *set = &bus->faults;
    if (set->noise_rules == 0)
        return bits;
    const uint64_t most = LOOK_AHEAD_DRAWS / ((uint64_t)set->noise_rules * bus->node_count);
    bits = cw_least(bits, cw_least(most, LOOK_AHEAD_BITS));
    for (uint64_t from = 0, piece = FIRST_LOOK_BITS; from < bits; from += piece, piece *= 2) {
        const uint64_t asked = cw_least(piece, bits - from);
        const uint64_t free = first_flip_of_any(bus, from, asked);
        if (free < asked)
            return from + free;
    }
    return bits;
}

void cw_noise_pass(cw_bus *bus, uint64_t bits)
{
    cw_fault_set *set = &bus->faults;
    for (unsigned i = 0; set->noise_rules && i < set->awake_count; i++) {
        cw_fault *f = &set->faults[set->awake[i]];
        if (!is_steady_noise(f))
            continue;
        const uint64_t draws = bits * draws_of_bit(bus, f);
        cw_prng_skip(&f->prng, draws);
        bus->work += draws / DRAWS_OF_A_PIECE;
    }
}
