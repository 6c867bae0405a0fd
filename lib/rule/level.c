/* SPDX-License-Identifier: MIT
 *
 * level.c - what fault rules do to levels: bits at a position, stuck lines, noise, topology.
 *
 * First the lines from the nodes to the wire, then the wire, then what single nodes sample.
 */
#include "rule/private.h"

#define ALL_NODES UINT64_MAX

static cw_fault *awake_fault(cw_bus *bus, unsigned i)
{
    return &bus->faults.faults[bus->faults.awake[i]];
}

static void set_level(uint64_t *levels, uint64_t nodes, bool level)
{
    *levels = level ? *levels | nodes : *levels & ~nodes;
}

/* ---- Stuck TX lines -------------------------------------------------------------------------- */

/* The transceiver lets go of the bus when its TXD has been dominant for too long. */
static bool stuck_tx_level(cw_fault *f, cw_rate rate)
{
    if (f->rule.level == CW_RECESSIVE)
        return CW_RECESSIVE;
    const uint64_t timeout = f->rule.dominant_timeout;
    bool timed_out = timeout && cw_rate_ticks(rate, f->dominant_bits) >= timeout;
    if (!timed_out)
        f->dominant_bits++;
    return timed_out ? CW_RECESSIVE : CW_DOMINANT;
}

void cw_fault_driven(cw_bus *bus, cw_levels *levels)
{
    for (unsigned i = 0; i < bus->faults.awake_count; i++) {
        cw_fault *f = awake_fault(bus, i);
        bool stuck = f->active && f->rule.action == CW_ACTION_STUCK && f->rule.line == CW_LINE_TX;
        if (stuck)
            set_level(&levels->driven, cw_node_bit(f->rule.node),
                      stuck_tx_level(f, cw_wire_rate(&bus->time)));
    }
    if (bus->faults.rewired)
        cw_fault_apply_topology(bus);
    set_level(&levels->driven, bus->faults.off, CW_RECESSIVE);
}

/* ---- Positions ------------------------------------------------------------------------------- */

/* In a field that all nodes are in: the transmitter's own count. The first bit of a delimiter is
 * known by the wire: nobody sends a flag any more. */
static bool at_own_place(const cw_bus *bus, const cw_rule *rule, const cw_mac *mac)
{
    cw_place place = cw_mac_place(mac);
    bool delimiter = rule->field == CW_FIELD_ERROR_DELIMITER ||
                     rule->field == CW_FIELD_OVERLOAD_DELIMITER;
    if (delimiter && place.index == 0 && bus->driven != ALL_NODES)
        return false;
    return place.field == rule->field && place.index == rule->index;
}

static bool in_flag(const flag_watch *flag, unsigned index)
{
    return flag->now && !flag->over && flag->length == index;
}

/* Whether the bit in progress is the named one, seen from a transmitter the rule is bound to. */
static bool is_reached(const cw_bus *bus, const cw_rule *rule, const cw_mac *mac)
{
    unsigned n;
    switch (rule->field) {
    case CW_FIELD_ERROR_FLAG:
        return in_flag(&bus->error_flag, rule->index);
    case CW_FIELD_OVERLOAD_FLAG:
        return in_flag(&bus->overload_flag, rule->index);
    case CW_FIELD_INTERMISSION:
    case CW_FIELD_SUSPEND:
    case CW_FIELD_ERROR_DELIMITER:
    case CW_FIELD_OVERLOAD_DELIMITER:
        return at_own_place(bus, rule, mac);
    case CW_FIELD_NONE:
    case CW_FIELD_SOF:
    case CW_FIELD_ID:
    case CW_FIELD_SRR:
    case CW_FIELD_IDE:
    case CW_FIELD_RTR:
    case CW_FIELD_R1:
    case CW_FIELD_R0:
    case CW_FIELD_DLC:
    case CW_FIELD_DATA:
    case CW_FIELD_CRC:
    case CW_FIELD_CRC_DELIMITER:
    case CW_FIELD_ACK_SLOT:
    case CW_FIELD_ACK_DELIMITER:
    case CW_FIELD_EOF:
    case CW_FIELD_STUFF:
    case CW_FIELD_BIT:
    case CW_FIELD_COUNT:
        break;
    }
    return cw_mac_own_bit(mac, &n) && cw_bits_is_at(&mac->tx, n, rule->field, rule->index);
}

/* The nodes that share a wire with this one. */
static uint64_t wire_of(const cw_bus *bus, unsigned node)
{
    for (unsigned g = 0; g < bus->group_count; g++)
        if (bus->groups[g] & cw_node_bit(node))
            return bus->groups[g];
    return cw_node_bit(node);
}

/* Bits that an error takes away for good. */
static bool is_in_frame(cw_field field)
{
    return field < CW_FIELD_INTERMISSION || field > CW_FIELD_OVERLOAD_DELIMITER;
}

void cw_fault_unbind_ended(const cw_bus *bus, cw_fault *f)
{
    for (uint64_t rest = f->bound; rest; rest &= rest - 1) {
        const cw_mac *mac = &bus->nodes[cw_lowest_node(rest)].mac;
        bool ended = mac->role != CW_ROLE_TRANSMITTER ||
                     (is_in_frame(f->rule.field) && !cw_mac_is_sending(mac));
        if (ended)
            f->bound &= ~(rest & (~rest + 1));
    }
}

