/* SPDX-License-Identifier: MIT
 *
 * add.c - rules come and go while the bus runs.
 */
#include "rule/private.h"

#include "rule/list.h"

static unsigned free_place(const cw_rule_set *set)
{
    unsigned place = 0;
    while (place < set->count && set->rules[place].used)
        place++;
    return place;
}

/* Counts that let the common cases be passed over quickly. */
static void count_kinds(cw_bus *bus)
{
    cw_rule_set *set = &bus->rules;
    set->host_rules = 0;
    set->reply_rules = 0;
    set->noise_rules = 0;
    set->line_rules = 0;
    set->traffic_rules = 0;
    set->error_rules = 0;
    set->after_rules = 0;
    set->copies = 0;
    for (unsigned i = 0; i < set->count; i++) {
        const cw_rule_state *s = &set->rules[i];
        set->host_rules += s->used && s->does->kind == CW_KIND_HOST;
        set->reply_rules += s->used && s->rule.action == CW_ACTION_REPLY;
        set->noise_rules += s->used && cw_rule_is(s, CW_RANDOM_BITS);
        set->line_rules += s->used && cw_rule_is(s, CW_ON_LINE);
        set->traffic_rules += s->used && cw_rule_is(s, CW_STEADY_TRAFFIC);
        set->error_rules += s->used && s->rule.trigger == CW_TRIGGER_ERROR;
        set->after_rules += s->used && s->rule.has_after;
        if (s->used && s->rule.action == CW_ACTION_DUPLICATE)
            set->copies += s->rule.number;
    }
    cw_ring_find_enough(bus);
    set->stale = true;
}

cw_status cw_bus_add_rule(cw_bus *bus, unsigned *index, const cw_rule *rule)
{
    cw_rule_set *set = &bus->rules;
    unsigned place = free_place(set);
    if (!cw_rule_valid(bus, rule))
        return CW_INVALID;
    if (place == set->capacity)
        return CW_FULL;
    cw_wake_controllers(bus); /* it went by the rules that there were */
    if (place == set->count)
        set->count++;
    cw_rule_state *s = &set->rules[place];
    *s = (cw_rule_state){.rule = *rule, .used = true, .fire_at = CW_NEVER, .armed_at = CW_NEVER,
                    .error_at = CW_NEVER, .active_until = CW_NEVER, .next_at = CW_NEVER};
    s->rule.name = NULL; /* not ours to keep */
    s->does = &cw_actions[rule->action];
    s->traits = s->does->traits;
    cw_rule_aim(s);
    s->to_pass = rule->skip;
    if (s->rule.every == 0)
        s->rule.every = 1;
    cw_prng_init(&s->prng, bus->seed, rule->name);
    if (rule->trigger == CW_TRIGGER_TIME) {
        s->fire_at = rule->time_begin > cw_now(bus) ? rule->time_begin : cw_now(bus);
        cw_rules_set_due(&bus->rules, s->fire_at);
    }
    cw_index_add(set, place);
    count_kinds(bus);
    *index = place;
    return CW_OK;
}

static bool is_rule(const cw_bus *bus, unsigned index)
{
    return index < bus->rules.count && bus->rules.rules[index].used;
}

cw_status cw_bus_stop_rule(cw_bus *bus, unsigned index)
{
    if (!is_rule(bus, index))
        return CW_INVALID;
    cw_wake_controllers(bus);
    cw_rule_end_action(bus, index);
    return CW_OK;
}

/* Frames of its traffic that still wait must not be taken for those of a later rule. */
static void disown_frames(cw_bus *bus, unsigned rule)
{
    for (unsigned i = 0; i < bus->node_count; i++) {
        cw_queue *q = &bus->nodes[i].queue;
        for (unsigned k = 0; k < q->count; k++)
            if (q->slots[cw_queue_nth(q, k)].source == rule + 1)
                q->slots[cw_queue_nth(q, k)].source = 0;
    }
}

/* Rules that came after a rule that is no more come after none, whatever gets its index. */
static void abandon_followers(cw_bus *bus, unsigned rule)
{
    for (unsigned i = 0; i < bus->rules.count; i++)
        if (bus->rules.rules[i].rule.after == rule)
            bus->rules.rules[i].rule.after = CW_NO_RULE;
}

cw_status cw_bus_clear_rule(cw_bus *bus, unsigned index)
{
    if (!is_rule(bus, index))
        return CW_INVALID;
    cw_wake_controllers(bus);
    cw_rule_end_action(bus, index);
    disown_frames(bus, index);
    abandon_followers(bus, index);
    cw_index_remove(&bus->rules, index);
    cw_list_remove(bus->rules.awake, &bus->rules.awake_count, index);
    bus->rules.rules[index].used = false;
    bus->rules.rules[index].awake = false;
    count_kinds(bus);
    return CW_OK;
}

cw_status cw_bus_fire_rule(cw_bus *bus, unsigned index)
{
    if (!is_rule(bus, index))
        return CW_INVALID;
    const cw_rule_state *s = cw_rule_at(bus, index);
    bool ready = s->rule.manual && !cw_rule_is_over(s);
    return ready && cw_rule_add_arming(bus, index, cw_now(bus)) ? CW_OK : CW_REFUSED;
}

/* Its time window is over, or its one moment has come. */
static bool has_passed(const cw_bus *bus, const cw_rule_state *s)
{
    bool once = s->rule.trigger == CW_TRIGGER_TIME && s->fire_at == CW_NEVER && !s->active;
    return cw_now(bus) >= s->rule.time_end || once;
}

cw_status cw_rule_get_stats(const cw_bus *bus, unsigned rule, cw_rule_stats *stats)
{
    if (!is_rule(bus, rule))
        return CW_INVALID;
    const cw_rule_state *s = &bus->rules.rules[rule];
    *stats = (cw_rule_stats){.matches = s->matches,
                             .misses = s->matches - s->taken,
                             .hits = s->hits,
                             .active = s->active || s->bits_left > 0,
                             .over = cw_rule_is_over(s) || has_passed(bus, s)};
    return CW_OK;
}
