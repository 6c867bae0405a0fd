/* SPDX-License-Identifier: MIT
 *
 * level.c - the actions of fault rules on levels: bits at a position, stuck lines, noise, topology.
 *
 * They act first on the lines from the nodes to the wire, then on the wire, then on the samples of
 * single nodes.
 */
#include "rule/private.h"

#define ALL_NODES UINT64_MAX
#define ROUNDING (CW_TICK / 16) /* of the bits of a rule that lasts for a time */

static cw_rule_state *awake_rule(cw_rule_set *set, unsigned i)
{
    return &set->rules[set->awake[i]];
}

static void set_level(uint64_t *levels, uint64_t nodes, bool level)
{
    *levels = level ? *levels | nodes : *levels & ~nodes;
}

/* ---- Stuck TX lines -------------------------------------------------------------------------- */

/* The transceiver releases the bus when its TXD has been dominant for too long. */
static bool stuck_tx_level(const cw_rule_state *s)
{
    const uint64_t timeout = s->rule.dominant_timeout;
    return timeout && s->line.dominant_ticks >= timeout ? CW_RECESSIVE : s->rule.level;
}

bool cw_stuck_tx_level(const cw_rule_set *set, cw_rule_state *s)
{
    const bool level = stuck_tx_level(s);
    if (level == CW_DOMINANT)
        s->line.dominant_ticks += cw_rules_bit_end(set) - cw_rules_now(set);
    return level;
}

/* Returns true for a stuck TX line: it changes what the node drives, not what is sampled. */
static bool is_stuck_tx(const cw_rule_state *s)
{
    return s->active && cw_rule_is(s, CW_ON_LINE) && s->rule.line == CW_LINE_TX;
}

uint64_t cw_rules_change_lines(cw_rule_set *set, uint64_t driven)
{
    for (unsigned i = 0; set->line_rules && i < set->awake_count; i++) {
        const cw_rule_state *s = awake_rule(set, i);
        if (is_stuck_tx(s))
            set_level(&driven, cw_node_bit(s->rule.node), stuck_tx_level(s));
    }
    set_level(&driven, set->off, CW_RECESSIVE);
    return set->raw_rules ? cw_raw_change_lines(set, driven) : driven;
}

void cw_rules_change_driven(cw_rule_set *set, cw_levels *levels)
{
    levels->driven = cw_rules_change_lines(set, levels->driven);
    for (unsigned i = 0; set->line_rules && i < set->awake_count; i++)
        if (is_stuck_tx(awake_rule(set, i)))
            (void)cw_stuck_tx_level(set, awake_rule(set, i));
}

/* ---- Positions ------------------------------------------------------------------------------- */

/* Returns true when the transmitter is at the position, by its own count, in a field that all nodes
 * are in. In the first bit of a delimiter no node may still drive a flag. */
static bool at_own_place(const cw_rule_set *set, const cw_rule *rule, const cw_mac *mac)
{
    cw_place place = cw_mac_place(mac);
    bool delimiter = rule->field == CW_FIELD_ERROR_DELIMITER ||
                     rule->field == CW_FIELD_OVERLOAD_DELIMITER;
    if (delimiter && place.index == 0 && set->driven != ALL_NODES)
        return false;
    return place.field == rule->field && place.index == rule->index;
}

/* Returns true when the transmitter is at the position in its frame. It walks its own bits, so it
 * knows all places but the numbers of stuff bits. */
static bool at_own_bit(const cw_rule *rule, const cw_mac *mac)
{
    unsigned n;
    if (!cw_mac_own_bit(mac, &n))
        return false;
    if (rule->field == CW_FIELD_STUFF || rule->field == CW_FIELD_BIT)
        return cw_bits_is_at(cw_mac_tx(mac), n, rule->field, rule->index);
    const cw_place place = cw_mac_place(mac);
    const bool stuff = place.stuff && place.field != CW_FIELD_FIXED_STUFF;
    return !stuff && place.field == rule->field && place.index == rule->index;
}

/* Returns true in the index-th bit of the first flag of this attempt. */
static bool in_flag(const cw_flag_watch *flag, unsigned index)
{
    return flag->now && !flag->over && flag->length == index;
}

/* Returns whether the bit in progress is the named one, as seen by a transmitter to which the rule
 * is bound. */
