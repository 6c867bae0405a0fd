/* SPDX-License-Identifier: MIT
 *
 * quantum_ringing.c - the swing of the wire at nodes with clocks of their own, and changes of it.
 *
 * Nodes look back at quanta that have passed, where the wire swung as it did at that time. So the
 * ringing before the last change is kept for as long as a look can reach back to it.
 */
#include "step/quantum.h"

/* Forgets ringings from before a change. */
static void forget_former(cw_timed *t)
{
    t->rings = t->rings_before = false;
    for (unsigned i = 0; i < t->cable.node_count; i++) {
        cw_ringing *r = &t->ringing[i];
        r->former = 0;
        t->rings = t->rings || r->now > 0;
    }
}

void cw_timed_begin_ringing(cw_timed *t)
{
    for (unsigned i = 0; i < t->cable.node_count; i++)
        t->ringing[i].since = t->ringing[i].former_since = CW_LONG_AGO;
    forget_former(t);
}

void cw_timed_set_ringing(cw_timed *t, unsigned i, cw_span ringing)
{
    cw_ringing *r = &t->ringing[i];
    if (r->since < t->moment) /* of two changes at one moment only the last one counts */
        *r = (cw_ringing){.since = t->moment, .former = r->now, .former_since = r->since};
    r->now = ringing;
    t->rings = t->rings_before = true;
    t->calm = false;
    if (!t->active)
        cw_timed_begin_ringing(t);
}

void cw_timed_forget_ringing(cw_bus *bus)
{
    cw_timed *t = &bus->timed;
    const cw_span earliest = cw_timed_earliest_look(bus);
    for (unsigned i = 0; i < bus->node_count; i++)
        if (t->ringing[i].since >= earliest)
            return;
    forget_former(t);
}

void cw_timed_rebase_ringing(cw_timed *t, cw_span by)
{
    for (unsigned i = 0; i < t->cable.node_count; i++) {
        cw_moment_rebase(&t->ringing[i].since, by);
        cw_moment_rebase(&t->ringing[i].former_since, by);
    }
}
