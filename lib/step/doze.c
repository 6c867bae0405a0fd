/* SPDX-License-Identifier: MIT
 *
 * doze.c - sleeping nodes wait for a dominant phase that is long enough to wake them.
 *
 * Their transceivers look at the wire without a clock. Levels change with the bits where these are
 * common to all nodes. Elsewhere a node looks at the end of each of its quanta, from the start of
 * a bit time of the bus. It is woken at the end of the bit, or of the bit time.
 */
#include "step/quantum.h"

#define TICKS_MAX (UINT64_C(1) << 30) /* more than any filter; in CW_TICK it fits into 64 bits */

static cw_wake_filter *filter_of(cw_bus *bus, unsigned i)
{
    return &bus->sleeps[i].filter;
}

/* Returns the nodes that see the wire: those that are not cut off. */
static uint64_t on_wire(const cw_bus *bus)
{
    return bus->dozing & ~bus->rules.off;
}

/* Returns the ticks of some bits, in units of moments. The number is cut off where it could not be
 * added to. */
static uint64_t in_ticks(const cw_bus *bus, uint64_t bits)
{
    const uint64_t ticks = cw_rate_ticks_or_never(cw_wire_rate(&bus->time), bits);
    return cw_least(ticks, TICKS_MAX) * (uint64_t)CW_TICK;
}

uint64_t cw_doze(cw_bus *bus, uint64_t levels, uint64_t bits)
{
    const uint64_t seen = levels | ~on_wire(bus), time = in_ticks(bus, bits);
    uint64_t woken = 0;
    for (uint64_t rest = bus->dozing; rest; rest &= rest - 1) {
        const unsigned i = cw_lowest_node(rest);
        if (cw_wake_filter_take(filter_of(bus, i), seen >> i & 1u, time))
            woken |= cw_node_bit(i);
    }
    return woken;
}

uint64_t cw_doze_bits(const cw_bus *bus)
{
    uint64_t time = UINT64_MAX;
    for (uint64_t rest = on_wire(bus); rest; rest &= rest - 1) {
        const cw_wake_filter *f = &bus->sleeps[cw_lowest_node(rest)].filter;
        time = cw_least(time, f->length > f->dominant ? f->length - f->dominant - 1 : 0);
    }
    return time == UINT64_MAX ? time : time / in_ticks(bus, 1);
}

void cw_doze_forget(cw_bus *bus)
{
    for (uint64_t rest = bus->dozing; rest; rest &= rest - 1)
        filter_of(bus, cw_lowest_node(rest))->dominant = 0;
}

/* ---- Off the grid ---------------------------------------------------------------------------- */

/* Returns true when a node sees one level from a moment on: no edge has come since. */
static bool sees_one_level(const cw_bus *bus, cw_span begin)
{
    const cw_timed *t = &bus->timed;
    return t->calm && cw_timed_is_plain(bus) && t->cable.newest + t->cable.longest < begin;
}

/* Returns the level that a node sees. One that is cut off sees recessive. */
static bool level_at(const cw_bus *bus, unsigned i, cw_span moment)
{
    return on_wire(bus) >> i & 1u ? cw_timed_level(bus, i, moment) : CW_RECESSIVE;
}

/* Looks up to the end of the bit time. Returns true when the node is woken. */
static bool is_woken(cw_bus *bus, unsigned i, cw_span begin, cw_span end)
{
    const cw_span quantum = bus->timed.nodes[i].timing.quantum;
    const cw_span step = sees_one_level(bus, begin) ? end - begin : quantum;
    bool woken = false;
    for (cw_span moment = begin; moment < end && !woken;) {
        const cw_span next = end - moment < step ? end : moment + step;
        woken = cw_wake_filter_take(filter_of(bus, i), level_at(bus, i, next),
                                    (uint64_t)(next - moment));
        moment = next;
    }
    return woken;
}

/* Has the node end a bit at a moment, with the report. Nobody can see when its bits begin. */
static void doze_report(cw_bus *bus, unsigned i, cw_span moment)
{
    cw_timed_node *n = &bus->timed.nodes[i];
    cw_timed_settle(&bus->timed, i);
    cw_agenda_remove(&bus->timed.agenda, i);
    n->ahead = false;
    n->pcs.sampled = true;
    n->pcs.synchronised = false;
    n->pcs.last_sample = cw_timed_level(bus, i, moment);
    n->next_begin = moment;
    n->report.what |= CW_REPORT_WAKE;
    cw_agenda_put(&bus->timed.agenda, i, CW_ENDS, moment);
}

void cw_timed_doze(cw_bus *bus, cw_span end)
{
    const cw_span begin = cw_moment_of(bus, cw_now(bus));
    for (uint64_t rest = bus->dozing; rest; rest &= rest - 1) {
        const unsigned i = cw_lowest_node(rest);
        if (is_woken(bus, i, begin, end))
            doze_report(bus, i, end);
    }
}
