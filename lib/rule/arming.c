/* SPDX-License-Identifier: MIT
 *
 * arming.c - rules that act only when they are armed: after a hit of another one, or by hand.
 */
#include "rule/private.h"

#include <string.h>

bool cw_fault_add_arming(cw_bus *bus, unsigned rule, uint64_t tick)
{
    cw_fault *f = cw_fault_at(bus, rule);
    if (f->armings == CW_ARMINGS_MAX)
        return false;
    unsigned place = f->armings++;
    for (; place > 0 && f->arm_at[place - 1] > tick; place--)
        f->arm_at[place] = f->arm_at[place - 1];
    f->arm_at[place] = tick;
    cw_fault_set_due(&bus->faults, tick);
    return true;
}

void cw_fault_take_arming(cw_fault *f, uint64_t tick)
{
    f->armed_at = tick;
    f->armed++;
    f->armings--;
    memmove(&f->arm_at[0], &f->arm_at[1], f->armings * sizeof f->arm_at[0]);
}

/* When the next arming takes place. Rules without delay can make a ring: it goes round once in a
 * bit. */
uint64_t cw_fault_next_arming(const cw_fault *f)
{
    if (f->armings == 0)
        return CW_NEVER;
    bool again = f->armed_at != CW_NEVER && f->arm_at[0] <= f->armed_at;
    return again ? f->armed_at + 1 : f->arm_at[0];
}

/* Rules that come after this one are armed, at once or later. */
void cw_fault_arm_followers(cw_bus *bus, unsigned rule, uint64_t told)
{
    if (bus->faults.after_rules == 0)
        return;
    bus->work += 1 + bus->faults.count / CW_RULES_OF_A_PIECE;
    for (unsigned i = 0; i < bus->faults.count; i++) {
        const cw_fault *f = cw_fault_at(bus, i);
        if (f->used && f->rule.has_after && f->rule.after == rule)
            (void)cw_fault_add_arming(bus, i, cw_after(told, f->rule.after_delay));
    }
}
