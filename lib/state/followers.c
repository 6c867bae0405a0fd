/* SPDX-License-Identifier: MIT
 *
 * followers.c - one controller for all nodes that do the same.
 *
 * Receivers without errors of their own take every bit in the same way. They follow one shared
 * controller, so that a bit costs the same for 2 nodes and for 64. A follower keeps its counters,
 * modes and frames; it shares only the point of the frame. A follower gets its own controller back
 * as soon as it does something different. It may begin to transmit, sample another level than the
 * others, become error passive, or be changed by a call or a rule.
 */
#include "state/state.h"

#include <assert.h>

void cw_leave(cw_bus *bus, uint64_t nodes)
{
    for (uint64_t rest = nodes & bus->followers; rest; rest &= rest - 1)
        cw_mac_go_to_point(&bus->nodes[cw_lowest_node(rest)].mac, &bus->common);
    bus->followers &= ~nodes;
}

cw_mac *cw_own_mac(cw_bus *bus, unsigned i)
{
    assert(!bus->frame_step.active);
    cw_outlook_forget(bus);
    cw_leave(bus, cw_node_bit(i));
    cw_timed_settle(&bus->timed, i);
    bus->timed.touched |= cw_node_bit(i);
    bus->unplugged &= ~cw_node_bit(i);
    return &bus->nodes[i].mac;
}

const cw_mac *cw_mac_of(const cw_bus *bus, unsigned i)
{
    return bus->followers >> i & 1u ? &bus->common : &bus->nodes[i].mac;
}
