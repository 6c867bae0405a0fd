/* SPDX-License-Identifier: MIT
 *
 * begin.c - actions begin, last and end.
 */
#include "rule/private.h"

/* Returns the tick at which an action that begins now ends. */
static uint64_t window_end(const cw_rule_set *set, const cw_rule *rule)
{
    if (rule->for_ticks)
        return cw_after(cw_rules_now(set), rule->for_ticks);
    return rule->trigger == CW_TRIGGER_TIME ? rule->time_end : CW_NEVER;
}

/* Forgets what the action has under way. Not so the frames of its traffic, which are still in
 * queues, and the decision on a frame, which may go to further hosts. */
static void end_kept(cw_rule_state *s)
{
    if (cw_rule_is(s, CW_HAS_POSITION)) {
        s->position.bound = 0;
        s->position.bits_left = 0;
        s->position.disturbs = false;
        s->position.pulses = false;
    } else if (cw_rule_is(s, CW_RANDOM_BITS)) {
        s->noise.in_burst = 0;
    } else if (cw_rule_is_raw(s)) {
        s->raw.waits = false;
    }
}

void cw_rule_end_action(cw_rule_set *set, unsigned rule)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    s->active = false;
    s->scope = 0;
    s->to_act = false;
    s->active_until = CW_NEVER;
    end_kept(s);
    cw_rule_let_go(set, rule);
    if (cw_rule_is(s, CW_REWIRES))
        cw_rules_rewire(set);
}

/* ---- Beginning ------------------------------------------------------------------------------- */

/* Prepares what an action that lasts keeps. */
static void begin_kept(cw_rule_set *set, cw_rule_state *s)
{
    if (cw_rule_is(s, CW_ON_LINE))
        s->line.dominant_ticks = 0;
    if (s->does->kind != CW_KIND_TRAFFIC)
        return;
    const bool sends = s->rule.action == CW_ACTION_SEND || cw_rule_is(s, CW_DEVIATES);
    s->traffic.next_at = sends ? cw_rules_now(set) : CW_NEVER;
    s->traffic.time_base = set->bus.effects->time(set->bus.self, &s->traffic.busy_base);
    cw_rules_set_due(set, s->traffic.next_at);
}

void cw_rule_begin_window(cw_rule_set *set, unsigned rule, uint64_t scope)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    s->for_attempt = cw_rule_is(s, CW_FOR_ATTEMPT) && s->rule.trigger == CW_TRIGGER_FRAME &&
                     s->rule.for_ticks == 0;
    s->scope = s->for_attempt ? s->scope | scope : 0;
    s->active = true;
    s->active_until = window_end(set, &s->rule);
    begin_kept(set, s);
    cw_rules_set_due(set, s->active_until);
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
        s->position.pulses = true;
        cw_rule_wake(set, rule);
    } else if (cw_rule_is_raw(s)) {
        cw_raw_act(set, rule);
    } else {
        command(set, &s->rule);
    }
}

/* The hits of noise are the bits that it flips, so its start is not one. */
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

/* Reports the hit of a bit that has ended, as an event at its end. */
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