/* The wires on which the named bit is reached, as nodes. */
static uint64_t wires_reached(const cw_bus *bus, cw_fault *f)
{
    uint64_t reached = 0;
    cw_fault_unbind_ended(bus, f);
    for (uint64_t rest = f->bound; rest; rest &= rest - 1) {
        unsigned node = cw_lowest_node(rest);
        if (is_reached(bus, &f->rule, &bus->nodes[node].mac))
            reached |= wire_of(bus, node);
    }
    return reached;
}

static uint64_t action_bits(const cw_bus *bus, const cw_rule *rule)
{
    if (rule->action != CW_ACTION_FORCE || rule->for_ticks == 0)
        return rule->bits;
    return cw_rate_bits_begun(cw_wire_rate(&bus->time), rule->for_ticks);
}

/* A new hit while an action is under way begins it again. */
static void look_for_position(cw_bus *bus, unsigned rule)
{
    cw_fault *f = &bus->faults.faults[rule];
    uint64_t wires = f->bound ? wires_reached(bus, f) : 0;
    if (wires == 0 || !cw_fault_match(bus, rule, cw_now(bus), cw_bit_end(bus)))
        return;
    f->hit_now = true;
    f->wire = wires;
    f->bits_done = 0;
    f->bits_left = action_bits(bus, &f->rule);
}

/* ---- Effects on what is sampled -------------------------------------------------------------- */

static void apply_position(const cw_fault *f, uint64_t *levels, uint64_t nodes)
{
    uint64_t i = f->bits_done;
    if (f->rule.action == CW_ACTION_FLIP)
        *levels ^= nodes;
    else if (f->rule.action == CW_ACTION_FORCE)
        set_level(levels, nodes, f->rule.level);
    else if (f->rule.pattern_mask >> i & 1u)
        set_level(levels, nodes, f->rule.pattern_level >> i & 1u);
}

/* Whom a rule's level concerns; 0 when not in this pass. A bit at a position is one of the wire
 * that its transmitter is on. */
static uint64_t concerned(const cw_fault *f, bool wire)
{
    const cw_rule *r = &f->rule;
    if (r->action == CW_ACTION_STUCK) {
        if (r->line == CW_LINE_WIRE)
            return wire ? ALL_NODES : 0;
        return r->line == CW_LINE_RX && !wire ? cw_node_bit(r->node) : 0;
    }
    if (!wire)
        return r->at;
    if (r->at != 0)
        return 0;
    return r->action == CW_ACTION_NOISE ? ALL_NODES : f->wire;
}

static void apply_rule(cw_bus *bus, unsigned rule, uint64_t *levels, bool wire)
{
    cw_fault *f = &bus->faults.faults[rule];
    uint64_t nodes = concerned(f, wire);
    if (nodes == 0)
        return;
    if (f->bits_left > 0)
        apply_position(f, levels, nodes);
    if (f->active && f->rule.action == CW_ACTION_STUCK)
        set_level(levels, nodes, f->rule.level);
    if (f->active && f->rule.action == CW_ACTION_NOISE)
        cw_fault_apply_noise(bus, rule, levels);
}

/* Actions for one transmission end with it. */
static void check_scope(cw_bus *bus, unsigned rule)
{
    cw_fault *f = &bus->faults.faults[rule];
    if (!f->active || !f->for_attempt)
        return;
    for (uint64_t rest = f->scope; rest; rest &= rest - 1)
        if (!cw_mac_is_sending(&bus->nodes[cw_lowest_node(rest)].mac))
            f->scope &= ~cw_node_bit(cw_lowest_node(rest));
    if (f->scope == 0)
        cw_fault_end_action(bus, rule);
}

void cw_fault_sampled(cw_bus *bus, cw_levels *levels)
{
    const cw_fault_set *set = &bus->faults;
    for (unsigned i = 0; i < set->awake_count; i++) {
        check_scope(bus, set->awake[i]);
        look_for_position(bus, set->awake[i]);
    }
    for (unsigned i = 0; i < set->awake_count; i++)
        apply_rule(bus, set->awake[i], &levels->sampled, true);
    levels->wire = levels->sampled;
    bus->wire = levels->wire == ALL_NODES;
    for (unsigned i = 0; i < set->awake_count; i++) {
        cw_fault *f = awake_fault(bus, i);
        apply_rule(bus, set->awake[i], &levels->sampled, false);
        f->bits_done += f->bits_left > 0;
        f->bits_left -= f->bits_left > 0;
    }
}

bool cw_fault_needs_bits(const cw_fault *f)
{
    cw_action a = f->rule.action;
    bool window = a == CW_ACTION_STUCK || a == CW_ACTION_NOISE || a == CW_ACTION_BABBLE ||
                  a == CW_ACTION_LOAD || f->for_attempt;
    return f->bound != 0 || f->bits_left != 0 || f->hit_now || (f->active && window);
}
