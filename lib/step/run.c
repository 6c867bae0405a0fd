/* SPDX-License-Identifier: MIT
 *
 * run.c - equal bits at once, in which no controller has a report: idle time, flags, delimiters,
 * rows of equal bits that all nodes read.
 */
#include "step/step.h"

#include "format/layout.h"

/* ---- Reach ----------------------------------------------------------------------------------- */

/* The flags that hold the wire dominant. */
typedef struct flags {
    unsigned least; /* bits to the end of the first one, ... */
    unsigned most;  /* ... and of the last one */
    bool error, overload; /* their kinds */
} flags;

/* Adds the flag of a controller, if there is one. */
static void add_flag(flags *f, const cw_mac *m)
{
    const unsigned bits = cw_mac_holds_wire(m);
    if (bits == 0)
        return;
    f->least = bits < f->least ? bits : f->least;
    f->most = bits > f->most ? bits : f->most;
    f->error = f->error || m->phase == CW_MAC_ERROR_ACTIVE;
    f->overload = f->overload || m->phase == CW_MAC_OVERLOAD_FLAG;
}

cw_held cw_find_held(const cw_bus *bus)
{
    flags f = {.least = CW_FLAG_BITS};
    if (bus->followers)
        add_flag(&f, &bus->common);
    for (uint64_t rest = cw_single_nodes(bus); rest; rest &= rest - 1)
        add_flag(&f, &bus->nodes[cw_lowest_node(rest)].mac);
    const bool errors = f.error && !f.overload; /* passive flags change nothing of what is seen */
    return (cw_held){.bits = f.error && f.overload ? f.least : f.most,
                     .view = errors ? CW_WIRE_BUSY | CW_WIRE_ERROR : 0};
}

/* Returns the bits in which a controller has nothing to report, and which end its flag at most. */
static uint64_t steady_bits_of(const cw_mac *m, bool level, bool waiting)
{
    return waiting && cw_mac_may_start(m) ? 0 : cw_mac_steady_bits(m, level);
}

/* Returns that for all controllers. */
static uint64_t steady_bits(const cw_bus *bus, bool level)
{
    uint64_t bits = CW_QUIET_FOREVER;
    if (bus->group_count > 1 && !level)
        return 0;
    if (bus->followers)
        bits = steady_bits_of(&bus->common, level, bus->waiting & bus->followers);
    for (uint64_t rest = cw_single_nodes(bus); bits > 0 && rest; rest &= rest - 1) {
        const unsigned i = cw_lowest_node(rest);
        bits = cw_least(bits, steady_bits_of(&bus->nodes[i].mac, level, bus->waiting >> i & 1u));
    }
    if (bus->dozing && level == CW_DOMINANT)
        bits = cw_least(bits, cw_doze_bits(bus));
    return bits;
}

/* A frame that comes within a bit changes nothing before the next bit, unless rules look at it, or
 * the bit ends with it. */
static uint64_t bits_up_to_inbox(const cw_bus *bus)
{
    uint64_t tick = cw_inbox_first(bus);
    return cw_host_side_acts(bus) || bus->start_at_tick ? cw_wire_bits_before(&bus->time, tick)
                                                        : cw_wire_bits_until(&bus->time, tick);
}

/* Returns how many of some bits pass up to a tick, and before something is due or comes in. For few
 * bits it mostly takes no division. */
static uint64_t bits_that_fit(const cw_bus *bus, uint64_t bits, uint64_t tick)
{
    if (bits <= CW_FRAME_BITS_MIN) {
        const uint64_t end = cw_wire_tick(&bus->time, bits);
        if (end <= tick && end <= cw_first_due(bus))
            return bits;
    }
    bits = cw_least(bits, cw_wire_bits_to(&bus->time, tick));
    bits = cw_least(bits, bits_up_to_inbox(bus));
    bits = cw_least(bits, cw_wire_bits_until(&bus->time, bus->node_due));
    return cw_least(bits, cw_wire_bits_until(&bus->time, bus->rules.next_due));
}

uint64_t cw_run_reach(cw_bus *bus, const cw_held *held, uint64_t tick)
{
    const unsigned touch = cw_rules_touch(&bus->rules);
    if ((touch & CW_TOUCH_MORE) || (held->bits && (touch & CW_TOUCH_DOMINANT)))
        return 0;
    uint64_t bits = steady_bits(bus, held->bits ? CW_DOMINANT : CW_RECESSIVE);
    if (held->bits)
        bits = cw_least(bits, held->bits);
    if (bits == 0)
        return 0;
    bits = bits_that_fit(bus, bits, tick);
    return bus->rules.awake_count ? cw_rules_keep_quiet(&bus->rules, bits, false) : bits;
}

/* ---- Going ----------------------------------------------------------------------------------- */

/* Skips bits of a controller. A new phase invalidates the outlook: the node may start, or be at the
 * point of the others. Returns true when there is one. */
static bool skip(cw_bus *bus, cw_mac *m, uint64_t bits, bool level)
{
    const unsigned phase = m->phase;
    cw_mac_skip(m, bits, level);
    if (m->phase == phase)
        return false;
    cw_outlook_forget(bus);
    return true;
}

void cw_run_go(cw_bus *bus, uint64_t bits, const cw_held *held)
{
    const bool level = held->bits ? CW_DOMINANT : CW_RECESSIVE;
    cw_watch_view(bus, held->view ? held->view : cw_view_wire(bus), bits);
    if (bus->rules.awake_count)
        (void)cw_rules_consume(&bus->rules, bits, NULL, NULL);
    if (bus->followers)
        (void)skip(bus, &bus->common, bits, level);
    for (uint64_t rest = cw_single_nodes(bus); rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        if (skip(bus, &bus->nodes[i].mac, bits, level))
            cw_join(bus, i);
    }
    if (bus->dozing)
        (void)cw_doze(bus, level ? UINT64_MAX : 0, bits);
    cw_wire_pass(&bus->time, bits);
    bus->stats.bits += bits;
    bus->recessive_bits = level ? bus->recessive_bits + bits : 0;
    cw_take_inbox_before(bus, cw_now(bus)); /* before other things due now, as in a single bit */
}
