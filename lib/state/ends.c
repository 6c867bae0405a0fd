/* SPDX-License-Identifier: MIT
 *
 * ends.c - notes when transmissions end, for the receivers that have their frames a little later.
 */
#include "state/state.h"

void cw_note_end(cw_bus *bus, unsigned i, uint64_t tick)
{
    const cw_bus_node *n = &bus->nodes[i];
    const cw_queue_slot *slot = cw_queue_at(&n->queue, n->offered_slot);
    cw_start *start = &bus->starts[i];
    start->stopped = tick;
    start->handed_in = slot->handed_in;
    start->end = CW_END_SENT;
}

void cw_note_stopped(cw_bus *bus, unsigned i, cw_place place)
{
    if (bus->starts[i].stopped != 0)
        return;
    const cw_bus_node *n = &bus->nodes[i];
    cw_note_end(bus, i, cw_now(bus));
    bus->starts[i].can_id = cw_frame_can_id(cw_queue_at(&n->queue, n->offered_slot)->frame);
    bus->starts[i].end = place.field < CW_FIELD_CRC ? CW_END_EARLY : CW_END_LATE;
}

void cw_note_left(cw_bus *bus, unsigned i)
{
    const cw_mac *m = &bus->nodes[i].mac;
    if (m->role == CW_ROLE_TRANSMITTER)
        cw_note_stopped(bus, i, cw_mac_place(m));
}

void cw_note_report(cw_bus *bus, unsigned i, const cw_mac_report *r)
{
    if ((r->what & CW_REPORT_ERROR) && r->error.role == CW_ROLE_TRANSMITTER)
        cw_note_stopped(bus, i, r->error.place);
}
