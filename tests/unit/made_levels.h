/* SPDX-License-Identifier: MIT
 *
 * made_levels.h - the levels that a bus shows, from moment to moment, against those that nodes and
 * faults of quanta.h make.
 */
#ifndef CANWIRE_TEST_MADE_LEVELS_H
#define CANWIRE_TEST_MADE_LEVELS_H

#include "cases.h"
#include "quanta.h"

#include <inttypes.h>

#define LEVELS_MOST 200000u
#define PULSE_ROUNDING (CW_TICK >> 20) /* of the offset of a pulse in parts of a bit */

/* The levels of a bus as its bits and their marks show them. */
typedef struct made_levels {
    cw_span from; /* they hold after this moment */
    uint64_t driven;
    uint64_t wire;
} made_levels;

static struct {
    bool wanted;
    unsigned count;
    unsigned checked;
    unsigned changed_by_rules; /* wires that rules have changed, as checked */
    made_levels list[LEVELS_MOST];
} made;

static inline void note_levels(cw_span from, uint64_t driven, uint64_t wire)
{
    if (made.count > 0 && made.list[made.count - 1].from == from)
        made.count--;
    assert_true(made.count < LEVELS_MOST);
    made.list[made.count++] = (made_levels){from, driven, wire};
}

/* Returns the first mark of a level after a moment, or at it; some may be there. */
static inline const cw_mark *next_mark(const cw_bit_view *bit, cw_span moment)
{
    const cw_mark *next = NULL;
    for (unsigned i = 0; i < bit->mark_count; i++) {
        const cw_mark *m = &bit->marks[i];
        if ((m->kind == CW_MARK_DRIVE || m->kind == CW_MARK_WIRE) && m->at >= moment &&
            (!next || m->at < next->at))
            next = m;
    }
    return next;
}

static inline void take_marks_at(const cw_bit_view *bit, cw_span moment, uint64_t *driven,
                                 uint64_t *wire)
{
    for (unsigned i = 0; i < bit->mark_count; i++) {
        const cw_mark *m = &bit->marks[i];
        const uint64_t self = UINT64_C(1) << m->node;
        if (m->at != moment)
            continue;
        if (m->kind == CW_MARK_DRIVE)
            *driven = m->level ? *driven | self : *driven & ~self;
        else if (m->kind == CW_MARK_WIRE)
            *wire = m->level ? UINT64_MAX : 0;
    }
}

static inline void note_bit(const cw_bus *bus)
{
    cw_bit_view bit;
    assert_int_equal(cw_bus_get_bit(bus, &bit), CW_OK);
    const cw_span start = (cw_span)bit.start * CW_TICK;
    uint64_t driven = bit.driven, wire = bit.wire;
    note_levels(start, driven, wire);
    for (const cw_mark *m = next_mark(&bit, 0); m; m = next_mark(&bit, m->at + 1)) {
        take_marks_at(&bit, m->at, &driven, &wire);
        note_levels(start + m->at, driven, wire);
    }
}

/* Returns what a fault makes of a level right after a moment, where it is made. */
static inline bool faulty_at_source(const quanta_fault *f, int64_t moment, bool level)
{
    for (unsigned k = 0; k < f->count && k < QUANTA_SPANS; k++)
        if (f->spans[k].begin <= moment && moment < f->spans[k].end)
            level = f->inverts ? !level : f->level;
    return level;
}

/* Returns the level that a node puts onto the wire right after a moment. It is that of its last
 * edge, with what faults do to its line. */
static inline bool line_at_source(const quanta *all, unsigned i, int64_t moment)
{
    const quanta_node *n = &all->nodes[i];
    unsigned k = n->edges;
    while (k > 0 && n->edge_at[(k - 1) % QUANTA_EDGES] > moment)
        k--;
    bool level = k % 2 ? CW_DOMINANT : CW_RECESSIVE;
    for (unsigned f = 0; f < all->fault_count; f++)
        if (all->faults[f].lines >> i & 1u)
            level = faulty_at_source(&all->faults[f], moment, level);
    return level;
}

static inline void check_levels(const quanta *all, uint64_t seed, cw_span moment,
                                const made_levels *by)
{
    bool wire = CW_RECESSIVE;
    for (unsigned i = 0; i < all->node_count; i++) {
        const bool line = line_at_source(all, i, moment);
        if ((by->driven >> i & 1u) != line)
            fail_msg("seed %" PRIu64 ": node %u drives %d at %" PRId64 ", shown is another level",
                     seed, i, line, moment);
        wire = wire && line;
    }
    const bool calm = wire;
    for (unsigned f = 0; f < all->fault_count; f++)
        if (all->faults[f].wires)
            wire = faulty_at_source(&all->faults[f], moment, wire);
    if ((by->wire & 1u) != wire)
        fail_msg("seed %" PRIu64 ": the wire is %d at %" PRId64 ", shown is another level", seed,
                 wire, moment);
    made.changed_by_rules += wire != calm;
}

/* Checks all levels that hold up to a moment, which the quanta have come to. */
static inline void check_made(const quanta *all, uint64_t seed, cw_span until)
{
    for (; made.checked + 1 < made.count && made.list[made.checked + 1].from <= until;
         made.checked++) {
        const made_levels *now = &made.list[made.checked];
        const cw_span first = now->from + PULSE_ROUNDING, last = now[1].from - 1 - PULSE_ROUNDING;
        if (first > last)
            continue;
        check_levels(all, seed, first, now);
        check_levels(all, seed, last, now);
    }
}

#endif
