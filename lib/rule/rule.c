/* SPDX-License-Identifier: MIT
 *
 * rule.c - whether a match of a rule is a hit, and what is counted of it.
 */
#include "rule/private.h"

bool cw_fault_is_over(const cw_fault *f)
{
    return f->rule.count != 0 && f->hits >= f->rule.count;
}

static bool states_match(const cw_bus *bus, const cw_rule *rule)
{
    for (uint64_t rest = rule->state_nodes; rest; rest &= rest - 1) {
        unsigned state = 1u << cw_mac_state(&bus->nodes[cw_lowest_node(rest)].mac);
        if (!(rule->state_mask & state))
            return false;
    }
    return true;
}

static bool is_gated(const cw_bus *bus, const cw_fault *f, uint64_t start)
{
    const cw_rule *r = &f->rule;
    return start < r->time_begin || start >= r->time_end || cw_fault_is_over(f) ||
           (cw_fault_needs_arming(r) && f->armed == 0) || !states_match(bus, r);
}

void cw_fault_count_hit(cw_bus *bus, unsigned rule, uint64_t told)
{
    cw_fault *f = cw_fault_at(bus, rule);
    f->hits++;
    f->last_hit = told;
    bus->faults.stale = bus->faults.stale || cw_fault_is_over(f);
    cw_fault_arm_followers(bus, rule, told);
}

/* A match comes. Whether it is its turn, so that only chance can still make it none. */
static inline bool count_match(const cw_bus *bus, cw_fault *f, uint64_t start, uint64_t told)
{
    if (is_gated(bus, f, start))
        return false;
    f->matches++;
    if (f->rule.hold_off > 0 && f->hits > 0 && told - f->last_hit < f->rule.hold_off)
        return false;
    if (f->to_pass == 0)
        return true;
    f->to_pass--;
    return false;
}

static bool draw_match(cw_fault *f)
{
    if (f->rule.probability == UINT64_MAX)
        return true;
    return cw_prng_next(&f->prng) < f->rule.probability;
}

bool cw_fault_takes_match(cw_bus *bus, unsigned rule, uint64_t start, uint64_t told)
{
    cw_fault *f = cw_fault_at(bus, rule);
    if (!count_match(bus, f, start, told))
        return false;
    f->to_pass = f->rule.every - 1;
    if (!draw_match(f))
        return false;
    if (cw_fault_needs_arming(&f->rule))
        f->armed--;
    f->taken++;
    return true;
}

bool cw_fault_passes_over(cw_bus *bus, unsigned rule, uint64_t start, uint64_t told)
{
    cw_fault *f = cw_fault_at(bus, rule);
    if (!count_match(bus, f, start, told))
        return true;
    const cw_prng before = f->prng;
    if (draw_match(f)) {
        f->matches--;
        f->prng = before;
        return false;
    }
    f->to_pass = f->rule.every - 1;
    return true;
}

bool cw_fault_match(cw_bus *bus, unsigned rule, uint64_t start, uint64_t told)
{
    if (!cw_fault_takes_match(bus, rule, start, told))
        return false;
    cw_fault_count_hit(bus, rule, told);
    return true;
}
