/* SPDX-License-Identifier: MIT
 *
 * disturb.c - the list of what rules do to levels in time, and what a node sees of it.
 */
#include "rule/disturb.h"

#include "format/bitset.h"

#include <assert.h>
#include <string.h>

/* ---- The list -------------------------------------------------------------------------------- */

static void remove_at(cw_disturbances *all, unsigned place)
{
    all->count--;
    memmove(&all->list[place], &all->list[place + 1],
            (all->count - place) * sizeof all->list[0]);
}

/* Makes room: the one that has ended first can hardly matter now. */
static void remove_oldest(cw_disturbances *all)
{
    unsigned oldest = 0;
    for (unsigned i = 1; i < all->count; i++)
        if (all->list[i].end < all->list[oldest].end)
            oldest = i;
    remove_at(all, oldest);
}

void cw_disturb(cw_disturbances *all, const cw_disturbance *added)
{
    if (all->count == all->capacity)
        remove_oldest(all);
    unsigned place = all->count++;
    for (; place > 0 && all->list[place - 1].rule > added->rule; place--)
        all->list[place] = all->list[place - 1];
    all->list[place] = *added;
    all->list[place].ways = all->ways;
}

bool cw_disturbs_by(const cw_disturbances *all, uint16_t ways)
{
    for (unsigned i = 0; i < all->count; i++)
        if (all->list[i].ways == ways)
            return true;
    return false;
}

void cw_disturb_end(cw_disturbances *all, unsigned rule, cw_span moment)
{
    for (unsigned i = 0; i < all->count; i++)
        if (all->list[i].rule == rule && all->list[i].end == CW_SPAN_MAX)
            all->list[i].end = moment;
}

void cw_disturb_forget(cw_disturbances *all, cw_span moment)
{
    unsigned kept = 0;
    for (unsigned i = 0; i < all->count; i++)
        if (all->list[i].end >= moment)
            all->list[kept++] = all->list[i];
    all->count = kept;
}

void cw_disturb_rebase(cw_disturbances *all, cw_span by)
{
    for (unsigned i = 0; i < all->count; i++) {
        cw_moment_rebase(&all->list[i].begin, by);
        cw_moment_rebase(&all->list[i].end, by);
    }
}

/* ---- Levels ---------------------------------------------------------------------------------- */

/* Returns true when a node that looks at a moment sees the disturbance. It comes as late as an edge
 * of its source. */
static bool acts(const cw_disturbance *d, const cw_cable *cable, unsigned source, unsigned node,
                 cw_span moment)
{
    const bool level = d->effect != CW_DISTURB_DOMINANT;
    const cw_span late =
        source == CW_NO_NODE ? 0 : cw_cable_delay_then(cable, d->ways, source, node, level);
    return d->begin < moment - late && (d->end == CW_SPAN_MAX || moment - late <= d->end);
}

/* Returns the level that it makes of a level. */
static bool changed(const cw_disturbance *d, bool level)
{
    if (d->effect == CW_DISTURB_INVERT)
        return !level;
    return d->effect == CW_DISTURB_NOTHING ? level : d->effect == CW_DISTURB_RECESSIVE;
}

/* Does the same for the levels of some nodes, where they are made. */
static uint64_t changed_at_source(const cw_disturbance *d, cw_span moment, uint64_t nodes,
                                  uint64_t levels)
{
    if (moment < d->begin || moment >= d->end)
        return levels;
    if (d->effect == CW_DISTURB_INVERT)
        return levels ^ nodes;
    if (d->effect == CW_DISTURB_NOTHING)
        return levels;
    return d->effect == CW_DISTURB_RECESSIVE ? levels | nodes : levels & ~nodes;
}

uint64_t cw_disturbed_lines_at_source(const cw_disturbances *all, cw_span moment, uint64_t levels)
{
    for (unsigned i = 0; i < all->count; i++)
        levels = changed_at_source(&all->list[i], moment, all->list[i].lines, levels);
    return levels;
}

uint64_t cw_disturbed_wires_at_source(const cw_disturbances *all, cw_span moment, uint64_t levels)
{
    for (unsigned i = 0; i < all->count; i++)
        levels = changed_at_source(&all->list[i], moment, all->list[i].wires, levels);
    return levels;
}

cw_span cw_disturb_next_change(const cw_disturbances *all, cw_span moment)
{
    cw_span next = CW_SPAN_MAX;
    for (unsigned i = 0; i < all->count; i++) {
        const cw_disturbance *d = &all->list[i];
        if (d->begin > moment && d->begin < next)
            next = d->begin;
        if (d->end > moment && d->end < next)
            next = d->end;
    }
    return next;
}

uint64_t cw_disturbed_lines(const cw_disturbances *all, const cw_cable *cable, unsigned node,
                            cw_span moment, uint64_t seen)
{
    for (unsigned i = 0; i < all->count; i++) {
        const cw_disturbance *d = &all->list[i];
        for (uint64_t rest = d->lines; rest; rest &= rest - 1) {
            const uint64_t self = rest & (~rest + 1);
            const bool level = !(seen & self);
            if (acts(d, cable, cw_lowest_node(rest), node, moment))
                seen = changed(d, level) == CW_DOMINANT ? seen | self : seen & ~self;
        }
    }
    return seen;
}

bool cw_disturbed_wire(const cw_disturbances *all, const cw_cable *cable, unsigned node,
                       cw_span moment, uint64_t seen, uint64_t wire)
{
    bool level = !(cw_disturbed_lines(all, cable, node, moment, seen) & wire);
    for (unsigned i = 0; i < all->count; i++) {
        const cw_disturbance *d = &all->list[i];
        if ((d->wires >> node & 1u) && acts(d, cable, d->source, node, moment))
            level = changed(d, level);
    }
    return level;
}

bool cw_disturbed_sample(const cw_disturbances *all, const cw_cable *cable, unsigned node,
                         cw_span moment, bool level)
{
    for (unsigned i = 0; i < all->count; i++) {
        const cw_disturbance *d = &all->list[i];
        if ((d->samples >> node & 1u) && acts(d, cable, d->source, node, moment))
            level = changed(d, level);
    }
    return level;
}
