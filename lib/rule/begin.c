/* SPDX-License-Identifier: MIT
 *
 * begin.c - actions begin, last and end.
 */
#include "rule/private.h"

#include "rule/list.h"

void cw_rule_wake(cw_bus *bus, unsigned rule)
{
    cw_rule_state *s = cw_rule_at(bus, rule);
    if (s->awake)
        return;
    s->awake = true;
    cw_list_add(bus->rules.awake, &bus->rules.awake_count, rule);
}

void cw_rules_fall_asleep(cw_bus *bus)
{
    cw_rule_set *set = &bus->rules;
    unsigned kept = 0;
    for (unsigned i = 0; i < set->awake_count; i++) {
        unsigned rule = set->awake[i];
        cw_rule_state *s = cw_rule_at(bus, rule);
        cw_rule_unbind_ended(bus, s);
        s->awake = s->used && cw_rule_needs_bits(s);
        if (s->awake)
            set->awake[kept++] = (uint16_t)rule;
    }
    set->awake_count = kept;
}

static uint64_t window_end(const cw_bus *bus, const cw_rule *rule)
{
    if (rule->for_ticks)
        return cw_after(cw_now(bus), rule->for_ticks);
    return rule->trigger == CW_TRIGGER_TIME ? rule->time_end : CW_NEVER;
}

void cw_rule_end_action(cw_bus *bus, unsigned rule)
{
    cw_rule_state *s = cw_rule_at(bus, rule);
    s->active = false;
    s->scope = 0;
    s->bound = 0;
    s->bits_left = 0;
    s->to_act = false;
    s->active_until = CW_NEVER;
    cw_rule_let_go(bus, rule);
    if (cw_rule_is(s, CW_REWIRES))
        cw_rules_apply_topology(bus);
}

/* ---- Beginning ------------------------------------------------------------------------------- */

void cw_rule_begin_window(cw_bus *bus, unsigned rule, uint64_t scope)
{
    cw_rule_state *s = cw_rule_at(bus, rule);
    s->for_attempt = cw_rule_is(s, CW_FOR_ATTEMPT) && s->rule.trigger == CW_TRIGGER_FRAME &&
                     s->rule.for_ticks == 0;
    s->scope = s->for_attempt ? s->scope | scope : 0;
    s->active = true;
    s->active_until = window_end(bus, &s->rule);
    s->dominant_bits = 0;
    s->next_at = s->rule.action == CW_ACTION_SEND ? cw_now(bus) : CW_NEVER;
    s->busy_base = cw_busy_bits_so_far(bus);
    s->bits_base = cw_bits_so_far(bus);
    cw_rules_set_due(&bus->rules, s->active_until);
    cw_rules_set_due(&bus->rules, s->next_at);
    if (cw_rule_needs_bits(s))
        cw_rule_wake(bus, rule);
    bus->rules.rewired = bus->rules.rewired || cw_rule_is(s, CW_REWIRES);
}

void cw_rule_act(cw_bus *bus, unsigned rule)
{
    if (cw_rule_is(cw_rule_at(bus, rule), CW_LASTS))
        cw_rule_begin_window(bus, rule, 0);
    else
        cw_rule_command(bus, rule);
}

/* Whether a rule that is no position action begins to act. The hits of noise are the bits that it
 * flips, so its begin is none. */
bool cw_rule_begins(cw_bus *bus, unsigned rule, uint64_t start, uint64_t told)
{
    if (cw_rule_is(cw_rule_at(bus, rule), CW_RANDOM_BITS))
        return cw_rule_takes_match(bus, rule, start, told);
    return cw_rule_match(bus, rule, start, told);
}

/* The rule has a hit and acts when this bit has been settled. */
void cw_rule_act_later(cw_bus *bus, unsigned rule, uint64_t tick)
{
    cw_rule_at(bus, rule)->to_act = true;
    cw_rules_set_due(&bus->rules, tick);
}

void cw_rule_fire(cw_bus *bus, unsigned rule)
{
    if (!cw_rule_begins(bus, rule, cw_now(bus), cw_now(bus)))
        return;
    if (!cw_rule_is(cw_rule_at(bus, rule), CW_RANDOM_BITS))
        cw_push_fault(bus, rule, cw_now(bus));
    cw_rule_act(bus, rule);
}

void cw_rules_emit(cw_bus *bus)
{
    for (unsigned i = 0; i < bus->rules.awake_count; i++) {
        cw_rule_state *s = cw_rule_at(bus, bus->rules.awake[i]);
        if (s->hit_now)
            cw_push_fault(bus, bus->rules.awake[i], cw_now(bus));
        s->hit_now = false;
    }
    cw_rules_fall_asleep(bus);
}
