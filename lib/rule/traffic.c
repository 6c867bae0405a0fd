/* SPDX-License-Identifier: MIT
 *
 * traffic.c - frames that fault rules send: single and periodic ones, a babbling idiot, load
 * up to a target, replies.
 */
#include "rule/private.h"

#define LOAD_ID_FIRST 0x600u /* random identifiers stay out of the way of usual traffic */
#define LOAD_ID_COUNT 0x1F0u

static void send(cw_bus *bus, unsigned rule, const cw_frame *frame)
{
    unsigned node = bus->rules.rules[rule].rule.node;
    bus->work++;
    bus->nodes[node].stats.made_by_rules++;
    cw_queue_frame(bus, node, frame, cw_now(bus), rule + 1);
}

/* A node that cannot take anything is not asked in every bit. */
static bool can_take(const cw_bus *bus, const cw_rule_state *s)
{
    const bus_node *n = &bus->nodes[s->rule.node];
    return s->outstanding == 0 && cw_node_attached(bus, s->rule.node) &&
           !(n->mac.modes & CW_MODE_LISTEN_ONLY) &&
           cw_mac_state(&n->mac) != CW_STATE_BUS_OFF && n->queue.count < n->queue_limit;
}

void cw_send_periodically(cw_bus *bus, unsigned rule)
{
    cw_rule_state *s = &bus->rules.rules[rule];
    if (s->next_at > cw_now(bus))
        return;
    send(bus, rule, &s->rule.frame);
    if (s->rule.period_ticks == 0) {
        s->active = false;
        return;
    }
    uint64_t passed = (cw_now(bus) - s->next_at) / s->rule.period_ticks;
    s->next_at += passed * s->rule.period_ticks; /* below a bit time it is one frame a bit */
    s->next_at = cw_after(s->next_at, s->rule.period_ticks);
    cw_rules_set_due(&bus->rules, s->next_at);
}

void cw_babble(cw_bus *bus, unsigned rule)
{
    const cw_rule_state *s = cw_rule_at(bus, rule);
    if (can_take(bus, s))
        send(bus, rule, &s->rule.frame);
}

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

/* All traffic counts: the generator fills up what is missing to its target. */
void cw_fill_up(cw_bus *bus, unsigned rule)
{
    cw_rule_state *s = cw_rule_at(bus, rule);
    if (!can_take(bus, s))
        return;
    uint64_t busy = cw_busy_bits_so_far(bus) - s->busy_base;
    uint64_t bits = cw_bits_so_far(bus) - s->bits_base;
    if (busy * 1000 > bits * s->rule.load_permille)
        return;
    const cw_frame frame = random_frame(&s->prng);
    send(bus, rule, &frame);
}

/* Idle bits after which the load has fallen to its target, at least one: the present tick has been
 * looked at. */
static uint64_t bits_to_target(const cw_bus *bus, const cw_rule_state *s)
{
    const uint64_t permille = s->rule.load_permille;
    uint64_t busy = (cw_busy_bits_so_far(bus) - s->busy_base) * 1000;
    uint64_t target = (cw_bits_so_far(bus) - s->bits_base) * permille;
    if (busy <= target)
        return 1;
    return permille ? (busy - target + permille - 1) / permille : CW_QUIET_FOREVER;
}

uint64_t cw_traffic_free(const cw_bus *bus, uint64_t bits, bool busy)
{
    const cw_rule_set *set = &bus->rules;
    for (unsigned i = 0; set->traffic_rules && i < set->awake_count; i++) {
        const cw_rule_state *s = &set->rules[set->awake[i]];
        if (!s->active || !cw_rule_is(s, CW_STEADY_TRAFFIC) || !can_take(bus, s))
            continue;
        if (s->rule.action == CW_ACTION_BABBLE)
            bits = cw_least(bits, 1);
        else if (!busy)
            bits = cw_least(bits, bits_to_target(bus, s));
    }
    return bits;
}
