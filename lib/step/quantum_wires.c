/* SPDX-License-Identifier: MIT
 *
 * quantum_wires.c - the wires of a partitioned bus whose nodes have clocks of their own.
 *
 * Nodes look back: to the last sample, by the delay of the line, by its swing. All that they see
 * there was on the wires of that time. So the wires before the last change are kept for as long as
 * a look can reach back to them. Wires change at the start of a bit time only.
 */
#include "step/quantum.h"

#include <string.h>

/* Returns true when the wires are still those of the bus. */
static bool are_those_of(const cw_wires *wires, const cw_bus *bus)
{
    return wires->count == bus->group_count &&
           (wires->count == 1 ||
            memcmp(wires->nodes, bus->groups, wires->count * sizeof wires->nodes[0]) == 0);
}

static void copy(cw_wires *wires, const cw_bus *bus)
{
    wires->count = bus->group_count;
    memcpy(wires->nodes, bus->groups, wires->count * sizeof wires->nodes[0]);
}

void cw_timed_begin_wires(cw_bus *bus)
{
    cw_timed *t = &bus->timed;
    copy(&t->wires, bus);
    t->old_wires = t->wires;
    t->rewired_at = CW_LONG_AGO;
    t->one_wire = t->wires.count == 1;
}

cw_span cw_timed_earliest_look(const cw_bus *bus)
{
    const cw_timed *t = &bus->timed;
    cw_span earliest = INT64_MAX;
    for (unsigned i = 0; i < bus->node_count; i++) {
        const cw_timed_node *n = &t->nodes[i];
        const cw_span back =
            n->looked - 2 * n->timing.quantum - cw_timed_longest_ringing(t, i);
        earliest = back < earliest ? back : earliest;
    }
    return earliest - t->cable.longest;
}

bool cw_timed_forget_wires(cw_bus *bus, cw_span moment)
{
    cw_timed *t = &bus->timed;
    if (!are_those_of(&t->wires, bus))
        return false;
    if (!t->one_wire && t->wires.count == 1 && t->rewired_at < moment)
        t->one_wire = t->rewired_at < cw_timed_earliest_look(bus);
    return true;
}

void cw_timed_take_wires(cw_bus *bus, cw_span moment)
{
    cw_timed *t = &bus->timed;
    if (t->rewired_at != moment)
        t->old_wires = t->wires;
    copy(&t->wires, bus);
    t->rewired_at = moment;
    t->one_wire = false;
}

/* Wires that stay as they are go back in time no farther than that. */
void cw_timed_rebase_wires(cw_timed *timed, cw_span by)
{
    cw_moment_rebase(&timed->rewired_at, by);
}
