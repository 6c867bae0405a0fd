/* SPDX-License-Identifier: MIT
 *
 * in_time.c - the actions of fault rules on levels, where nodes have clocks of their own.
 *
 * A rule on a position acts from the start of the transmitter's bit to its end. All others act for
 * bit times of the bus, which belong to no node.
 */
#include "rule/private.h"

#define ALL_NODES UINT64_MAX
#define RAMP_STEPS 65536u

/* ---- What an action does to a level ---------------------------------------------------------- */

/* Asks the action itself: it says what it makes of each level. */
static cw_disturb_effect effect_now(cw_rule_set *set, cw_rule_state *s)
{
    uint64_t dominant = 0, recessive = 1;
    s->does->levels(set, s, &dominant, 1);
    s->does->levels(set, s, &recessive, 1);
    if (dominant == recessive)
        return dominant ? CW_DISTURB_RECESSIVE : CW_DISTURB_DOMINANT;
    return dominant ? CW_DISTURB_INVERT : CW_DISTURB_NOTHING;
}

/* Returns the length of a transmitter's bit that begins now (D10). */
static cw_span length_of_bit(const cw_rule_set *set, unsigned node)
{
    return set->bus.divided ? set->bus.effects->bit_length(set->bus.self, node)
                            : cw_rule_bit_time(set);
}

/* ---- Pulses ---------------------------------------------------------------------------------- */

/* Puts a pulse into the bit that begins at a moment. */
static void pulse(cw_rule_set *set, cw_disturbances *all, unsigned rule, cw_span begin, cw_span bit)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    const cw_rule *r = &s->rule;
    const cw_span part = bit / 1000 * r->pulse_permille + bit % 1000 * r->pulse_permille / 1000;
    const cw_span from = begin + r->pulse_offset + part;
    const uint64_t self = cw_node_bit(r->node);
    const bool wire = r->line == CW_LINE_WIRE && r->at == 0;
    const cw_disturbance d = {.begin = from, .end = from + r->pulse_length,
                              .lines = r->line == CW_LINE_TX ? self : 0,
                              .wires = wire ? s->on_wire : 0,
                              .samples = r->line == CW_LINE_RX ? self : r->at,
                              .source = s->position.source,
                              .effect = r->level ? CW_DISTURB_RECESSIVE : CW_DISTURB_DOMINANT,
                              .rule = (uint16_t)rule};
    cw_disturb(all, &d);
    s->position.pulses = false;
    s->position.bits_left = 0;
}

/* ---- Positions ------------------------------------------------------------------------------- */

/* Takes armings up to the start of the bit. Rules that fire when they are armed do so at bit times
 * of the bus. */
static void arm_for_bit(cw_rule_state *s, uint64_t tick)
{
    while (s->rule.trigger != CW_TRIGGER_ARMED && cw_rule_next_arming(s) <= tick)
        cw_rule_take_arming(s, tick);
}

/* Ends what rules do to the bits that end now, of these nodes. */
static void end_bits(cw_rule_set *set, cw_disturbances *all, uint64_t nodes, cw_span moment)
{
    for (unsigned i = 0; i < all->count; i++) {
        cw_disturbance *d = &all->list[i];
        if (d->end != CW_SPAN_MAX || !(nodes >> d->source & 1u))
            continue;
        d->end = moment;
        if (cw_rule_is(cw_rule_at(set, d->rule), CW_HAS_POSITION))
            cw_rule_at(set, d->rule)->position.disturbs = false;
    }
}

/* The rule acts on the source's bit that begins. Its end is known only when the next one begins. */
static void begin_bit(cw_rule_set *set, cw_disturbances *all, unsigned rule, cw_span moment)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    const cw_disturb_effect effect = effect_now(set, s);
    const cw_disturbance d = {.begin = moment, .end = CW_SPAN_MAX, .wires = s->on_wire,
                              .samples = s->at_nodes, .source = s->position.source,
                              .effect = (uint8_t)effect, .rule = (uint16_t)rule};
    if (effect != CW_DISTURB_NOTHING)
        cw_disturb(all, &d);
    s->position.disturbs = true;
    cw_rule_pass_bit(s, length_of_bit(set, s->position.source));
}

/* Transmitters that begin a frame together reach a position at nearly the same moment: that is one
 * match. */