static bool is_reached(const cw_rule_set *set, const cw_rule *rule, const cw_mac *mac)
{
    switch (rule->field) {
    case CW_FIELD_ERROR_FLAG:
        return in_flag(set->bus.error_flag, rule->index);
    case CW_FIELD_OVERLOAD_FLAG:
        return in_flag(set->bus.overload_flag, rule->index);
    case CW_FIELD_INTERMISSION:
    case CW_FIELD_SUSPEND:
    case CW_FIELD_ERROR_DELIMITER:
    case CW_FIELD_OVERLOAD_DELIMITER:
        return at_own_place(set, rule, mac);
    case CW_FIELD_NONE:
    case CW_FIELD_SOF:
    case CW_FIELD_ID:
    case CW_FIELD_SRR:
    case CW_FIELD_IDE:
    case CW_FIELD_RTR:
    case CW_FIELD_R1:
    case CW_FIELD_R0:
    case CW_FIELD_FDF:
    case CW_FIELD_RES:
    case CW_FIELD_BRS:
    case CW_FIELD_ESI:
    case CW_FIELD_DLC:
    case CW_FIELD_DATA:
    case CW_FIELD_STUFF_COUNT:
    case CW_FIELD_CRC:
    case CW_FIELD_FIXED_STUFF:
    case CW_FIELD_CRC_DELIMITER:
    case CW_FIELD_ACK_SLOT:
    case CW_FIELD_ACK_DELIMITER:
    case CW_FIELD_EOF:
    case CW_FIELD_STUFF:
    case CW_FIELD_BIT:
    case CW_FIELD_COUNT:
        break;
    }
    return at_own_bit(rule, mac);
}

/* Returns the nodes that share a wire with this one. */
static uint64_t wire_of(const cw_rule_set *set, unsigned node)
{
    for (unsigned g = 0; g < *set->bus.wire_count; g++)
        if (set->bus.wires[g] & cw_node_bit(node))
            return set->bus.wires[g];
    return cw_node_bit(node);
}

uint64_t cw_rule_nodes_at_position(const cw_rule_set *set, cw_rule_state *s, uint64_t nodes)
{
    uint64_t reached = 0;
    cw_rule_unbind_ended(set, s);
    for (uint64_t rest = s->position.bound & nodes; rest; rest &= rest - 1)
        if (is_reached(set, &s->rule, set->bus.macs[cw_lowest_node(rest)]))
            reached |= rest & (~rest + 1);
    return reached;
}

/* Returns the wires of some nodes, as nodes. */
static uint64_t wires_of(const cw_rule_set *set, uint64_t nodes)
{
    uint64_t wires = 0;
    for (uint64_t rest = nodes; rest; rest &= rest - 1)
        wires |= wire_of(set, cw_lowest_node(rest));
    return wires;
}

/* Only FORCE may last for a time: it acts on all bits that begin in it. */
static bool lasts_for_a_time(const cw_rule *rule)
{
    return rule->action == CW_ACTION_FORCE && rule->for_ticks > 0;
}

/* Begins the action, or begins it again, in the bit that has been reached. */
static void begin_bits(cw_rule_state *s)
{
    cw_position_kept *kept = &s->position;
    kept->bits_done = 0;
    kept->bits_left = lasts_for_a_time(&s->rule) ? 1 : s->rule.bits;
    kept->ticks_left = s->rule.for_ticks;
    kept->part = 0;
}

/* Lengths of bits may be rounded. So a bit counts as whole a little before its end. */
void cw_rule_pass_bit(cw_rule_state *s, cw_span length)
{
    cw_position_kept *kept = &s->position;
    kept->bits_done++;
    if (!lasts_for_a_time(&s->rule)) {
        kept->bits_left--;
        return;
    }
    const cw_span passed = kept->part + length;
    const uint64_t ticks = (uint64_t)((passed + ROUNDING) / CW_TICK);
    kept->part = passed - (cw_span)ticks * CW_TICK;
    kept->ticks_left -= cw_least(ticks, kept->ticks_left);
    kept->bits_left = kept->ticks_left > 0;
}

/* A new hit while an action is under way begins it again. */
bool cw_rule_reaches(cw_rule_set *set, unsigned rule, uint64_t nodes, uint64_t begin, uint64_t end)
{
    cw_rule_state *s = &set->rules[rule];
    if (nodes == 0 || !cw_rule_match(set, rule, begin, end))
        return false;
    cw_rule_note_hit(set, rule, end);
    s->position.source = (uint8_t)cw_lowest_node(nodes);
    if (s->rule.at == 0)
        s->on_wire = wires_of(set, nodes); /* the bit of that wire alone */
    begin_bits(s);
    return true;
}

/* ---- Effects on what is sampled -------------------------------------------------------------- */

/* FLIP: inverts levels. */
void cw_flip(cw_rule_set *set, cw_rule_state *s, uint64_t *levels, uint64_t nodes)
{
    (void)set;
    (void)s;
    *levels ^= nodes;
}

/* FORCE: sets levels. */
void cw_force(cw_rule_set *set, cw_rule_state *s, uint64_t *levels, uint64_t nodes)
{
    (void)set;
    set_level(levels, nodes, s->rule.level);
}

