/* SPDX-License-Identifier: MIT
 *
 * run.c - equal bits at once, in which no controller has a report: idle time, flags, delimiters,
 * rows of equal bits that all nodes read.
 */
#include "step/step.h"

/* ---- Reach ----------------------------------------------------------------------------------- */

/* Returns true when some node has a frame that it may begin to send in the next bit. */
static bool can_start(const cw_bus *bus)
{
    uint64_t own = bus->waiting & ~bus->followers;
    if (bus->waiting != own && cw_mac_can_start(&bus->common))
        return true;
    for (; own; own &= own - 1)
        if (cw_mac_can_start(&bus->nodes[cw_lowest_node(own)].mac))
            return true;
    return false;
}

bool cw_held_level(const cw_bus *bus)
{
    bool held = bus->followers && cw_mac_holds_wire(&bus->common);
    for (uint64_t rest = cw_single_nodes(bus); !held && rest; rest &= rest - 1)
        held = cw_mac_holds_wire(&bus->nodes[cw_lowest_node(rest)].mac);
    return held ? CW_DOMINANT : CW_RECESSIVE;
}

/* Returns the bits in which all controllers keep their levels and have nothing to report. */
static uint64_t steady_bits(const cw_bus *bus, bool level)
{
    uint64_t bits = CW_QUIET_FOREVER;
    if (bus->group_count > 1 && !level)
        return 0;
    if (bus->followers)
        bits = cw_mac_steady_bits(&bus->common, level);
    for (uint64_t rest = cw_single_nodes(bus); bits > 0 && rest; rest &= rest - 1)
        bits = cw_least(bits, cw_mac_steady_bits(&bus->nodes[cw_lowest_node(rest)].mac, level));
    if (bus->dozing && level == CW_DOMINANT)
        bits = cw_least(bits, cw_doze_bits(bus));
    return bits > 0 && can_start(bus) ? 0 : bits;
}

/* A frame that comes within a bit changes nothing before the next bit, unless rules look at it, or
 * the bit ends with it. */
static uint64_t bits_up_to_inbox(const cw_bus *bus)
{
    uint64_t tick = cw_inbox_first(bus);
    return cw_host_side_acts(bus) || bus->start_at_tick ? cw_wire_bits_before(&bus->time, tick)
                                                        : cw_wire_bits_until(&bus->time, tick);
}

uint64_t cw_run_reach(cw_bus *bus, bool level, uint64_t tick)
{
    const unsigned touch = cw_rules_touch(&bus->rules);
    if ((touch & CW_TOUCH_MORE) || (level == CW_DOMINANT && (touch & CW_TOUCH_DOMINANT)))
        return 0;
    uint64_t bits = steady_bits(bus, level);
    if (bits == 0)
        return 0;
    bits = cw_least(bits, cw_wire_bits_to(&bus->time, tick));
    bits = cw_least(bits, bits_up_to_inbox(bus));
    bits = cw_least(bits, cw_wire_bits_until(&bus->time, bus->node_due));
    bits = cw_least(bits, cw_wire_bits_until(&bus->time, bus->rules.next_due));
    if (bus->rules.awake_count == 0)
        return bits;
    return cw_rules_keep_quiet(&bus->rules, bits, false);
}

/* ---- Going ----------------------------------------------------------------------------------- */

/* Skips bits of a controller. A new phase invalidates the outlook: the node may start, or be at the
 * point of the others. */
static void skip(cw_bus *bus, cw_mac *m, uint64_t bits, bool level)
{
    const unsigned phase = m->phase;
    cw_mac_skip(m, bits, level);
    if (m->phase != phase)
        cw_outlook_forget(bus);
}

void cw_run_go(cw_bus *bus, uint64_t bits, bool level)
{
    cw_watch_wire(bus, bits);
    if (bus->rules.awake_count)
        (void)cw_rules_consume(&bus->rules, bits, NULL, NULL);
    if (bus->followers)
        skip(bus, &bus->common, bits, level);
    for (uint64_t rest = cw_single_nodes(bus); rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        skip(bus, &bus->nodes[i].mac, bits, level);
        cw_join(bus, i);
    }
    if (bus->dozing)
        (void)cw_doze(bus, level ? UINT64_MAX : 0, bits);
    cw_wire_pass(&bus->time, bits);
    bus->stats.bits += bits;
    bus->recessive_bits = level ? bus->recessive_bits + bits : 0;
    cw_take_inbox_before(bus, cw_now(bus)); /* before other things due now, as in a single bit */
}