static bool was_just_reached(const cw_rule_set *set, const cw_rule_state *s, uint64_t nodes)
{
    const uint64_t tick = cw_rules_now(set);
    const cw_position_kept *kept = &s->position;
    const bool other = !(nodes >> kept->source & 1u);
    return other && kept->disturbs && tick - kept->reached_at < cw_rules_bit_end(set) - tick;
}

/* Returns true when a transmitter reaches the position with a bit that begins at this tick. */
static bool reaches(cw_rule_set *set, unsigned rule, uint64_t nodes, uint64_t tick)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    const uint64_t there = s->position.bound & nodes ? cw_rule_nodes_at_position(set, s, nodes) : 0;
    if (!there || was_just_reached(set, s, there))
        return false;
    arm_for_bit(s, tick);
    const unsigned node = cw_lowest_node(there);
    return cw_rule_reaches(set, rule, there, tick,
                           set->bus.effects->end_of_bit(set->bus.self, node));
}

/* An edge has ended the bit of the hit early. */
static void end_hit(cw_rule_state *s, uint64_t nodes, uint64_t tick)
{
    if (s->hit_now && (nodes >> s->position.source & 1u))
        s->hit_at = cw_least(s->hit_at, tick);
}

/* Goes on with an action under way, or begins one, for bits of these nodes. */
static void begin_bits_of(cw_rule_set *set, cw_disturbances *all, unsigned rule, uint64_t nodes,
                          cw_span moment, uint64_t tick)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    end_hit(s, nodes, tick);
    bool begins = s->position.bits_left > 0 && (nodes >> s->position.source & 1u);
    if (reaches(set, rule, nodes, tick)) {
        cw_disturb_end(all, rule, moment);
        s->position.reached_at = cw_rules_now(set);
        begins = true;
    }
    if (begins && s->rule.action == CW_ACTION_PULSE)
        pulse(set, all, rule, moment, length_of_bit(set, s->position.source));
    else if (begins)
        begin_bit(set, all, rule, moment);
}

void cw_rules_begin_bits(cw_rule_set *set, cw_disturbances *all, uint64_t nodes, cw_span moment,
                         uint64_t tick, uint64_t driven)
{
    set->driven = cw_rules_change_lines(set, driven);
    end_bits(set, all, nodes, moment);
    for (unsigned i = 0; i < set->awake_count; i++) {
        const unsigned rule = set->awake[i];
        if (cw_rule_is(cw_rule_at(set, rule), CW_HAS_POSITION))
            begin_bits_of(set, all, rule, nodes, moment, tick);
    }
}

/* ---- Bit times ------------------------------------------------------------------------------- */

/* A stuck line lets go exactly when its time is over. */
static void hold_line(cw_rule_set *set, cw_disturbances *all, unsigned rule, cw_span begin,
                      cw_span end)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    const bool tx = s->rule.line == CW_LINE_TX;
    const bool level = tx ? cw_stuck_tx_level(set, s) : s->rule.level;
    if (s->rule.for_ticks && s->active_until < cw_rules_bit_end(set))
        end = begin + (cw_span)(s->active_until - cw_rules_now(set)) * CW_TICK;
    const cw_disturbance d = {.begin = begin, .end = end,
                              .lines = tx ? cw_node_bit(s->rule.node) & ~set->off : 0,
                              .wires = s->on_wire, .samples = s->at_nodes, .source = CW_NO_NODE,
                              .effect = level ? CW_DISTURB_RECESSIVE : CW_DISTURB_DOMINANT,
                              .rule = (uint16_t)rule};
    cw_disturb(all, &d);
}

/* The node drives its raw bit in place of what its controller drives. */
static void drive_raw(cw_rule_set *set, cw_disturbances *all, unsigned rule, cw_span begin,
                      cw_span end)
{
    const cw_rule_state *s = cw_rule_at(set, rule);
    const cw_disturbance d = {.begin = begin, .end = end,
                              .lines = cw_node_bit(s->rule.node) & ~set->cut, .source = CW_NO_NODE,
                              .effect = cw_raw_level(s) ? CW_DISTURB_RECESSIVE
                                                        : CW_DISTURB_DOMINANT,
                              .rule = (uint16_t)rule};
    cw_disturb(all, &d);
}

