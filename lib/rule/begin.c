/* SPDX-License-Identifier: MIT
 *
 * begin.c - actions begin, last and end.
 */
#include "rule/private.h"

#include "rule/list.h"

void cw_fault_wake(cw_bus *bus, unsigned rule)
{
    cw_fault *f = cw_fault_at(bus, rule);
    if (f->awake)
        return;
    f->awake = true;
    cw_list_add(bus->faults.awake, &bus->faults.awake_count, rule);
}

void cw_fault_fall_asleep(cw_bus *bus)
{
    cw_fault_set *set = &bus->faults;
    unsigned kept = 0;
    for (unsigned i = 0; i < set->awake_count; i++) {
        unsigned rule = set->awake[i];
        cw_fault *f = cw_fault_at(bus, rule);
        cw_fault_unbind_ended(bus, f);
        f->awake = f->used && cw_fault_needs_bits(f);
        if (f->awake)
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

void cw_fault_end_action(cw_bus *bus, unsigned rule)
{
    cw_fault *f = cw_fault_at(bus, rule);
    f->active = false;
    f->scope = 0;
    f->bound = 0;
    f->bits_left = 0;
    f->to_act = false;
    f->active_until = CW_NEVER;
    cw_fault_let_go(bus, rule);
    if (cw_fault_is(f, CW_REWIRES))
        cw_fault_apply_topology(bus);
}

/* ---- Beginning ------------------------------------------------------------------------------- */

void cw_fault_begin_window(cw_bus *bus, unsigned rule, uint64_t scope)
{
    cw_fault *f = cw_fault_at(bus, rule);
    f->for_attempt = cw_fault_is(f, CW_FOR_ATTEMPT) && f->rule.trigger == CW_TRIGGER_FRAME &&
                     f->rule.for_ticks == 0;
    f->scope = f->for_attempt ? f->scope | scope : 0;
    f->active = true;
    f->active_until = window_end(bus, &f->rule);
    f->dominant_bits = 0;
    f->next_at = f->rule.action == CW_ACTION_SEND ? cw_now(bus) : CW_NEVER;
    f->busy_base = cw_busy_bits_so_far(bus);
    f->bits_base = cw_bits_so_far(bus);
    cw_fault_set_due(&bus->faults, f->active_until);
    cw_fault_set_due(&bus->faults, f->next_at);
    if (cw_fault_needs_bits(f))
        cw_fault_wake(bus, rule);
    bus->faults.rewired = bus->faults.rewired || cw_fault_is(f, CW_REWIRES);
}

void cw_fault_act(cw_bus *bus, unsigned rule)
{
    if (cw_fault_is(cw_fault_at(bus, rule), CW_LASTS))
        cw_fault_begin_window(bus, rule, 0);
    else
        cw_fault_command(bus, rule);
}

/* Whether a rule that is no position action begins to act. The hits of noise are the bits that it
 * flips, so its begin is none. */
bool cw_fault_begins(cw_bus *bus, unsigned rule, uint64_t start, uint64_t told)
{
    if (cw_fault_is(cw_fault_at(bus, rule), CW_RANDOM_BITS))
        return cw_fault_takes_match(bus, rule, start, told);
    return cw_fault_match(bus, rule, start, told);
}

/* The rule has a hit and acts when this bit has been settled. */
void cw_fault_act_later(cw_bus *bus, unsigned rule, uint64_t tick)
{
    cw_fault_at(bus, rule)->to_act = true;
    cw_fault_set_due(&bus->faults, tick);
}

void cw_fault_fire(cw_bus *bus, unsigned rule)
{
    if (!cw_fault_begins(bus, rule, cw_now(bus), cw_now(bus)))
        return;
    if (!cw_fault_is(cw_fault_at(bus, rule), CW_RANDOM_BITS))
        cw_push_fault(bus, rule, cw_now(bus));
    cw_fault_act(bus, rule);
}

void cw_fault_emit(cw_bus *bus)
{
    for (unsigned i = 0; i < bus->faults.awake_count; i++) {
        cw_fault *f = cw_fault_at(bus, bus->faults.awake[i]);
        if (f->hit_now)
            cw_push_fault(bus, bus->faults.awake[i], cw_now(bus));
        f->hit_now = false;
    }
    cw_fault_fall_asleep(bus);
}
