/* SPDX-License-Identifier: MIT
 *
 * shared.c - one controller takes a bit for all nodes that do the same; nodes join them.
 */
#include "step/step.h"

#include "format/bitset.h"
#include "mac/confinement.h"

/* The counters of the shared controller mean nothing. Its REC begins each bit at this value, and
 * the counters of its followers move as it does. Neither limit is in reach. */
#define REC_BASE 64u

/* ---- Joining --------------------------------------------------------------------------------- */

/* Returns true when the node responds to levels like the others. */
static bool is_ordinary(const cw_mac *m)
{
    bool on_bus = m->phase >= CW_MAC_IDLE && m->phase <= CW_MAC_INTERMISSION;
    return on_bus && m->role != CW_ROLE_TRANSMITTER && !m->no_ack && m->overloads_wanted == 0 &&
           !(m->modes & CW_MODES_APART) && !m->no_long_dlc && !m->sleeps &&
           !cw_confinement_passive(&m->confinement) && m->reported_state == m->confinement.state;
}

/* Makes the controller that the followers share, at the point of one of them. */
static void begin_common(cw_bus *bus, const cw_mac *first)
{
    cw_mac_init(&bus->common, 0, CW_REC_MAX);
    (void)cw_mac_set_protocol(&bus->common, first->protocol, first->fd ? bus->fd_parts : NULL);
    cw_mac_go_to_point(&bus->common, first);
}

void cw_join(cw_bus *bus, unsigned i)
{
    cw_mac *m = &bus->nodes[i].mac;
    if (bus->stepping || !is_ordinary(m))
        return;
    if (bus->followers == 0)
        begin_common(bus, m);
    else if (!cw_mac_same_point(m, &bus->common))
        return;
    if (m->phase != CW_MAC_IDLE)
        cw_outlook_forget(bus);
    m->phase = CW_MAC_IDLE; /* for searches for transmitters */
    m->role = CW_ROLE_NONE;
    bus->followers |= cw_node_bit(i);
}

/* ---- One bit --------------------------------------------------------------------------------- */

void cw_split_followers(cw_bus *bus, uint64_t levels)
{
    uint64_t high = bus->followers & levels;
    uint64_t low = bus->followers & ~levels;
    if (high && low)
        cw_leave(bus, cw_count_bits(high) < cw_count_bits(low) ? high : low);
}

/* Moves the counters of followers as the bit moved the shared REC. Returns true when that has
 * changed a state. */
static bool move_counters(cw_bus *bus, int steps)
{
    bool changed = false;
    uint64_t passive = 0;
    for (uint64_t rest = bus->followers; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        cw_mac *m = &bus->nodes[i].mac;
        if (steps > 0)
            cw_confinement_rx_error(&m->confinement, (unsigned)steps);
        else
            cw_confinement_rx_success(&m->confinement);
        changed = changed || m->reported_state != m->confinement.state;
        m->reported_state = m->confinement.state;
        if (cw_confinement_passive(&m->confinement))
            passive |= cw_node_bit(i);
    }
    cw_leave(bus, passive);
    return changed;
}

bool cw_sample_common(cw_bus *bus, uint64_t levels, cw_mac_report *report)
{
    bus->common.confinement.rec = REC_BASE;
    cw_mac_sample(&bus->common, levels & bus->followers, report);
    int steps = (int)bus->common.confinement.rec - (int)REC_BASE;
    bool changed = steps != 0 && move_counters(bus, steps);
    return changed || report->what != 0;
}
