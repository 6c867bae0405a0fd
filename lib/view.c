/* SPDX-License-Identifier: MIT
 *
 * view.c - the last bit as it was: levels, places as each node counted them, faults; for traces.
 */
#include "bus_private.h"

#include "codec.h"

/* M1, M6: the bit in which a node that waits takes a dominant level for a SOF. */
static bool takes_sof(const cw_mac *m, bool level)
{
    if (level)
        return false;
    bool third = m->phase == CW_MAC_INTERMISSION && m->count == CW_INTERMISSION_BITS - 1;
    return third || m->phase == CW_MAC_IDLE || m->phase == CW_MAC_SUSPEND;
}

static void note_place(cw_bus *bus, unsigned i, bool level)
{
    const cw_mac *m = &bus->nodes[i].mac;
    bus->note.nodes[i].place = cw_mac_place(m);
    bus->note.nodes[i].phase = m->phase;
    bus->note.nodes[i].role = m->role;
    if (!takes_sof(m, level))
        return;
    bus->note.nodes[i].place = (cw_place){.field = CW_FIELD_SOF};
    bus->note.nodes[i].phase = CW_MAC_FRAME;
    bus->note.nodes[i].role = CW_ROLE_RECEIVER;
}

/* Rules may cut or mend the bus at the end of the bit. */
static void note_wires(cw_bus *bus)
{
    bus->note.wire_count = bus->group_count;
    for (unsigned i = 0; bus->group_count > 1 && i < bus->node_count; i++)
        for (unsigned g = 0; g < bus->group_count; g++)
            if (bus->groups[g] & cw_node_bit(i))
                bus->note.nodes[i].wire = (uint8_t)g;
}

static void clear_bit(uint64_t *levels, unsigned i)
{
    *levels &= ~cw_node_bit(i);
}

void cw_view_note(cw_bus *bus, const cw_levels *levels)
{
    bit_note *note = &bus->note;
    note->end = bus->now + bus->bit_ticks;
    note->levels = *levels;
    note->sampled = levels->sampled;
    note->wanted = UINT64_MAX;
    for (unsigned i = 0; i < bus->node_count; i++) {
        const cw_mac *m = &bus->nodes[i].mac;
        bool hidden = m->modes & (CW_MODE_LISTEN_ONLY | CW_MODE_LOOPBACK);
        bool level = cw_mac_visible(m, levels->sampled >> i & 1u);
        note->sampled |= cw_node_bit(i);
        if (!level)
            clear_bit(&note->sampled, i);
        if (!m->driven && !hidden)
            clear_bit(&note->wanted, i);
        note_place(bus, i, level);
    }
    note_wires(bus);
}

static void view_node(const cw_bus *bus, unsigned i, cw_bit_node *n)
{
    const cw_mac *m = &bus->nodes[i].mac;
    *n = (cw_bit_node){
        .place = bus->note.nodes[i].place,
        .phase = (cw_mac_phase)bus->note.nodes[i].phase,
        .role = (cw_role)bus->note.nodes[i].role,
        .wire = bus->note.wire_count > 1 ? bus->note.nodes[i].wire : 0,
        .state = cw_mac_state(m),
        .tec = m->confinement.tec,
        .rec = m->confinement.rec,
    };
}

cw_status cw_bus_get_bit(const cw_bus *bus, cw_bit_view *view)
{
    const bit_note *note = &bus->note;
    if (note->end == 0 || note->end != bus->now)
        return CW_REFUSED;
    const cw_levels *levels = &note->levels;
    uint64_t nodes = UINT64_MAX >> (CW_NODES_MAX - bus->node_count);
    view->start = note->end - bus->bit_ticks;
    view->end = note->end;
    view->driven = levels->driven | ~nodes;
    view->wire = levels->wire | ~nodes;
    view->sampled = note->sampled | ~nodes;
    view->tx_faults = (levels->driven ^ note->wanted) & nodes;
    view->wire_faults = (levels->wire ^ levels->clean) & nodes;
    view->rx_faults = (levels->sampled ^ levels->wire) & nodes;
    view->node_count = bus->node_count;
    view->wire_count = note->wire_count;
    for (unsigned i = 0; i < bus->node_count; i++)
        view_node(bus, i, &view->nodes[i]);
    return CW_OK;
}
