/* SPDX-License-Identifier: MIT
 *
 * view.c - the last bit as it was, for traces.
 */
#include "bus/bus_private.h"

/* Looks at the nodes between two bits. Those that are alike share what was noted of the lowest. */
static void view_nodes(const cw_bus *bus, cw_bit_node *nodes)
{
    const cw_bit_note *note = &bus->note;
    const uint64_t alike = note->alike;
    const cw_bit_node *const shared = &note->nodes[alike ? cw_lowest_node(alike) : 0];
    const cw_bus_node *own = bus->nodes;
    const unsigned count = bus->node_count;
    for (unsigned i = 0; i < count; i++) {
        const cw_confinement c = own[i].mac.confinement;
        nodes[i] = alike >> i & 1u ? *shared : note->nodes[i];
        nodes[i].wire = 0;
        nodes[i].state = (cw_state)c.state;
        nodes[i].tec = c.tec;
        nodes[i].rec = c.rec;
    }
    for (uint64_t rest = bus->asleep; rest; rest &= rest - 1)
        nodes[cw_lowest_node(rest)].state = CW_STATE_SLEEPING;
    for (unsigned i = 0; note->wire_count > 1 && i < bus->node_count; i++)
        nodes[i].wire = note->wires[i];
}

cw_status cw_bus_get_bit(const cw_bus *bus, cw_bit_view *view)
{
    const cw_bit_note *note = &bus->note;
    if (note->end == 0 || note->end != cw_now(bus))
        return CW_REFUSED;
    const cw_levels *levels = &note->levels;
    uint64_t nodes = UINT64_MAX >> (CW_NODES_MAX - bus->node_count);
    view->start = note->start;
    view->end = note->end;
    view->driven = levels->driven | ~nodes;
    view->wire = levels->wire | ~nodes;
    view->sampled = note->sampled | ~nodes;
    const bool marked = bus->timed.marking && bus->timed.mark_count > 0;
    const cw_bit_faults inside = marked ? bus->timed.faults : (cw_bit_faults){.tx = 0};
    view->tx_faults = ((levels->driven ^ note->wanted) | inside.tx) & nodes;
    view->wire_faults = ((levels->wire ^ levels->clean) | inside.wire) & nodes;
    view->rx_faults = ((levels->sampled ^ note->came) | inside.rx) & nodes;
    view->alike = note->alike;
    view->fast = note->fast;
    view->steady = note->steady;
    view->node_count = bus->node_count;
    view->wire_count = note->wire_count;
    view->marks = bus->timed.marks;
    view->mark_count = bus->timed.marking ? bus->timed.mark_count : 0;
    view_nodes(bus, view->nodes);
    return CW_OK;
}
