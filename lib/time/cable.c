/* SPDX-License-Identifier: MIT
 *
 * cable.c - the edges on a line, and what each node sees of them.
 *
 * Edges of the last moments are looked at one by one. Nearly all looks need none: no edge is under
 * way, so that each node sees what is driven.
 */
#include "time/cable.h"

#include <assert.h>
#include <string.h>


/* Returns the n-th edge before the newest one. The list is a ring. */
static inline const cw_edge *nth_from_end(const cw_cable *cable, unsigned n)
{
    return &cable->edges[(cable->count - 1 - n) & (cable->capacity - 1)];
}

/* Returns the edges that are still in the list. */
static inline unsigned kept(const cw_cable *cable)
{
    return cable->count < cable->capacity ? (unsigned)cable->count : cable->capacity;
}

void cw_cable_clear(cw_cable *cable)
{
    cable->count = cable->counted = 0;
    for (unsigned n = 0; n < CW_WAYS_KEPT; n++)
        cable->replaced[n] = CW_LONG_AGO;
    cable->dominant = 0;
    cable->newest = cable->to_dominant = -cable->longest - 1;
    cable->rise_from = CW_SPAN_MAX;
}

void cw_cable_put(cw_cable *cable, const cw_edge *edge)
{
    const uint64_t self = UINT64_C(1) << edge->node;
    assert(cable->count == 0 || edge->moment >= cable->newest);
    cable->edges[cable->count++ & (cable->capacity - 1)] = *edge;
    if (edge->level == CW_RECESSIVE) {
        cable->rise_from = CW_SPAN_MAX;
        cable->dominant &= ~self;
    } else {
        if (cable->dominant == 0)
            cable->rise_from = cable->newest + cable->longest;
        cable->to_dominant = edge->moment;
        cable->dominant |= self;
    }
    cable->newest = edge->moment;
}

/* ---- Ways ------------------------------------------------------------------------------------ */

cw_span cw_way_delay(const cw_way *from, const cw_way *to, bool level)
{
    const cw_span line = from->place < to->place ? to->place - from->place
                                                 : from->place - to->place;
    const cw_span stubs = from == to ? 0 : from->stub + to->stub;
    return from->tx_delay[level] + line + stubs + to->rx_delay[level];
}

cw_span cw_cable_former_delay(const cw_cable *cable, uint16_t ways, unsigned from, unsigned to,
                              bool level)
{
    const bool kept = (uint16_t)(cable->ways - ways) < CW_WAYS_KEPT;
    const cw_way *then = &cable->way[(ways % CW_WAYS_KEPT) * cable->node_count];
    return kept ? cw_way_delay(&then[from], &then[to], level)
                : cw_cable_delay(cable, from, to, level);
}

/* Ways by which nothing has come are changed in place. */
static bool are_used(const cw_cable *cable, bool carries)
{
    return cable->count != cable->counted || carries;
}

bool cw_cable_takes_way(const cw_cable *cable, bool carries, cw_span now, cw_span back)
{
    const cw_span replaced = cable->replaced[(cable->ways + 1u) % CW_WAYS_KEPT];
    return !are_used(cable, carries) || replaced + cable->longest + back < now;
}

void cw_cable_set_way(cw_cable *cable, unsigned node, const cw_way *way, bool carries,
                      cw_span now)
{
    if (are_used(cable, carries)) {
        const cw_way *before = cw_cable_ways(cable);
        cable->replaced[cable->ways % CW_WAYS_KEPT] = now;
        cable->ways++;
        memcpy(cw_cable_ways(cable), before, cable->node_count * sizeof *before);
        cable->counted = cable->count;
    }
    cw_cable_ways(cable)[node] = *way;
}

cw_span cw_cable_find_delays(cw_cable *cable)
{
    const cw_way *way = cw_cable_ways(cable);
    cw_span longest = 0;
    for (unsigned from = 0; from < cable->node_count; from++)
        for (unsigned to = 0; to < cable->node_count; to++)
            for (unsigned level = 0; level < 2; level++) {
                const cw_span delay = cw_way_delay(&way[from], &way[to], level);
                cable->delays[(from * cable->node_count + to) * 2 + level] = delay;
                longest = delay > longest ? delay : longest;
            }
    return longest;
}

/* ---- Looks ----------------------------------------------------------------------------------- */

/* The last edge of a node that has arrived says its level, even if one before it is still under
 * way. A node without such an edge has the level from before all edges under way. */
uint64_t cw_cable_seen_now(const cw_cable *cable, unsigned node, cw_span moment)
{
    uint64_t seen = cable->dominant;
    uint64_t arrived = 0;
    const unsigned count = kept(cable);
    for (unsigned n = 0; n < count; n++) {
        const cw_edge *e = nth_from_end(cable, n);
        const uint64_t self = UINT64_C(1) << e->node;
        if (e->moment + cable->longest < moment)
            break;
        if (arrived & self)
            continue;
        const bool here = cw_cable_arrival(cable, e, node) < moment;
        arrived |= here ? self : 0;
        const bool dominant = here == (e->level == CW_DOMINANT);
        seen = dominant ? seen | self : seen & ~self;
    }
    return seen;
}

cw_span cw_cable_next_arrival(const cw_cable *cable, unsigned node, cw_span moment, uint64_t from)
{
    cw_span first = CW_SPAN_MAX;
    const unsigned count = kept(cable);
    for (unsigned n = 0; n < count; n++) {
        const cw_edge *e = nth_from_end(cable, n);
        if (e->moment + cable->longest < moment)
            break;
        if (e->level != CW_DOMINANT || !(from >> e->node & 1u))
            continue;
        const cw_span arrival = cw_cable_arrival(cable, e, node);
        if (arrival >= moment && arrival < first)
            first = arrival;
    }
    return first;
}

cw_span cw_cable_change(const cw_cable *cable, unsigned node, bool level, cw_span after,
                        cw_span before, uint64_t from)
{
    cw_span found = CW_SPAN_MAX;
    const unsigned count = kept(cable);
    for (unsigned n = 0; n < count; n++) {
        const cw_edge *e = nth_from_end(cable, n);
        if (e->moment + cable->longest < after)
            break;
        if (e->level != level || !(from >> e->node & 1u))
            continue;
        const cw_span arrival = cw_cable_arrival(cable, e, node);
        const bool nearer = found == CW_SPAN_MAX || (arrival < found) == (level == CW_DOMINANT);
        if (arrival >= after && arrival < before && nearer)
            found = arrival;
    }
    return found;
}

void cw_cable_rebase(cw_cable *cable, cw_span by)
{
    cw_moment_rebase(&cable->newest, by);
    cw_moment_rebase(&cable->to_dominant, by);
    cw_moment_rebase(&cable->rise_from, by);
    for (unsigned n = 0; n < CW_WAYS_KEPT; n++)
        cw_moment_rebase(&cable->replaced[n], by);
    for (unsigned n = 0; n < kept(cable); n++)
        cw_moment_rebase(&cable->edges[(cable->count - 1 - n) & (cable->capacity - 1)].moment, by);
}
