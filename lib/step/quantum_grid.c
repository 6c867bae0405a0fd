/* SPDX-License-Identifier: MIT
 *
 * quantum_grid.c - off the grid of common bits, and back to it.
 */
#include "step/quantum.h"

#include "mac/mac.h"

#define REBASE_AFTER (UINT64_C(1) << 28) /* ticks; moments stay below 2^61 */

/* Returns the level that a controller has put onto the wire last. */
static bool last_driven(const cw_mac *mac)
{
    return mac->driven || (mac->modes & (CW_MODE_LISTEN_ONLY | CW_MODE_LOOPBACK)) ? CW_RECESSIVE
                                                                                  : CW_DOMINANT;
}

static void enter_node(cw_bus *bus, unsigned i)
{
    timed_node *n = &bus->timed.nodes[i];
    n->begin = n->next_begin = n->looked = 0;
    n->driven = last_driven(&bus->nodes[i].mac);
    n->report.what = 0;
    n->pcs.sampled = true;
    n->pcs.synchronised = false;
    n->pcs.last_sample = bus->wire;
    if (n->driven == CW_DOMINANT)
        bus->timed.cable.dominant |= cw_node_bit(i);
    cw_agenda_put(&bus->timed.agenda, i, CW_BEGINS, 0);
}

void cw_timed_enter(cw_bus *bus)
{
    cw_timed *t = &bus->timed;
    cw_wake_controllers(bus);
    cw_leave(bus, bus->all);
    t->active = true;
    t->epoch = cw_now(bus);
    t->cable.count = 0;
    t->cable.dominant = 0;
    t->cable.newest = -t->cable.longest - 1;
    t->disturbances.count = 0;
    cw_agenda_clear(&t->agenda);
    for (unsigned i = 0; i < bus->node_count; i++)
        enter_node(bus, i);
}

/* Returns true when all nodes begin a bit at a moment, on time. */
static bool all_begin_at(const cw_timed *t, cw_span moment)
{
    for (unsigned k = 0; k < t->agenda.count; k++) {
        const agenda_entry *e = &t->agenda.entries[t->agenda.first + k];
        if (e->moment != moment || cw_agenda_what(e) != CW_BEGINS ||
            t->nodes[cw_agenda_node(e)].next_begin != moment)
            return false;
    }
    return true;
}

void cw_timed_leave(cw_bus *bus)
{
    cw_timed *t = &bus->timed;
    if (t->requested || !t->uniform || bus->rules.timed_rules || t->disturbances.count)
        return;
    t->active = !all_begin_at(t, cw_moment_of(bus, cw_now(bus)));
}

void cw_timed_rebase(cw_bus *bus)
{
    cw_timed *t = &bus->timed;
    const uint64_t ticks = cw_now(bus) - t->epoch;
    if (ticks < REBASE_AFTER)
        return;
    const cw_span by = (cw_span)ticks * CW_TICK;
    t->epoch = cw_now(bus);
    cw_cable_rebase(&t->cable, by);
    cw_disturb_rebase(&t->disturbances, by);
    cw_agenda_rebase(&t->agenda, by);
    for (unsigned i = 0; i < bus->node_count; i++) {
        t->nodes[i].begin -= by;
        t->nodes[i].next_begin -= by;
        t->nodes[i].looked -= by;
    }
}
