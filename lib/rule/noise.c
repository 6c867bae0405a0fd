/* SPDX-License-Identifier: MIT
 *
 * noise.c - bits flipped at random, single ones or bursts.
 *
 * Each bit of bus time costs a draw, and nearly all draws flip nothing. So the draws of bits to
 * come are looked at beforehand. Up to the first one that flips, the bus may go as if there were no
 * noise. The look changes nothing; the draws are consumed when their bits have passed.
 */
#include "rule/private.h"

#include "format/bitset.h"

#define LOOK_AHEAD_BITS 4096u
#define FIRST_LOOK_BITS 128u /* about a frame */
#define LOOK_AHEAD_DRAWS 65536u /* draws of all rules: CW_RULES_MAX with a draw for each node */
#define DRAWS_OF_A_PIECE 64u    /* draws of a unit of work */

/* Returns the draws of one bit: one for the wire, or one for each node. */
static unsigned draws_of_bit(const cw_rule_set *set, const cw_rule_state *s)
{
    return s->rule.at == 0 ? 1 : cw_count_bits(s->rule.at & set->bus.all);
}

/* Draws for one level: true flips it, or begins a burst. */
static bool draw(const cw_rule *r, cw_prng *prng)
{
    return cw_prng_next(prng) < r->error_rate;
}

/* Makes the draws of one bit. Returns the nodes whose level is flipped, or where a burst begins. */
static inline uint64_t draw_bit(const cw_rule_set *set, const cw_rule *r, cw_prng *prng)
{
    uint64_t flipped = 0;
    if (r->at == 0)
        return draw(r, prng) ? UINT64_MAX : 0;
    for (uint64_t rest = r->at & set->bus.all; rest; rest &= rest - 1)
        if (draw(r, prng))
            flipped |= rest & (~rest + 1);
    return flipped;
}

/* ---- Bursts ---------------------------------------------------------------------------------- */

/* Returns a burst, the first bit lowest. Its first and last bit are 1. It follows from the state of
 * the stream, so that each bit costs as many draws as without bursts. */
static uint16_t shape_burst(const cw_rule *r, uint64_t state, unsigned node)
{
    cw_prng prng = {.state = ~state ^ (uint64_t)node << 56};
    const uint64_t bits = cw_prng_next(&prng);
    const unsigned length = r->burst_least + (unsigned)(cw_prng_next(&prng) %
                                                        (r->burst_most - r->burst_least + 1u));
    const uint32_t last = UINT32_C(1) << (length - 1);
    return (uint16_t)((bits & (last - 1)) | last | 1u);
}

/* Takes the next bit of the bursts under way. Returns the nodes whose level is flipped. */
static uint64_t go_on_with_bursts(cw_rule_state *s)
{
    uint64_t flipped = 0;
    for (uint64_t rest = s->noise.in_burst; rest; rest &= rest - 1) {
        const unsigned i = cw_lowest_node(rest);
        if (s->noise.bursts[i] & 1u)
            flipped |= cw_node_bit(i);
        s->noise.bursts[i] >>= 1;
        if (s->noise.bursts[i] == 0)
            s->noise.in_burst &= ~cw_node_bit(i);
    }
    return flipped;
}

/* A node's burst is ready when it begins, so that later bits cost no draws. */
static void begin_bursts(cw_rule_state *s, uint64_t nodes)
{
    for (uint64_t rest = nodes; rest; rest &= rest - 1) {
        const unsigned i = cw_lowest_node(rest);
        s->noise.bursts[i] = shape_burst(&s->rule, s->prng.state, i);
        s->noise.in_burst |= cw_node_bit(i);
    }
}

/* No burst begins while one is under way. */
static uint64_t shape(cw_rule_state *s, uint64_t drawn)
{
    const bool wire = s->rule.at == 0;
    if (s->rule.burst_most == 0)
        return drawn;
    begin_bursts(s, (wire ? drawn & 1u : drawn) & ~s->noise.in_burst);
    const uint64_t flipped = go_on_with_bursts(s);
    return wire && flipped ? UINT64_MAX : flipped;
}

/* Each flipped bit is a hit, and the last one allowed ends the noise. */
static void flip(cw_rule_set *set, cw_rule_state *s, uint64_t *levels, uint64_t flipped)
{
    *levels ^= flipped;
    cw_rule_note_hit(set, cw_rule_index(set, s), cw_rules_bit_end(set));
    cw_rule_count_hit(set, cw_rule_index(set, s), cw_rules_bit_end(set));
    if (cw_rule_is_over(s))
        cw_rule_end_action(set, cw_rule_index(set, s));
}

/* NOISE: flips the levels that the draws of this bit choose, or begins bursts there. */
void cw_flip_at_random(cw_rule_set *set, cw_rule_state *s, uint64_t *levels, uint64_t nodes)
{
    (void)nodes; /* the rule draws its nodes */
    const uint64_t flipped = shape(s, draw_bit(set, &s->rule, &s->prng));
    if (flipped)
        flip(set, s, levels, flipped);
}

/* ---- Looking ahead --------------------------------------------------------------------------- */

/* Returns true for noise that can be looked at ahead: nothing but its draws decides. */
static bool is_steady_noise(const cw_rule_state *s)
{
    return cw_rule_is(s, CW_RANDOM_BITS) && !s->for_attempt && cw_rule_is_plain(s);
}

/* Returns the first bit that a rule flips, of that many after those looked at before. Returns their
 * number when it flips none. It may flip any bit of a burst. */
static uint64_t first_flip(const cw_rule_set *set, const cw_rule_state *s, uint64_t from,
                           uint64_t bits)
{
    cw_prng prng = s->prng;
    if (s->noise.in_burst)
        return 0;
    cw_prng_skip(&prng, from * draws_of_bit(set, s));
    for (uint64_t i = 0; i < bits; i++)
        if (draw_bit(set, &s->rule, &prng))
            return i;
    return bits;
}

/* Returns the same for all rules. */
static uint64_t first_flip_of_any(const cw_rule_set *set, uint64_t from, uint64_t bits)
{
    for (unsigned i = 0; bits > 0 && i < set->awake_count; i++) {
        const cw_rule_state *s = &set->rules[set->awake[i]];
        if (is_steady_noise(s))
            bits = first_flip(set, s, from, bits);
    }
    return bits;
}

/* Looks further each time. So a rule that seldom flips a bit is not asked for many of them when
 * another one flips the next. */
uint64_t cw_noise_free(const cw_rule_set *set, uint64_t bits)
{
    if (set->noise_rules == 0)
        return bits;
    const uint64_t most = LOOK_AHEAD_DRAWS / ((uint64_t)set->noise_rules * set->bus.node_count);
    bits = cw_least(bits, cw_least(most, LOOK_AHEAD_BITS));
    for (uint64_t from = 0, piece = FIRST_LOOK_BITS; from < bits; from += piece, piece *= 2) {
        const uint64_t asked = cw_least(piece, bits - from);
        const uint64_t free = first_flip_of_any(set, from, asked);
        if (free < asked)
            return from + free;
    }
    return bits;
}

void cw_noise_pass(cw_rule_set *set, uint64_t bits)
{
    for (unsigned i = 0; set->noise_rules && i < set->awake_count; i++) {
        cw_rule_state *s = &set->rules[set->awake[i]];
        if (!is_steady_noise(s))
            continue;
        const uint64_t draws = bits * draws_of_bit(set, s);
        cw_prng_skip(&s->prng, draws);
        set->work += draws / DRAWS_OF_A_PIECE;
    }
}
