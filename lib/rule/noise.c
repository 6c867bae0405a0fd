/* SPDX-License-Identifier: MIT
 *
 * noise.c - single bits flipped at random.
 *
 * Each bit of bus time costs a draw, and nearly all of them flip nothing. So the draws of bits to
 * come are looked at beforehand: up to the first that flips, the bus may go as if there were no
 * noise. A draw that has been looked at stays the draw of its bit.
 */
#include "rule/private.h"

#include "format/bitset.h"

#define LOOK_AHEAD_BITS 4096u
#define LOOK_AHEAD_DRAWS 65536u /* of all rules: CW_RULES_MAX with a draw for each node */
#define DRAWS_OF_A_PIECE 64u    /* of work */

/* One draw for the wire, or one for each node. */
static unsigned draws_of_bit(const cw_bus *bus, const cw_fault *f)
{
    return f->rule.at == 0 ? 1 : cw_count_bits(f->rule.at & bus->all);
}

static bool draw(cw_fault *f)
{
    return cw_prng_next(&f->prng) < f->rule.error_rate;
}

/* The draws of one bit; the nodes whose level is flipped. */
static uint64_t draw_bit(const cw_bus *bus, cw_fault *f)
{
    uint64_t flipped = 0;
    if (f->rule.at == 0)
        return draw(f) ? UINT64_MAX : 0;
    for (uint64_t rest = f->rule.at & bus->all; rest; rest &= rest - 1)
        if (draw(f))
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
    if (f->clear_bits > 0) {
        f->clear_bits--;
        return;
    }
    const uint64_t flipped = draw_bit(bus, f);
    if (flipped)
        flip(bus, f, levels, flipped);
}

/* ---- Looking ahead --------------------------------------------------------------------------- */

static bool is_steady_noise(const cw_fault *f)
{
    return cw_fault_is(f, CW_RANDOM_BITS) && f->active && !f->for_attempt && !f->hit_now &&
           f->bits_left == 0 && f->bound == 0;
}

/* A line that is stuck recessive changes nothing while nobody drives the wire dominant. */
static bool is_stuck_recessive(const cw_fault *f)
{
    return cw_fault_is(f, CW_ON_LINE) && f->rule.level == CW_RECESSIVE && f->active &&
           !f->for_attempt && !f->hit_now && f->bits_left == 0 && f->bound == 0;
}

bool cw_fault_is_steady(const cw_bus *bus, bool level)
{
    const cw_fault_set *set = &bus->faults;
    for (unsigned i = 0; i < set->awake_count; i++) {
        const cw_fault *f = &set->faults[set->awake[i]];
        bool traffic = f->active && cw_fault_is(f, CW_STEADY_TRAFFIC);
        bool stuck = level == CW_RECESSIVE && is_stuck_recessive(f);
        /* one that is over falls asleep with a single bit */
        if (!traffic && !stuck && !is_steady_noise(f))
            return false;
    }
    return true;
}

bool cw_fault_rests(const cw_bus *bus)
{
    const cw_fault_set *set = &bus->faults;
    for (unsigned i = 0; i < set->awake_count; i++)
        if (!is_stuck_recessive(&set->faults[set->awake[i]]))
            return false;
    return true;
}

/* Draws for bits to come, up to that many or the first that flips. */
static uint64_t look_ahead(cw_bus *bus, cw_fault *f, uint64_t bits)
{
    const uint64_t known = f->clear_bits;
    while (f->clear_bits < bits) {
        const cw_prng before = f->prng;
        if (draw_bit(bus, f)) {
            f->prng = before;
            bits = f->clear_bits;
            break;
        }
        f->clear_bits++;
    }
    if (f->clear_bits > known)
        bus->work += (f->clear_bits - known) * draws_of_bit(bus, f) / DRAWS_OF_A_PIECE;
    return bits;
}

uint64_t cw_fault_noise_free(cw_bus *bus, uint64_t bits)
{
    cw_fault_set *set = &bus->faults;
    if (set->noise_rules == 0)
        return bits;
    const uint64_t most = LOOK_AHEAD_DRAWS / ((uint64_t)set->noise_rules * bus->node_count);
    for (unsigned i = 0; i < set->awake_count; i++) {
        cw_fault *f = &set->faults[set->awake[i]];
        if (is_steady_noise(f))
            bits = look_ahead(bus, f, cw_least(bits, cw_least(most, LOOK_AHEAD_BITS)));
    }
    return bits;
}

void cw_fault_pass_noise(cw_bus *bus, uint64_t bits)
{
    cw_fault_set *set = &bus->faults;
    for (unsigned i = 0; set->noise_rules && i < set->awake_count; i++) {
        cw_fault *f = &set->faults[set->awake[i]];
        if (is_steady_noise(f))
            f->clear_bits -= (uint32_t)bits;
    }
}

void cw_fault_forget_ahead(const cw_bus *bus, cw_fault *f)
{
    if (f->clear_bits == 0)
        return;
    cw_prng_back(&f->prng, (uint64_t)f->clear_bits * draws_of_bit(bus, f));
    f->clear_bits = 0;
}
