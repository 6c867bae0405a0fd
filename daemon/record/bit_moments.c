/* SPDX-License-Identifier: MIT
 *
 * bit_moments.c - what nodes with clocks of their own do in a bit time, in the order of time.
 */
#include "record/bit_moments.h"

#include <assert.h>

static bool phase_rests(cw_mac_phase phase)
{
    return phase == CW_MAC_IDLE || phase == CW_MAC_OFF || phase == CW_MAC_BUS_OFF ||
           phase == CW_MAC_RECOVERING || phase == CW_MAC_ASLEEP;
}

bool bit_rests(const cw_bit_view *bit)
{
    if ((bit->driven & bit->wire & bit->sampled) != UINT64_MAX)
        return false;
    for (unsigned i = 0; i < bit->node_count; i++)
        if (!phase_rests(bit->nodes[i].phase))
            return false;
    for (unsigned i = 0; i < bit->mark_count; i++)
        if (bit->marks[i].kind != CW_MARK_BEGIN && bit->marks[i].kind != CW_MARK_SAMPLE)
            return false;
    return true;
}

/* Marks come nearly in the order of time. */
static void sort_marks(bit_walk *w)
{
    const cw_mark *marks = w->bit->marks;
    for (unsigned i = 0; i < w->count; i++) {
        unsigned place = i;
        for (; place > 0 && marks[w->order[place - 1]].at > marks[i].at; place--)
            w->order[place] = w->order[place - 1];
        w->order[place] = (uint16_t)i;
    }
}

void bit_walk_begin(bit_walk *w, bit_clocks *clocks, const cw_bit_view *bit)
{
    w->bit = bit;
    w->clocks = clocks;
    w->length = (cw_span)(bit->end - bit->start) * CW_TICK;
    w->next = 0;
    w->count = bit->mark_count;
    assert(w->count <= BIT_MARKS_MAX);
    sort_marks(w);
}

/* Finds the next quantum that begins before a moment, or at it. */
static bool next_quantum(bit_walk *w, bit_moment *m, cw_span until)
{
    bit_clocks *c = w->clocks;
    m->mark = NULL;
    m->at = until;
    m->node = CW_NODES_MAX;
    for (unsigned i = 0; i < w->bit->node_count; i++)
        if (c->quantum[i] && c->next[i] < w->length && c->next[i] <= m->at &&
            (c->next[i] < m->at || m->node == CW_NODES_MAX)) {
            m->at = c->next[i];
            m->node = i;
        }
    if (m->node == CW_NODES_MAX)
        return false;
    c->next[m->node] += c->quantum[m->node];
    return true;
}

static void end_walk(bit_walk *w)
{
    for (unsigned i = 0; i < w->bit->node_count; i++)
        w->clocks->next[i] -= w->length;
}

/* A bit begins with a quantum: the next one comes a quantum later. */
static void take_mark(bit_clocks *c, const cw_mark *mark)
{
    if (mark->kind != CW_MARK_BEGIN)
        return;
    if (c->quantum[mark->node] == 0 || c->next[mark->node] <= mark->at)
        c->next[mark->node] = mark->at;
    if (c->quantum[mark->node] == mark->quantum)
        return;
    if (c->quantum[mark->node])
        c->next[mark->node] = mark->at + mark->quantum;
    c->quantum[mark->node] = mark->quantum;
}

bool bit_walk_next(bit_walk *w, bit_moment *m)
{
    const cw_mark *mark = w->next < w->count ? &w->bit->marks[w->order[w->next]] : NULL;
    if (next_quantum(w, m, mark ? mark->at : w->length))
        return true;
    if (!mark) {
        end_walk(w);
        return false;
    }
    take_mark(w->clocks, mark);
    w->next++;
    *m = (bit_moment){.at = mark->at, .node = mark->node, .mark = mark};
    return true;
}

uint64_t bit_moment_units(cw_span at, unsigned units_per_tick)
{
    const uint64_t whole = (uint64_t)(at / CW_TICK), part = (uint64_t)(at % CW_TICK);
    return whole * units_per_tick + part * units_per_tick / (uint64_t)CW_TICK;
}