/* GLITCH: sets levels to those of a pattern, as far as it has one for this bit. */
void cw_glitch(cw_rule_set *set, cw_rule_state *s, uint64_t *levels, uint64_t nodes)
{
    (void)set;
    const uint64_t i = s->position.bits_done;
    if (s->rule.pattern_mask >> i & 1u)
        set_level(levels, nodes, s->rule.pattern_level >> i & 1u);
}

/* STUCK and PULSE: set levels. */
void cw_hold_level(cw_rule_set *set, cw_rule_state *s, uint64_t *levels, uint64_t nodes)
{
    (void)set;
    set_level(levels, nodes, s->rule.level);
}

void cw_rule_aim(cw_rule_state *s)
{
    const cw_rule *r = &s->rule;
    s->on_wire = s->at_nodes = 0;
    if (s->does->kind > CW_KIND_LEVEL || !s->does->levels)
        return;
    if (cw_rule_is(s, CW_ON_LINE)) {
        s->on_wire = r->line == CW_LINE_WIRE ? ALL_NODES : 0;
        s->at_nodes = r->line == CW_LINE_RX ? cw_node_bit(r->node) : 0;
        return;
    }
    s->on_wire = r->at ? 0 : ALL_NODES;
    s->at_nodes = r->at;
}

/* Returns true when the action changes levels in the present bit. */
static inline bool acts_now(const cw_rule_state *s)
{
    return cw_rule_is(s, CW_HAS_POSITION) ? s->position.bits_left > 0 : s->active;
}

void cw_rule_check_scope(cw_rule_set *set, unsigned rule)
{
    cw_rule_state *s = &set->rules[rule];
    if (!s->for_attempt || !s->active)
        return;
    for (uint64_t rest = s->scope; rest; rest &= rest - 1)
        if (!cw_mac_is_sending(set->bus.macs[cw_lowest_node(rest)]))
            s->scope &= ~cw_node_bit(cw_lowest_node(rest));
    if (s->scope == 0)
        cw_rule_end_action(set, rule);
}

/* The plan says what rules are about to do in a bit. */
typedef struct bit_plan {
    uint64_t wire;  /* nodes whose wire rules change ... */
    uint64_t nodes; /* ... or whose samples */
    bool bits;      /* bits of positions are counted */
} bit_plan;

/* Finds what a rule does in this bit, after a look at its position. */
static inline void plan_rule(bit_plan *plan, cw_rule_set *set, unsigned rule, cw_rule_state *s)
{
    cw_rule_check_scope(set, rule);
    if (cw_rule_is(s, CW_HAS_POSITION) && s->position.bound)
        (void)cw_rule_reaches(set, rule, cw_rule_nodes_at_position(set, s, ALL_NODES),
                              cw_rules_now(set), cw_rules_bit_end(set));
    if (!acts_now(s))
        return;
    plan->wire |= s->on_wire;
    plan->nodes |= s->at_nodes;
    plan->bits = plan->bits || cw_rule_is(s, CW_HAS_POSITION);
}

/* Changes the levels of whole wires, which all of their nodes sample. */
static void change_wire(cw_rule_set *set, uint64_t *levels)
{
    for (unsigned i = 0; i < set->awake_count; i++) {
        cw_rule_state *s = awake_rule(set, i);
        if (s->on_wire && acts_now(s))
            s->does->levels(set, s, levels, s->on_wire);
    }
}

/* Changes the samples of single nodes, after their wires. */
static void change_samples(cw_rule_set *set, uint64_t *levels)
{
    for (unsigned i = 0; i < set->awake_count; i++) {
        cw_rule_state *s = awake_rule(set, i);
        if (s->at_nodes && acts_now(s))
            s->does->levels(set, s, levels, s->at_nodes);
    }
}

/* Counts the bit of each action at a position, after all have acted. */
static void count_bits(cw_rule_set *set)
{
    for (unsigned i = 0; i < set->awake_count; i++)
        if (cw_rule_is_at_work(awake_rule(set, i)))
            cw_rule_pass_bit(awake_rule(set, i), cw_rule_bit_time(set));
}

void cw_rules_change_sampled(cw_rule_set *set, cw_levels *levels)
{
    bit_plan plan = {.wire = 0};
    set->driven = levels->driven;
    for (unsigned i = 0; i < set->awake_count; i++)
        plan_rule(&plan, set, set->awake[i], awake_rule(set, i));
    if (plan.wire)
        change_wire(set, &levels->sampled);
    levels->wire = levels->sampled;
    if (plan.nodes)
        change_samples(set, &levels->sampled);
    if (plan.bits)
        count_bits(set);
}
