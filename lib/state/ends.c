/* SPDX-License-Identifier: MIT
 *
 * ends.c - notes when transmissions end, for the receivers that have their frames a little later.
 */
#include "state/state.h"

#define LONG_AGO 1u

void cw_note_end(cw_bus *bus, unsigned i, uint64_t tick)
{
    const cw_bus_node *n = &bus->nodes[i];
    bus->starts[i].stopped = tick;
    bus->starts[i].handed_in = cw_queue_at(&n->queue, n->offered_slot)->handed_in;
}

void cw_note_stopped(cw_bus *bus, unsigned i, cw_place place)
{
    if (bus->starts[i].stopped == 0)
        cw_note_end(bus, i, place.field < CW_FIELD_CRC ? LONG_AGO : cw_now(bus));
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
