/* SPDX-License-Identifier: MIT
 *
 * begin.c - actions begin, last and end.
 */
#include "rule/private.h"

static uint64_t window_end(const cw_rule_set *set, const cw_rule *rule)
{
    if (rule->for_ticks)
        return cw_after(cw_rules_now(set), rule->for_ticks);
    return rule->trigger == CW_TRIGGER_TIME ? rule->time_end : CW_NEVER;
}

void cw_rule_end_action(cw_rule_set *set, unsigned rule)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    s->active = false;
    s->scope = 0;
    s->bound = 0;
    s->bits_left = 0;
    s->in_burst = 0;
    s->disturbs = false;
    s->pulses = false;
    s->waits = false;
    s->to_act = false;
    s->active_until = CW_NEVER;
    cw_rule_let_go(set, rule);
    if (cw_rule_is(s, CW_REWIRES))
        cw_rules_rewire(set);
}

/* ---- Beginning ------------------------------------------------------------------------------- */

void cw_rule_begin_window(cw_rule_set *set, unsigned rule, uint64_t scope)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    s->for_attempt = cw_rule_is(s, CW_FOR_ATTEMPT) && s->rule.trigger == CW_TRIGGER_FRAME &&
                     s->rule.for_ticks == 0;
    s->scope = s->for_attempt ? s->scope | scope : 0;
    s->active = true;
    s->active_until = window_end(set, &s->rule);
    s->dominant_ticks = 0;
    const bool sends = s->rule.action == CW_ACTION_SEND || cw_rule_is(s, CW_DEVIATES);
    s->next_at = sends ? cw_rules_now(set) : CW_NEVER;
    s->time_base = set->bus.effects->time(set->bus.self, &s->busy_base);
    cw_rules_set_due(set, s->active_until);
    cw_rules_set_due(set, s->next_at);
    if (cw_rule_needs_bits(s))
        cw_rule_wake(set, rule);
    set->rewired = set->rewired || cw_rule_is(s, CW_REWIRES);
}

/* Acts once on the controllers that the rule names. */
static void command(cw_rule_set *set, const cw_rule *rule)
{
    set->bus.effects->control(set->bus.self, rule);
    if (rule->nodes & set->off)
        set->rewired = true; /* a node that leaves bus-off is not yet back on the bus */
}

void cw_rule_act(cw_rule_set *set, unsigned rule)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    if (cw_rule_is(s, CW_LASTS)) {
        cw_rule_begin_window(set, rule, 0);
    } else if (s->rule.action == CW_ACTION_PULSE) {
        s->pulses = true;
        cw_rule_wake(set, rule);
    } else if (s->rule.action == CW_ACTION_RAW) {
        cw_raw_act(set, rule);
    } else {
        command(set, &s->rule);
    }
}

/* The hits of noise are the bits that it flips, so its begin is none. */
bool cw_rule_begins(cw_rule_set *set, unsigned rule, uint64_t start, uint64_t reported)
{
    if (cw_rule_is(cw_rule_at(set, rule), CW_RANDOM_BITS))
        return cw_rule_takes_match(set, rule, start, reported);
    return cw_rule_match(set, rule, start, reported);
}

void cw_rule_act_later(cw_rule_set *set, unsigned rule, uint64_t tick)
{
    cw_rule_at(set, rule)->to_act = true;
    cw_rules_set_due(set, tick);
}

void cw_rule_fire(cw_rule_set *set, unsigned rule)
{
    if (!cw_rule_begins(set, rule, cw_rules_now(set), cw_rules_now(set)))
        return;
    if (!cw_rule_is(cw_rule_at(set, rule), CW_RANDOM_BITS))
        cw_rule_report_hit(set, rule, cw_rules_now(set));
    cw_rule_act(set, rule);
}

static void emit(cw_rule_set *set, unsigned rule)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    if (s->hit_now)
        cw_rule_report_hit(set, rule, cw_least(s->hit_at, cw_rules_now(set)));
    s->hit_now = false;
}

void cw_rule_note_hit(cw_rule_set *set, unsigned rule, uint64_t end)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    if (s->hit_now && s->hit_at < end)
        cw_rule_report_hit(set, rule, s->hit_at); /* by a clock of its own: an earlier bit */
    s->hit_now = true;
    s->hit_at = end;
    cw_rule_wake(set, rule);
}

void cw_rules_emit(cw_rule_set *set)
{
    for (unsigned i = 0; i < set->awake_count; i++)
        if (cw_rule_at(set, set->awake[i])->hit_at <= cw_rules_now(set))
            emit(set, set->awake[i]);
    cw_rules_fall_asleep(set);
}

void cw_rules_emit_rest(cw_rule_set *set)
{
    for (unsigned i = 0; i < set->awake_count; i++)
        emit(set, set->awake[i]);
    cw_rules_fall_asleep(set);
}
