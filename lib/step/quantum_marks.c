/* SPDX-License-Identifier: MIT
 *
 * quantum_marks.c - marks the moments at which nodes act and levels change, for traces.
 */
#include "step/quantum.h"

#include "mac/mac.h"

#include <assert.h>

__attribute__((noinline)) void cw_mark_put(cw_bus *bus, cw_mark_kind kind, unsigned i,
                                           cw_span moment, bool level, int phase_error)
{
    cw_timed *t = &bus->timed;
    const cw_mac *m = &bus->nodes[i].mac;
    const cw_place nowhere = {.field = CW_FIELD_NONE};
    const bool hidden = bus->listening >> i & 1u; /* nobody sees what it reads */
    const cw_span since = moment - cw_moment_of(bus, cw_now(bus));
    assert(t->mark_count < t->mark_room);
    if (t->mark_count == t->mark_room)
        return;
    t->marks[t->mark_count++] = (cw_mark){.at = since > 0 ? since : 0, .kind = kind,
                                          .quantum = t->nodes[i].timing.quantum,
                                          .phase_error = (int16_t)phase_error,
                                          .node = (uint8_t)i, .level = level,
                                          .phase = (uint8_t)cw_phase_of(bus, i),
                                          .place = hidden ? nowhere : cw_view_place(bus, m)};
}

void cw_mark_sample(cw_bus *bus, unsigned i, cw_span moment, bool level)
{
    cw_timed *t = &bus->timed;
    if (t->disturbances.count && cw_timed_wire(bus, i, moment) != level)
        t->faults.rx |= cw_node_bit(i);
    cw_mark_put(bus, CW_MARK_SAMPLE, i, moment, cw_mac_visible(&bus->nodes[i].mac, level), 0);
}

/* ---- Levels, from moment to moment ----------------------------------------------------------- */

void cw_marks_note(cw_bus *bus)
{
    bus->timed.noted_marks = bus->timed.mark_count;
    bus->timed.noted_dominant = bus->timed.cable.dominant;
}

/* The levels of a bit time, up to a moment. */
typedef struct level_walk {
    cw_levels levels;
    uint64_t dominant;
    unsigned next;  /* mark */
    unsigned count; /* of marks by the controllers */
    cw_span begin;
} level_walk;

/* Returns the next mark of a level that is driven, or NULL. */
static const cw_mark *next_drive(const cw_timed *t, level_walk *w)
{
    while (w->next < w->count && t->marks[w->next].kind != CW_MARK_DRIVE)
        w->next++;
    return w->next < w->count ? &t->marks[w->next] : NULL;
}

/* Returns the next moment at which a level may change: the controllers put another one onto a line,
 * or a rule begins or ends. */
static cw_span next_change(const cw_timed *t, level_walk *w, cw_span moment)
{
    const cw_mark *mark = next_drive(t, w);
    const cw_span rule = cw_disturb_next_change(&t->disturbances, moment);
    return mark && w->begin + mark->at < rule ? w->begin + mark->at : rule;
}

/* Goes on with the levels up to a moment. */
static void take_drives(const cw_timed *t, level_walk *w, cw_span moment)
{
    const cw_mark *m;
    for (; (m = next_drive(t, w)) && w->begin + m->at <= moment; w->next++)
        w->dominant = m->level ? w->dominant & ~cw_node_bit(m->node)
                               : w->dominant | cw_node_bit(m->node);
}

/* Marks the levels that have changed, and takes them for the present ones. */
static void mark_changes(cw_bus *bus, level_walk *w, const cw_levels *now, cw_span moment)
{
    const cw_wires *wires = &bus->timed.wires;
    for (uint64_t rest = (w->levels.driven ^ now->driven) & bus->all; rest; rest &= rest - 1) {
        const unsigned i = cw_lowest_node(rest);
        cw_mark_put(bus, CW_MARK_DRIVE, i, moment, now->driven >> i & 1u, 0);
    }
    for (unsigned n = 0; n < wires->count; n++) {
        const unsigned i = cw_lowest_node(wires->nodes[n]);
        if ((w->levels.wire ^ now->wire) >> i & 1u)
            cw_mark_put(bus, CW_MARK_WIRE, i, moment, now->wire >> i & 1u, 0);
    }
    bus->timed.faults.tx |= now->driven ^ ~w->dominant;
    bus->timed.faults.wire |= now->wire ^ now->clean;
    w->levels = *now;
}

/* Takes the levels of the controllers out, since those of their lines are marked, too. */
static void take_out_drives(cw_timed *t, unsigned count)
{
    unsigned kept = 0;
    for (unsigned n = 0; n < t->mark_count; n++)
        if (n >= count || t->marks[n].kind != CW_MARK_DRIVE)
            t->marks[kept++] = t->marks[n];
    t->mark_count = kept;
}

/* Returns true when a bit is the same for all nodes, and has one level. */
static bool is_common_bit(const cw_timed *t, cw_span begin, cw_span end)
{
    if (!t->together || cw_disturb_next_change(&t->disturbances, begin) < end)
        return false;
    for (unsigned n = t->noted_marks; n < t->mark_count; n++)
        if (t->marks[n].kind == CW_MARK_DRIVE || t->marks[n].kind == CW_MARK_BEGIN)
            return false;
    return true;
}

void cw_marks_end(cw_bus *bus, cw_span end)
{
    cw_timed *t = &bus->timed;
    level_walk w = {.levels = bus->note.levels, .dominant = t->noted_dominant,
                    .next = t->noted_marks, .count = t->mark_count,
                    .begin = cw_moment_of(bus, cw_now(bus))};
    cw_span moment = w.begin;
    if (is_common_bit(t, w.begin, end)) {
        t->mark_count = 0;
        return;
    }
    while ((moment = next_change(t, &w, moment)) < end) {
        cw_levels now = w.levels;
        take_drives(t, &w, moment);
        cw_timed_levels_at_source(bus, &now, w.dominant, moment);
        mark_changes(bus, &w, &now, moment);
    }
    take_out_drives(t, w.count);
}
