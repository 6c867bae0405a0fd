/* SPDX-License-Identifier: MIT
 *
 * traffic.c - frames that fault rules send: single and periodic ones, a babbling idiot, load
 * up to a target, replies.
 */
#include "rule/private.h"

#define LOAD_ID_FIRST 0x600u /* random identifiers stay out of the way of usual traffic */
#define LOAD_ID_COUNT 0x1F0u

/* Queues a frame as the rule's traffic, so that it counts in `outstanding`. */
static void send(cw_rule_set *set, unsigned rule, const cw_frame *frame)
{
    const cw_rule_effects *effects = set->bus.effects;
    unsigned node = set->rules[rule].rule.node;
    set->work++;
    effects->count_made(set->bus.self, node, CW_SIDE_TX);
    effects->queue(set->bus.self, node, frame, cw_rules_now(set), rule + 1);
    if (cw_rule_is(&set->rules[rule], CW_DEVIATES))
        cw_rule_wake(set, rule); /* no fast path has its bits */
}

/* Returns the time, and the busy part of it, since the load began. */
static uint64_t time_of_load(const cw_rule_set *set, const cw_rule_state *s, uint64_t *busy)
{
    uint64_t time = set->bus.effects->time(set->bus.self, busy);
    *busy -= s->traffic.busy_base;
    return time - s->traffic.time_base;
}

/* A node that cannot take a frame is not asked in every bit. */
static bool can_take(const cw_rule_set *set, const cw_rule_state *s)
{
    return s->traffic.outstanding == 0 && set->bus.effects->can_take(set->bus.self, s->rule.node);
}

/* SEND and RAW_FRAME: sends a frame, and plans the next one by start and period. */
void cw_send_periodically(cw_rule_set *set, unsigned rule)
{
    cw_rule_state *s = &set->rules[rule];
    uint64_t *next_at = &s->traffic.next_at;
    const uint64_t period = s->rule.period_ticks;
    if (*next_at > cw_rules_now(set))
        return;
    send(set, rule, &s->rule.frame);
    if (period == 0) {
        s->active = false;
        return;
    }
    uint64_t passed = (cw_rules_now(set) - *next_at) / period;
    *next_at += passed * period; /* below a bit time this sends one frame a bit */
    *next_at = cw_after(*next_at, period);
    cw_rules_set_due(set, *next_at);
}

/* BABBLE: sends the frame again as soon as the last one is gone. */
void cw_babble(cw_rule_set *set, unsigned rule)
{
    const cw_rule_state *s = cw_rule_at(set, rule);
    if (can_take(set, s))
        send(set, rule, &s->rule.frame);
}

/* Draws a frame of 0 to 8 bytes for the load. */
static cw_frame random_frame(cw_prng *prng)
{
    uint64_t draw = cw_prng_next(prng);
    uint64_t data = cw_prng_next(prng);
    cw_frame frame = {.id = LOAD_ID_FIRST + (uint32_t)(draw % LOAD_ID_COUNT),
                      .dlc = (uint8_t)(draw >> 32) % 9};
    for (unsigned i = 0; i < frame.dlc; i++)
        frame.data[i] = (uint8_t)(data >> (8 * i));
    return frame;
}

/* All traffic counts: the generator sends what is missing to its target. */
void cw_fill_up(cw_rule_set *set, unsigned rule)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    if (!can_take(set, s))
        return;
    uint64_t busy;
    uint64_t time = time_of_load(set, s, &busy);
    if (busy * 1000 > time * s->rule.load_permille)
        return;
    const cw_frame frame = random_frame(&s->prng);
    send(set, rule, &frame);
}

/* Returns the idle bits after which the load has fallen to its target, at least one: the present
 * tick has been looked at. */
static uint64_t bits_to_target(const cw_rule_set *set, const cw_rule_state *s)
{
    const uint64_t falls = (uint64_t)s->rule.load_permille * set->bus.unit; /* in each bit */
    uint64_t busy;
    uint64_t target = time_of_load(set, s, &busy) * s->rule.load_permille;
    busy *= 1000;
    if (busy <= target)
        return 1;
    return falls ? (busy - target + falls - 1) / falls : CW_QUIET_FOREVER;
}

uint64_t cw_traffic_free(const cw_rule_set *set, uint64_t bits, bool busy)
{
    for (unsigned i = 0; set->traffic_rules && i < set->awake_count; i++) {
        const cw_rule_state *s = &set->rules[set->awake[i]];
        if (!s->active || !cw_rule_is(s, CW_STEADY_TRAFFIC) || !can_take(set, s))
            continue;
        if (s->rule.action == CW_ACTION_BABBLE)
            bits = cw_least(bits, 1);
        else if (!busy)
            bits = cw_least(bits, bits_to_target(set, s));
    }
    return bits;
}
