/* SPDX-License-Identifier: MIT
 *
 * note.c - notes each bit in progress for traces: levels, and places as each node counts them.
 */
#include "state/state.h"

#include "format/parts.h"

/* M1, M6: returns true in the bit in which a waiting node takes a dominant level for a SOF. */
static bool takes_sof(const cw_mac *m, bool level)
{
    if (level)
        return false;
    bool third = m->phase == CW_MAC_INTERMISSION && m->count == CW_INTERMISSION_BITS - 1;
    return third || m->phase == CW_MAC_IDLE || m->phase == CW_MAC_SUSPEND;
}

/* Returns the CW_BITS_* that the frames of all transmitters have in common. */
static unsigned format_sent(const cw_bus *bus)
{
    unsigned common = CW_BITS_EXTENDED | CW_BITS_FD;
    bool any = false;
    for (uint64_t rest = bus->all & ~bus->followers; rest; rest &= rest - 1) {
        const cw_mac *m = &bus->nodes[cw_lowest_node(rest)].mac;
        if (!cw_mac_is_sending(m))
            continue;
        any = true;
        common &= cw_mac_tx(m)->format;
    }
    return any ? common : 0;
}

/* Receivers cannot tell SRR and FDF from the bits of other frames at these places, before they have
 * seen more. Their traces have the names of the transmitter's bits. */
__attribute__((noinline)) static cw_field name_as_sent(const cw_bus *bus, const cw_mac *m,
                                                       const cw_place *place)
{
    if (place->field == CW_FIELD_RTR && !place->extended)
        return format_sent(bus) & CW_BITS_EXTENDED ? CW_FIELD_SRR : CW_FIELD_RTR;
    const bool reserved = place->field == CW_FIELD_R0 || place->field == CW_FIELD_R1;
    const bool knows_fd = (m->protocol & CW_PROTOCOL_MASK) != CW_CLASSICAL;
    return reserved && knows_fd && (format_sent(bus) & CW_BITS_FD) ? CW_FIELD_FDF
                                                                   : (cw_field)place->field;
}

cw_place cw_view_place(const cw_bus *bus, const cw_mac *m)
{
    cw_place place = cw_mac_place(m);
    const bool fits = place.field >= CW_FIELD_RTR && place.field <= CW_FIELD_R0;
    if (fits && m->role == CW_ROLE_RECEIVER)
        place.field = name_as_sent(bus, m, &place);
    return place;
}

/* Notes where a node is. A waiting node takes a dominant level for SOF only when it samples it. */
static void note_place(const cw_bus *bus, cw_bit_node *n, const cw_mac *m, bool level)
{
    if (takes_sof(m, level))
        *n = (cw_bit_node){.place = {.field = CW_FIELD_SOF}, .phase = CW_MAC_FRAME,
                           .role = CW_ROLE_RECEIVER};
    else
        *n = (cw_bit_node){.place = cw_view_place(bus, m), .phase = (cw_mac_phase)m->phase,
                           .role = (cw_role)m->role};
}

/* Notes the wires now, since rules may cut or mend the bus at the end of the bit. */
static void note_wires(cw_bus *bus)
{
    bus->note.wire_count = bus->group_count;
    for (unsigned i = 0; bus->group_count > 1 && i < bus->node_count; i++)
        for (unsigned g = 0; g < bus->group_count; g++)
            if (bus->groups[g] & cw_node_bit(i))
                bus->note.wires[i] = (uint8_t)g;
}

static void clear_bit(uint64_t *levels, unsigned i)
{
    *levels &= ~cw_node_bit(i);
}

/* Notes what a node wants on the wire, what it samples and where it is. */
static void note_node(cw_bus *bus, unsigned i, const cw_mac *m, bool sampled)
{
    cw_bit_note *note = &bus->note;
    bool hidden = m->modes & (CW_MODE_LISTEN_ONLY | CW_MODE_LOOPBACK);
    bool level = cw_mac_visible(m, sampled);
    if (!level)
        clear_bit(&note->sampled, i);
    if (!m->driven && !hidden)
        clear_bit(&note->wanted, i);
    note_place(bus, &note->nodes[i], m, level);
    if (bus->listening >> i & 1u) /* nobody sees it do so */
        note->nodes[i] = (cw_bit_node){.phase = CW_MAC_ASLEEP};
}

/* Nodes that follow one controller are at one place, unless their levels differ. */
static void note_followers(cw_bus *bus, const cw_levels *levels)
{
    cw_bit_note *note = &bus->note;
    const unsigned first = cw_lowest_node(bus->followers);
    const uint64_t low = bus->followers & ~levels->sampled;
    bool together = low == 0 || low == bus->followers;
    note->alike = together ? bus->followers : 0;
    note_node(bus, first, &bus->common, levels->sampled >> first & 1u);
    for (uint64_t rest = together ? 0 : bus->followers; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        note_node(bus, i, &bus->common, levels->sampled >> i & 1u);
    }
    if (together && !(note->sampled >> first & 1u))
        note->sampled &= ~bus->followers;
    if (together && !(note->wanted >> first & 1u))
        note->wanted &= ~bus->followers;
}

void cw_view_note(cw_bus *bus, const cw_levels *levels)
{
    cw_bit_note *note = &bus->note;
    note->start = cw_now(bus);
    note->end = cw_bit_end(bus);
    note->fast = cw_fast_nodes(bus);
    note->steady = false;
    note->levels = *levels;
    note->came = levels->wire;
    note->sampled = levels->sampled | bus->all;
    note->wanted = UINT64_MAX;
    note->alike = 0;
    if (bus->followers)
        note_followers(bus, levels);
    for (uint64_t rest = bus->all & ~bus->followers; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        note_node(bus, i, &bus->nodes[i].mac, levels->sampled >> i & 1u);
    }
    note_wires(bus);
}

void cw_view_note_sent(cw_bus *bus, const cw_levels *levels, unsigned sender,
                       const cw_bit_node *all)
{
    cw_bit_note *note = &bus->note;
    cw_bit_node *receivers = &note->nodes[cw_lowest_node(bus->followers)];
    note->start = cw_now(bus);
    note->end = cw_bit_end(bus);
    note->fast = 0;
    note->steady = false;
    note->levels = *levels;
    note->came = levels->wire;
    note->sampled = levels->sampled;
    note->wanted = levels->driven;
    note->alike = bus->followers;
    note->wire_count = 1;
    *receivers = *all;
    receivers->role = CW_ROLE_RECEIVER;
    note->nodes[sender] = *all;
    note->nodes[sender].role = CW_ROLE_TRANSMITTER;
}

/* Returns true for a phase that goes on, without a report, until something comes in or is
 * reported. */
static bool is_quiet_phase(unsigned phase)
{
    return phase == CW_MAC_IDLE || phase == CW_MAC_OFF || phase == CW_MAC_BUS_OFF ||
           phase == CW_MAC_RECOVERING || phase == CW_MAC_ASLEEP;
}

bool cw_view_is_quiet(const cw_bus *bus)
{
    const cw_bit_note *note = &bus->note;
    const cw_levels *l = &note->levels;
    uint64_t recessive = l->driven & l->wire & l->clean & l->sampled & note->sampled & note->wanted;
    if (note->end == 0 || note->end != cw_now(bus) || (recessive & bus->all) != bus->all)
        return false;
    for (unsigned i = 0; i < bus->node_count; i++) {
        unsigned phase = cw_noted(note, i)->phase;
        if (!is_quiet_phase(phase) || phase != (unsigned)cw_phase_of(bus, i))
            return false;
    }
    return true;
}
