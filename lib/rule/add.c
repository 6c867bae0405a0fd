/* SPDX-License-Identifier: MIT
 *
 * add.c - adds and removes rules while the bus runs.
 */
#include "rule/private.h"

#include "format/bits.h"
#include "rule/list.h"

/* Returns the first place that no rule has; it may be one behind all others. */
static unsigned free_place(const cw_rule_set *set)
{
    unsigned place = 0;
    while (place < set->count && set->rules[place].used)
        place++;
    return place;
}

/* Returns true when a rule acts for parts of bits, so that nodes must go by their own clocks. */
static bool divides_bits(const cw_rule_set *set, const cw_rule_state *s)
{
    const cw_rate rate = cw_wire_rate(set->bus.time);
    const uint64_t whole = cw_rate_ticks(rate, cw_rate_bits(rate, s->rule.for_ticks));
    const bool lasts_bits = whole == s->rule.for_ticks && (!set->bus.divided || whole == 0);
    return cw_rule_is(s, CW_IN_TIME) || (cw_rule_is(s, CW_ON_LINE) && !lasts_bits);
}

/* Counts rules by kind, so that the common cases are skipped quickly. */
static void count_kinds(cw_rule_set *set)
{
    set->host_rules = 0;
    set->making_rules = 0;
    set->reply_rules = 0;
    set->noise_rules = 0;
    set->line_rules = 0;
    set->traffic_rules = 0;
    set->error_rules = 0;
    set->after_rules = 0;
    set->copies = 0;
    set->timed_rules = 0;
    set->raw_rules = 0;
    set->jitter = 0;
    for (unsigned i = 0; i < set->count; i++) {
        const cw_rule_state *s = &set->rules[i];
        set->host_rules += s->used && s->does->kind == CW_KIND_HOST;
        set->making_rules += s->used && cw_rule_is(s, CW_IN_MAKING);
        set->reply_rules += s->used && s->rule.action == CW_ACTION_REPLY;
        set->noise_rules += s->used && cw_rule_is(s, CW_RANDOM_BITS);
        set->line_rules += s->used && cw_rule_is(s, CW_ON_LINE);
        set->traffic_rules += s->used && cw_rule_is(s, CW_STEADY_TRAFFIC);
        set->error_rules += s->used && s->rule.trigger == CW_TRIGGER_ERROR;
        set->after_rules += s->used && s->rule.has_after;
        set->timed_rules += s->used && divides_bits(set, s);
        set->raw_rules += s->used && cw_rule_is_raw(s);
        if (s->used && s->rule.action == CW_ACTION_JITTER)
            set->jitter += s->rule.jitter;
        if (s->used && s->rule.action == CW_ACTION_DUPLICATE)
            set->copies += s->rule.number;
    }
    set->hand_in_rules = set->host_rules + (set->protection_count > 0);
    cw_rules_forget_all(set);
}

/* Returns true when each frame has the bit: longer frames have it when the shortest ones have
 * it. */
static bool is_in_each_frame(const cw_rule_set *set, const cw_rule *r)
{
    static const uint8_t formats[] = {0, CW_FRAME_EXTENDED, CW_FRAME_FD,
                                      CW_FRAME_FD | CW_FRAME_EXTENDED};
    unsigned n;
    for (unsigned i = 0; i < (set->bus.fd ? 4u : 2u); i++) {
        const cw_frame shortest = {.flags = formats[i]};
        if (!cw_frame_find(&shortest, &n, r->field, r->index))
            return false;
    }
    return true;
}

/* Returns true when no time, arming or place in a frame can keep the rule from a match, see
 * cw_rule_state. */
static bool is_open(const cw_rule_set *set, const cw_rule *r)
{
    return r->time_begin <= cw_rules_now(set) && r->time_end == CW_NEVER &&
           !cw_rule_needs_arming(r) && is_in_each_frame(set, r);
}

cw_status cw_rules_may_add(const cw_rule_set *set, unsigned *place, const cw_rule *rule)
{
    *place = free_place(set);
    if (!cw_rule_valid(set, rule))
        return CW_INVALID;
    return *place == set->capacity ? CW_FULL : CW_OK;
}

void cw_rules_add(cw_rule_set *set, unsigned place, const cw_rule *rule)
{
    if (place == set->count)
        set->count++;
    cw_rule_state *s = &set->rules[place];
    *s = (cw_rule_state){.rule = *rule, .used = true, .fire_at = CW_NEVER, .armed_at = CW_NEVER,
                         .error_at = CW_NEVER, .active_until = CW_NEVER};
    s->rule.name = NULL; /* the name is the caller's */
    s->does = &cw_actions[rule->action];
    s->traits = s->does->traits;
    cw_rule_aim(s);
    s->open = is_open(set, rule);
    s->to_pass = rule->skip;
    if (s->rule.every == 0)
        s->rule.every = 1;
    cw_prng_init(&s->prng, set->bus.seed, rule->name);
    if (rule->trigger == CW_TRIGGER_TIME) {
        cw_rule_plan_from(s, cw_rules_now(set));
        cw_rules_set_due(set, s->fire_at);
    }
    cw_index_add(set, place);
    count_kinds(set);
}

/* Rules that came after a removed rule come after none, whichever rule gets its index. */
static void abandon_followers(cw_rule_set *set, unsigned rule)
{
    for (unsigned i = 0; i < set->count; i++)
        if (set->rules[i].rule.after == rule)
            set->rules[i].rule.after = CW_NO_RULE;
}

void cw_rules_remove(cw_rule_set *set, unsigned rule)
{
    cw_rule_end_action(set, rule);
    abandon_followers(set, rule);
    cw_index_remove(set, rule);
    cw_list_remove(set->awake, &set->awake_count, rule);
    set->rules[rule].used = false;
    set->rules[rule].awake = false;
    count_kinds(set);
}

bool cw_rules_arm(cw_rule_set *set, unsigned rule)
{
    const cw_rule_state *s = cw_rule_at(set, rule);
    bool ready = s->rule.manual && !cw_rule_is_over(s);
    return ready && cw_rule_add_arming(set, rule, cw_rules_now(set));
}

/* Returns true when the time window of the rule has ended, or its one moment has come. */
static bool has_passed(const cw_rule_set *set, const cw_rule_state *s)
{
    bool once = s->rule.trigger == CW_TRIGGER_TIME && s->fire_at == CW_NEVER && !s->active;
    return cw_rules_now(set) >= s->rule.time_end || once;
}

cw_rule_stats cw_rules_get_stats(const cw_rule_set *set, unsigned rule)
{
    const cw_rule_state *s = &set->rules[rule];
    return (cw_rule_stats){.matches = s->matches,
                           .misses = s->matches - s->taken,
                           .hits = s->hits,
                           .active = s->active || cw_rule_is_at_work(s),
                           .over = cw_rule_is_over(s) || has_passed(set, s)};
}