/* A pulse on the wire comes to all nodes at once: it belongs to no node. */
static void pulse_without_frame(cw_rule_set *set, cw_disturbances *all, unsigned rule,
                                cw_span begin, cw_span end)
{
    cw_rule_at(set, rule)->position.source = CW_NO_NODE;
    pulse(set, all, rule, begin, end - begin);
}

/* Noise draws once for each bit time, as on a bus with common bits. */
static void flip_at_random(cw_rule_set *set, cw_disturbances *all, unsigned rule, cw_span begin,
                           cw_span end)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    uint64_t flipped = 0;
    s->does->levels(set, s, &flipped, ALL_NODES);
    const cw_disturbance d = {.begin = begin, .end = end, .wires = s->on_wire ? flipped : 0,
                              .samples = s->on_wire ? 0 : flipped, .source = CW_NO_NODE,
                              .effect = CW_DISTURB_INVERT, .rule = (uint16_t)rule};
    if (flipped)
        cw_disturb(all, &d);
}

/* The quantum of a node goes evenly from one value to another. */
static void drift(cw_rule_set *set, unsigned rule)
{
    const cw_rule_state *s = cw_rule_at(set, rule);
    const cw_rule *r = &s->rule;
    const uint64_t left = s->active_until - cw_rules_bit_end(set);
    const uint64_t passed = s->active_until > cw_rules_bit_end(set) ? r->for_ticks - left
                                                                    : r->for_ticks;
    const int64_t steps = (int64_t)(passed / (r->for_ticks / RAMP_STEPS + 1));
    const int64_t most = (int64_t)(r->for_ticks / (r->for_ticks / RAMP_STEPS + 1));
    const cw_span step = (r->quantum_to - r->quantum_from) / most;
    set->bus.effects->retime(set->bus.self, r->nodes,
                             steps == most ? r->quantum_to : r->quantum_from + steps * step);
}

/* Ends what a rule did to a bit when the rule has been cleared or stopped meanwhile. */
static void end_stopped(cw_rule_set *set, cw_disturbances *all, cw_span moment)
{
    for (unsigned i = 0; i < all->count; i++) {
        cw_disturbance *d = &all->list[i];
        const cw_rule_state *s = cw_rule_at(set, d->rule);
        const bool disturbs = cw_rule_is(s, CW_HAS_POSITION) && s->position.disturbs;
        if (d->end == CW_SPAN_MAX && !disturbs)
            d->end = moment;
    }
}

void cw_rules_begin_bit_time(cw_rule_set *set, cw_disturbances *all, cw_span begin, cw_span end)
{
    end_stopped(set, all, begin);
    for (unsigned i = 0; i < set->awake_count; i++) {
        const unsigned rule = set->awake[i];
        cw_rule_state *s = cw_rule_at(set, rule);
        cw_rule_check_scope(set, rule);
        if (cw_rule_is(s, CW_HAS_POSITION) && s->position.pulses)
            pulse_without_frame(set, all, rule, begin, end);
        if (!s->active)
            continue;
        if (cw_rule_is(s, CW_ON_LINE))
            hold_line(set, all, rule, begin, end);
        else if (cw_rule_is(s, CW_RANDOM_BITS))
            flip_at_random(set, all, rule, begin, end);
        else if (cw_rule_is_raw(s))
            drive_raw(set, all, rule, begin, end);
        else if (s->rule.action == CW_ACTION_RAMP)
            drift(set, rule);
    }
}

/* ---- Edges ----------------------------------------------------------------------------------- */

/* Returns true for a rule on jitter that acts now. */
static bool delays_edges(const cw_rule_state *s)
{
    return s->used && s->active && s->rule.action == CW_ACTION_JITTER;
}

bool cw_rules_delay_edges(const cw_rule_set *set)
{
    for (unsigned i = 0; set->jitter && i < set->count; i++)
        if (delays_edges(&set->rules[i]))
            return true;
    return false;
}

cw_span cw_rules_edge_delay(cw_rule_set *set, unsigned node)
{
    cw_span late = 0;
    for (unsigned i = 0; set->jitter && i < set->count; i++) {
        cw_rule_state *s = cw_rule_at(set, i);
        if (delays_edges(s) && (s->rule.nodes >> node & 1u))
            late += (cw_span)(cw_prng_next(&s->prng) % ((uint64_t)s->rule.jitter + 1));
    }
    return late;
}
