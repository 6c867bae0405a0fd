/* SPDX-License-Identifier: MIT
 *
 * svg_inside.c - what nodes with clocks of their own do inside the bits of a picture.
 */
#include "cli/svg/svg_inside.h"

#include "cli/svg/svg_parts.h"

#include <stdlib.h>
#include <string.h>

#define MOMENTS_FIRST 4096
#define PARTS_OF_TICK 1000u
#define LEAST_WIDTH 150 /* of a quantum that is seen, in hundredths of a pixel */

/* Moments come in the order of bits, by which inside_before() finds them. False without memory. */
static bool svg_inside_add(inside_list *self, inside_moment moment)
{
    if (self->count == self->capacity) {
        const size_t capacity = self->capacity ? 2 * self->capacity : MOMENTS_FIRST;
        inside_moment *list = realloc(self->list, capacity * sizeof *list);
        if (!list)
            return false;
        self->list = list;
        self->capacity = capacity;
    }
    self->list[self->count++] = moment;
    return true;
}

static bool is_shown(const bit_moment *m)
{
    return !m->mark || m->mark->kind != CW_MARK_BEGIN;
}

/* A moment without a mark begins a time quantum. */
static inside_kind kind_of(const bit_moment *m)
{
    static const inside_kind kinds[] = {
        [CW_MARK_BEGIN] = INSIDE_QUANTUM,   [CW_MARK_DRIVE] = INSIDE_DRIVE,
        [CW_MARK_WIRE] = INSIDE_WIRE,       [CW_MARK_SAMPLE] = INSIDE_SAMPLE,
        [CW_MARK_LATE_SAMPLE] = INSIDE_LATE_SAMPLE,
        [CW_MARK_HARD_SYNC] = INSIDE_HARD_SYNC, [CW_MARK_RESYNC] = INSIDE_RESYNC,
    };
    return m->mark ? kinds[m->mark->kind] : INSIDE_QUANTUM;
}

bool inside_bit(inside_list *self, const cw_bit_view *bit, size_t number)
{
    if (bit_rests(bit)) {
        memset(&self->clocks, 0, sizeof self->clocks);
        return true;
    }
    const uint64_t parts = (bit->end - bit->start) * PARTS_OF_TICK;
    bit_moment m;
    bool good = true;
    bit_walk_begin(&self->walk, &self->clocks, bit);
    while (bit_walk_next(&self->walk, &m))
        if (good && is_shown(&m))
            good = svg_inside_add(
                self, (inside_moment){.bit = (uint16_t)number,
                                      .place = (uint16_t)(bit_moment_units(m.at, PARTS_OF_TICK) *
                                                          SVG_PLACES / parts),
                                      .phase_error = (int16_t)(m.mark ? m.mark->phase_error : 0),
                                      .node = (uint8_t)m.node,
                                      .kind = (uint8_t)kind_of(&m),
                                      .level = m.mark && m.mark->level});
    return good;
}

size_t inside_before(const inside_list *self, size_t bit)
{
    size_t low = 0, high = self->count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (self->list[middle].bit < bit)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

void inside_draw(FILE *out, const inside_moment *m, int x, int y, int width, int *last)
{
    const unsigned at = (unsigned)x * 100 + m->place * (unsigned)width * 100 / SVG_PLACES;
    const unsigned whole = at / 100, part = at % 100;
    if (m->kind == INSIDE_QUANTUM && (int)at < *last + LEAST_WIDTH)
        return;
    if (m->kind == INSIDE_QUANTUM)
        *last = (int)at;
    switch ((inside_kind)m->kind) {
    case INSIDE_QUANTUM:
        fprintf(out, "<path class=\"tq\" d=\"M%u.%02u %dv3\" stroke=\"" SAMPLED
                     "\" stroke-width=\".4\"/>\n", whole, part, y);
        break;
    case INSIDE_DRIVE:
    case INSIDE_WIRE:
        break;
    case INSIDE_LATE_SAMPLE:
        fprintf(out, "<path class=\"late-sample\" d=\"M%u.%02u %dv8\" stroke=\"" DRIVEN
                     "\" stroke-width=\"1.6\" stroke-dasharray=\"2 1\"/>\n", whole, part, y);
        break;
    case INSIDE_SAMPLE:
        fprintf(out, "<path class=\"sample\" d=\"M%u.%02u %dv6\" stroke=\"" DRIVEN "\"/>\n", whole,
                part, y);
        break;
    case INSIDE_HARD_SYNC:
    case INSIDE_RESYNC:
        fprintf(out, "<path class=\"%s\" d=\"M%u.%02u %dv8\" stroke=\"" STATE "\"/>\n",
                m->kind == INSIDE_RESYNC ? "resync" : "hard", whole, part, y);
        fprintf(out, "<text class=\"phase-error\" x=\"%u.%02u\" y=\"%d\" font-size=\"7\" fill=\""
                     STATE "\" text-anchor=\"middle\">%d</text>\n", whole, part, y + 14,
                m->phase_error);
        break;
    }
}

void inside_free(inside_list *self)
{
    if (self)
        free(self->list);
    free(self);
}
