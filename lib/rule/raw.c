/* SPDX-License-Identifier: MIT
 *
 * raw.c - what no honest controller would send: bits that a node drives without its controller,
 * and frames with deviating bits.
 */
#include "rule/private.h"

#include "format/bits.h"

/* ---- Bits without a controller --------------------------------------------------------------- */

/* Looks again at the end of the present bit. */
static void look_again(cw_rule_set *set, cw_rule_state *s)
{
    s->raw.next_at = cw_rules_bit_end(set);
    cw_rules_set_due(set, s->raw.next_at);
}

/* The node drives its first bit from now on. Its controller leaves the bus before. */
static void raw_begin(cw_rule_set *set, unsigned rule)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    s->raw.waits = false;
    s->active = true;
    s->raw.bits_done = 0;
    set->rewired = true;
    cw_rule_wake(set, rule);
    look_again(set, s);
}

/* Begins at once, unless the rule has to wait for an idle bus. */
static void wait_for_idle(cw_rule_set *set, unsigned rule)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    s->raw.waits = true;
    if (!s->rule.raw_when_idle || set->bus.effects->is_idle(set->bus.self, s->rule.node))
        raw_begin(set, rule);
    else
        look_again(set, s);
}

void cw_raw_act(cw_rule_set *set, unsigned rule)
{
    const cw_rule_state *s = cw_rule_at(set, rule);
    if (!s->active && !s->raw.waits)
        wait_for_idle(set, rule);
}

bool cw_raw_go_on(cw_rule_set *set, unsigned rule)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    if (s->raw.waits)
        wait_for_idle(set, rule);
    else if (++s->raw.bits_done == s->rule.bits)
        return false;
    else
        look_again(set, s);
    return true;
}

bool cw_raw_level(const cw_rule_state *s)
{
    return s->rule.raw[s->raw.bits_done / 64] >> (s->raw.bits_done % 64) & 1u;
}

uint64_t cw_raw_change_lines(const cw_rule_set *set, uint64_t driven)
{
    for (unsigned i = 0; i < set->awake_count; i++) {
        const cw_rule_state *s = &set->rules[set->awake[i]];
        const uint64_t self = cw_node_bit(s->rule.node) & ~set->cut;
        if (s->active && cw_rule_is_raw(s))
            driven = cw_raw_level(s) ? driven | self : driven & ~self;
    }
    return driven;
}

/* ---- Deviating frames ------------------------------------------------------------------------ */

unsigned cw_rules_deviations(const cw_rule_set *set, unsigned source)
{
    const cw_rule_state *s = &set->rules[source - 1];
    return cw_rule_is(s, CW_DEVIATES) ? s->rule.deviations : 0;
}

/* A controller that knows FDF would take its own frame for an FD frame. */
bool cw_raw_valid(const cw_rule_set *set, const cw_rule *r)
{
    const unsigned fdf = r->frame.flags & CW_FRAME_EXTENDED ? CW_DEVIATES_R1 : CW_DEVIATES_R0;
    const bool classical =
        (set->bus.macs[r->node]->protocol & CW_PROTOCOL_MASK) == CW_CLASSICAL;
    if (r->action != CW_ACTION_RAW_FRAME)
        return true;
    return cw_frame_can_deviate(&r->frame, r->deviations) &&
           (classical || !(r->deviations & fdf));
}
