/* SPDX-License-Identifier: MIT
 *
 * add.c - rules come and go while the bus runs.
 */
#include "rule/private.h"

#include "rule/list.h"

static unsigned free_place(const cw_fault_set *set)
{
    unsigned place = 0;
    while (place < set->count && set->faults[place].used)
        place++;
    return place;
}

/* Counts that let the common cases be passed over quickly. */
static void count_kinds(cw_bus *bus)
{
    cw_fault_set *set = &bus->faults;
    set->host_rules = 0;
    set->reply_rules = 0;
    set->noise_rules = 0;
    set->line_rules = 0;
    set->traffic_rules = 0;
    set->error_rules = 0;
    set->after_rules = 0;
    set->copies = 0;
    for (unsigned i = 0; i < set->count; i++) {
        const cw_fault *f = &set->faults[i];
        set->host_rules += f->used && f->does->kind == CW_KIND_HOST;
        set->reply_rules += f->used && f->rule.action == CW_ACTION_REPLY;
        set->noise_rules += f->used && cw_fault_is(f, CW_RANDOM_BITS);
        set->line_rules += f->used && cw_fault_is(f, CW_ON_LINE);
        set->traffic_rules += f->used && cw_fault_is(f, CW_STEADY_TRAFFIC);
        set->error_rules += f->used && f->rule.trigger == CW_TRIGGER_ERROR;
        set->after_rules += f->used && f->rule.has_after;
        if (f->used && f->rule.action == CW_ACTION_DUPLICATE)
            set->copies += f->rule.number;
    }
    cw_ring_find_enough(bus);
    set->stale = true;
}

cw_status cw_bus_add_rule(cw_bus *bus, unsigned *index, const cw_rule *rule)
{
    cw_fault_set *set = &bus->faults;
    unsigned place = free_place(set);
    if (!cw_rule_valid(bus, rule))
        return CW_INVALID;
    if (place == set->capacity)
        return CW_FULL;
    cw_wake_controllers(bus); /* it went by the rules that there were */
    if (place == set->count)
        set->count++;
    cw_fault *f = &set->faults[place];
    *f = (cw_fault){.rule = *rule, .used = true, .fire_at = CW_NEVER, .armed_at = CW_NEVER,
                    .error_at = CW_NEVER, .active_until = CW_NEVER, .next_at = CW_NEVER};
    f->rule.name = NULL; /* not ours to keep */
    f->does = &cw_actions[rule->action];
    f->traits = f->does->traits;
    cw_fault_aim(f);
    f->to_pass = rule->skip;
    if (f->rule.every == 0)
        f->rule.every = 1;
    cw_prng_init(&f->prng, bus->seed, rule->name);
    if (rule->trigger == CW_TRIGGER_TIME) {
        f->fire_at = rule->time_begin > cw_now(bus) ? rule->time_begin : cw_now(bus);
        cw_fault_set_due(&bus->faults, f->fire_at);
    }
    cw_fault_index_add(set, place);
    count_kinds(bus);
    *index = place;
    return CW_OK;
}

static bool is_rule(const cw_bus *bus, unsigned index)
{
    return index < bus->faults.count && bus->faults.faults[index].used;
}

cw_status cw_bus_stop_rule(cw_bus *bus, unsigned index)
{
    if (!is_rule(bus, index))
        return CW_INVALID;
    cw_wake_controllers(bus);
    cw_fault_end_action(bus, index);
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
    for (unsigned i = 0; i < bus->faults.count; i++)
        if (bus->faults.faults[i].rule.after == rule)
            bus->faults.faults[i].rule.after = CW_NO_RULE;
}

cw_status cw_bus_clear_rule(cw_bus *bus, unsigned index)
{
    if (!is_rule(bus, index))
        return CW_INVALID;
    cw_wake_controllers(bus);
    cw_fault_end_action(bus, index);
    disown_frames(bus, index);
    abandon_followers(bus, index);
    cw_fault_index_remove(&bus->faults, index);
    cw_list_remove(bus->faults.awake, &bus->faults.awake_count, index);
    bus->faults.faults[index].used = false;
    bus->faults.faults[index].awake = false;
    count_kinds(bus);
    return CW_OK;
}

cw_status cw_bus_fire_rule(cw_bus *bus, unsigned index)
{
    if (!is_rule(bus, index))
        return CW_INVALID;
    const cw_fault *f = cw_fault_at(bus, index);
    bool ready = f->rule.manual && !cw_fault_is_over(f);
    return ready && cw_fault_add_arming(bus, index, cw_now(bus)) ? CW_OK : CW_REFUSED;
}

/* Its time window is over, or its one moment has come. */
static bool has_passed(const cw_bus *bus, const cw_fault *f)
{
    bool once = f->rule.trigger == CW_TRIGGER_TIME && f->fire_at == CW_NEVER && !f->active;
    return cw_now(bus) >= f->rule.time_end || once;
}

cw_status cw_rule_get_stats(const cw_bus *bus, unsigned rule, cw_rule_stats *stats)
{
    if (!is_rule(bus, rule))
        return CW_INVALID;
    const cw_fault *f = &bus->faults.faults[rule];
    *stats = (cw_rule_stats){.matches = f->matches,
                             .misses = f->matches - f->taken,
                             .hits = f->hits,
                             .active = f->active || f->bits_left > 0,
                             .over = cw_fault_is_over(f) || has_passed(bus, f)};
    return CW_OK;
}
