/* SPDX-License-Identifier: MIT
 *
 * svg_layout.c - where things of a picture go: rows of bits, lanes of nodes, notes beside them.
 */
#include "svg_layout.h"

#include <stdlib.h>
#include <string.h>

#define NOTE_SHIFT 4 /* from the line of a note to its text */
#define NOTE_SPACE 8 /* between texts */

int svg_layout_x(const svg_layout *self, const svg_row *row, size_t bit)
{
    return SVG_MARGIN + SVG_LABELS + (int)(bit - row->first) * self->bit;
}

int svg_layout_faults(const svg_row *row)
{
    return (int)row->levels[NOTE_OF_BUS] * SVG_NOTE;
}

int svg_layout_wire(void)
{
    return SVG_WAVE + SVG_DIGITS + SVG_GAP;
}

int svg_layout_node(const svg_row *row, unsigned node)
{
    return SVG_BAND + 4 + SVG_WAVE + 2 + (int)row->levels[node] * SVG_NOTE + SVG_GAP;
}

/* ---- Rows ------------------------------------------------------------------------------------ */

/* As many as are needed, all of about the same length. */
static bool make_rows(svg_layout *self, const cw_bit_view *bits, size_t count)
{
    const size_t most = SVG_AREA / SVG_BIT_MIN;
    self->row_count = (count + most - 1) / most;
    self->rows = calloc(self->row_count, sizeof *self->rows);
    if (!self->rows)
        return false;
    size_t each = (count + self->row_count - 1) / self->row_count;
    self->bit = SVG_AREA / (int)each;
    if (self->bit > SVG_BIT_MAX)
        self->bit = SVG_BIT_MAX;
    for (size_t i = 0; i < self->row_count; i++) {
        svg_row *row = &self->rows[i];
        row->first = i * each;
        row->end = i + 1 < self->row_count ? row->first + each : count;
        for (size_t b = row->first; b < row->end; b++)
            row->wires = bits[b].wire_count > row->wires ? bits[b].wire_count : row->wires;
    }
    int area = (int)each * self->bit;
    self->width = 2 * SVG_MARGIN + SVG_LABELS + (area > SVG_AREA_MIN ? area : SVG_AREA_MIN);
    return true;
}

/* ---- Notes ----------------------------------------------------------------------------------- */

/* Left edges of what has its place in each level so far. */
typedef struct shelf {
    const placed_note *last;
    unsigned levels;
    int *left;
} shelf;

/* From right to left, each as near to the lane as it can be: so the line from a note to its bit
 * crosses no text to the right of it. */
static void place(placed_note *p, shelf *on, int right)
{
    int width = (int)strlen(p->note->text) * SVG_LETTER;
    p->text = p->x + NOTE_SHIFT;
    if (p->text + width > right)
        p->text = right - width;
    bool near = on->last && p->text + width + NOTE_SPACE > on->last->x;
    p->same =
        near && p->note->node == NOTE_OF_BUS && strcmp(p->note->text, on->last->note->text) == 0;
    if (p->same) {
        p->level = on->last->level;
    } else {
        while (p->level < on->levels && p->text + width + NOTE_SPACE > on->left[p->level])
            p->level++;
        if (p->level == on->levels)
            on->levels++;
        on->left[p->level] = p->text < p->x ? p->text : p->x;
    }
    on->last = p;
}

static void place_lane(svg_layout *self, svg_row *row, unsigned lane, int *left)
{
    const int right = self->width - SVG_MARGIN;
    shelf on = {.left = left};
    for (size_t i = self->note_count; i-- > 0;) {
        placed_note *p = &self->notes[i];
        size_t bit = note_bit(p->note);
        if (p->note->node != lane || bit < row->first || bit >= row->end)
            continue;
        int half = (int)(p->note->half - 2 * row->first);
        p->x = svg_layout_x(self, row, row->first) + half * self->bit / 2;
        place(p, &on, right);
    }
    row->levels[lane] = on.levels;
}

static bool place_notes(svg_layout *self, const note_list *notes, size_t count)
{
    self->notes = calloc(notes->count + 1, sizeof *self->notes);
    int *left = calloc(notes->count + 1, sizeof *left);
    bool good = self->notes && left;
    for (size_t i = 0; good && i < notes->count; i++)
        if (note_bit(&notes->list[i]) < count)
            self->notes[self->note_count++].note = &notes->list[i];
    for (size_t r = 0; good && r < self->row_count; r++)
        for (unsigned lane = 0; lane <= NOTE_OF_BUS; lane++)
            place_lane(self, &self->rows[r], lane, left);
    free(left);
    return good;
}

/* ---- All together ---------------------------------------------------------------------------- */

static void stack_rows(svg_layout *self, size_t node_count)
{
    int y = SVG_TITLE;
    for (size_t r = 0; r < self->row_count; r++) {
        svg_row *row = &self->rows[r];
        row->y = y;
        row->height = SVG_AXIS + svg_layout_faults(row) + (int)row->wires * svg_layout_wire();
        for (unsigned i = 0; i < node_count; i++)
            row->height += svg_layout_node(row, i);
        y += row->height + (r + 1 < self->row_count ? SVG_ROW_GAP : 0);
    }
    self->height = y + SVG_LEGEND;
}

bool svg_layout_make(svg_layout *self, const note_list *notes, const cw_bit_view *bits,
                     size_t count)
{
    *self = (svg_layout){.bit = 0};
    if (!make_rows(self, bits, count) || !place_notes(self, notes, count))
        return false;
    stack_rows(self, bits[0].node_count);
    return true;
}

void svg_layout_free(svg_layout *self)
{
    free(self->rows);
    free(self->notes);
    *self = (svg_layout){.bit = 0};
}
