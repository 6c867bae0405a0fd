/* SPDX-License-Identifier: MIT
 *
 * svg_layout.c - the layout of a picture: rows of bits, lanes of nodes, notes beside them.
 */
#include "cli/svg/svg_layout.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>

#define NOTE_SHIFT 4 /* from the line of a note to its text */
#define NOTE_SPACE 8 /* between texts */
#define NAME_SPACE 10 /* between a name and the bits */

uint64_t svg_layout_start(const svg_layout *self, size_t bit)
{
    return bit < self->count ? self->bits[bit].start : self->bits[self->count - 1].end;
}

int svg_layout_x(const svg_layout *self, const svg_row *row, size_t bit)
{
    const uint64_t ticks = svg_layout_start(self, bit) - svg_layout_start(self, row->first);
    return SVG_MARGIN + self->labels + (int)(ticks * (unsigned)self->bit / self->shortest);
}

int svg_layout_width(const svg_layout *self, const svg_row *row, size_t bit)
{
    return svg_layout_x(self, row, bit + 1) - svg_layout_x(self, row, bit);
}

int svg_layout_letters(const svg_layout *self, int size)
{
    return (self->labels - NAME_SPACE) * 1000 / (size * SVG_NAME_PERMILLE);
}

int svg_layout_text(const placed_note *n)
{
    return n->letters * SVG_LETTER;
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
    return SVG_BAND + 4 + SVG_WAVE + 2 + row->inside +
           (int)row->levels[node] * SVG_NOTE + SVG_GAP;
}

/* ---- Rows ------------------------------------------------------------------------------------ */

/* Returns the width of the longest name. */
static int find_labels(const cfg *config)
{
    int width = SVG_LABELS_MIN;
    for (size_t i = 0; i < config->node_count; i++) {
        int letters = (int)strlen(config->nodes[i].name);
        int needed = (letters * SVG_NAME_SIZE * SVG_NAME_PERMILLE + 999) / 1000 + NAME_SPACE;
        width = needed > width ? needed : width;
    }
    return width;
}

/* Returns the shortest bit, which sets the scale: bits at the data rate must stay readable. */
static uint64_t shortest_bit(const cw_bit_view *bits, size_t count)
{
    uint64_t ticks = bits[0].end - bits[0].start;
    for (size_t b = 1; b < count; b++)
        if (bits[b].end - bits[b].start < ticks)
            ticks = bits[b].end - bits[b].start;
    return ticks;
}

/* Begins a row with the bits that fit into so many ticks, at least one. */
static void make_row(svg_layout *self, size_t first, uint64_t ticks)
{
    svg_row *row = &self->rows[self->row_count++];
    const uint64_t start = self->bits[first].start;
    row->first = row->end = first;
    do {
        const unsigned wires = self->bits[row->end++].wire_count;
        row->wires = wires > row->wires ? wires : row->wires;
    } while (row->end < self->count && self->bits[row->end].end - start <= ticks);
}

/* Rows need not be of one length: their bits are not cut. The picture has the width of the
 * widest. */
static int widest_row(const svg_layout *self)
{
    int width = 0;
    for (size_t r = 0; r < self->row_count; r++) {
        const svg_row *row = &self->rows[r];
        const int area = svg_layout_x(self, row, row->end) - svg_layout_x(self, row, row->first);
        width = area > width ? area : width;
    }
    return width;
}

/* Makes as many rows as needed, all of about the same length. */
static bool make_rows(svg_layout *self)
{
    const uint64_t most = SVG_AREA / SVG_BIT_MIN; /* of the shortest bits in a row */
    const uint64_t ticks = self->bits[self->count - 1].end - self->bits[0].start;
    const uint64_t lengths = (ticks + self->shortest - 1) / self->shortest;
    const uint64_t rows = (lengths + most - 1) / most;
    const uint64_t each = (lengths + rows - 1) / rows;
    self->rows = calloc(self->count, sizeof *self->rows);
    if (!self->rows)
        return false;
    self->bit = SVG_AREA / (int)each;
    if (self->bit > SVG_BIT_MAX)
        self->bit = SVG_BIT_MAX;
    for (size_t b = 0; b < self->count; b = self->rows[self->row_count - 1].end)
        make_row(self, b, each * self->shortest);
    int area = widest_row(self);
    self->width = 2 * SVG_MARGIN + self->labels + (area > SVG_AREA_MIN ? area : SVG_AREA_MIN);
    return true;
}

/* ---- Notes ----------------------------------------------------------------------------------- */

/* The notes of a lane in a row, from left to right. */
typedef struct shelf {
    placed_note **notes;
    size_t count;
    int *left; /* left edge of the placed notes of each level */
    unsigned levels;
} shelf;

static int text_end(const placed_note *n)
{
    int end = n->text + svg_layout_text(n);
    return n->same || end < n->x ? n->x : end;
}

/* Takes the notes of a node in a row, with the places at which they point. */
static void take_lane(shelf *on, svg_layout *self, const svg_row *row, unsigned lane)
{
    on->count = 0;
    on->levels = 0;
    for (size_t i = 0; i < self->note_count; i++) {
        placed_note *n = &self->notes[i];
        size_t bit = note_bit(n->note);
        if (n->note->node != lane || bit < row->first || bit >= row->end)
            continue;
        const size_t half = n->note->half;
        n->x = svg_layout_x(self, row, half / 2);
        n->x += half % 2 ? svg_layout_width(self, row, half / 2) / 2 : 0;
        n->letters = (int)strlen(n->note->text);
        on->notes[on->count++] = n;
    }
}

static void cut_to(placed_note *n, int room)
{
    if (svg_layout_text(n) > room)
        n->letters = room / SVG_LETTER;
}

/* Chooses the side of its line for each text. Texts of the last notes are on the left when they
 * would exceed the picture or be in the way of such a line. Returns the first of these notes. */
static size_t choose_sides(const shelf *on, int left, int right)
{
    int limit = right;
    size_t first = on->count;
    for (size_t i = on->count; i-- > 0;) {
        const placed_note *n = on->notes[i];
        bool fits = n->x + NOTE_SHIFT + svg_layout_text(n) <= limit;
        if (fits || n->x - left < limit - n->x)
            continue;
        limit = n->x;
        first = i;
    }
    for (size_t i = 0; i < on->count; i++) {
        placed_note *n = on->notes[i];
        n->before = i >= first;
        cut_to(n, n->before ? n->x - NOTE_SHIFT - left : limit - n->x - NOTE_SHIFT);
        n->text = n->before ? n->x - NOTE_SHIFT - svg_layout_text(n) : n->x + NOTE_SHIFT;
    }
    return first;
}

static bool svg_layout_is_same(const placed_note *a, const placed_note *b)
{
    return a->note->node == NOTE_OF_BUS && strcmp(a->note->text, b->note->text) == 0;
}

static void svg_layout_join(placed_note *n, const placed_note *neighbour)
{
    n->same = true;
    n->level = neighbour->level;
    n->joined = neighbour->x;
}

/* Returns the left edge of all notes in a level, or with lines through it to one behind. */
static int left_of(const shelf *on, unsigned level)
{
    int left = INT_MAX;
    for (; level < on->levels; level++)
        left = on->left[level] < left ? on->left[level] : left;
    return left;
}

/* Places notes from right to left, each as near to the lane as possible. So the line from a note to
 * its bit crosses no text. */
static void place_behind(shelf *on, size_t end)
{
    for (size_t i = end; i-- > 0;) {
        placed_note *n = on->notes[i];
        const placed_note *next = i + 1 < end ? on->notes[i + 1] : NULL;
        int edge = text_end(n) + NOTE_SPACE;
        if (next && edge > next->x && svg_layout_is_same(n, next))
            svg_layout_join(n, next);
        else
            while (edge > left_of(on, n->level))
                n->level++;
        on->levels = n->level == on->levels ? on->levels + 1 : on->levels;
        on->left[n->level] = n->x;
    }
}

/* Places notes from left to right, each behind all notes that it or its line would touch. */
static void place_before(shelf *on, size_t first)
{
    for (size_t i = first; i < on->count; i++) {
        placed_note *n = on->notes[i];
        const placed_note *last = i > first ? on->notes[i - 1] : NULL;
        if (last && n->text < last->x + NOTE_SPACE && svg_layout_is_same(n, last)) {
            svg_layout_join(n, last);
            continue;
        }
        for (size_t k = 0; k < i; k++)
            if (text_end(on->notes[k]) + NOTE_SPACE > n->text && on->notes[k]->level >= n->level)
                n->level = on->notes[k]->level + 1;
        on->levels = n->level >= on->levels ? n->level + 1 : on->levels;
    }
}

/* Places the notes of a node in a row: some before their point, some behind, on as many lines as
 * they need. */
static void place_lane(svg_layout *self, svg_row *row, unsigned lane, shelf *on)
{
    take_lane(on, self, row, lane);
    size_t first = choose_sides(on, SVG_MARGIN + self->labels, self->width - SVG_MARGIN);
    place_behind(on, first);
    place_before(on, first);
    row->levels[lane] = on->levels;
}

/* Places all notes. The memory for a lane is used for each in turn. False without memory. */
static bool place_notes(svg_layout *self, const note_list *notes, size_t count)
{
    self->notes = calloc(notes->count + 1, sizeof *self->notes);
    shelf on = {.count = 0};
    on.notes = calloc(notes->count + 1, sizeof *on.notes);
    on.left = calloc(notes->count + 1, sizeof *on.left);
    bool good = self->notes && on.notes && on.left;
    for (size_t i = 0; good && i < notes->count; i++)
        if (note_bit(&notes->list[i]) < count)
            self->notes[self->note_count++].note = &notes->list[i];
    for (size_t r = 0; good && r < self->row_count; r++)
        for (unsigned lane = 0; lane <= NOTE_OF_BUS; lane++)
            place_lane(self, &self->rows[r], lane, &on);
    free(on.notes);
    free(on.left);
    return good;
}

/* ---- The whole layout ------------------------------------------------------------------------ */

/* Puts the rows below each other; the height of each depends on its notes. */
static void stack_rows(svg_layout *self, size_t node_count, bool inside, bool rates)
{
    int y = SVG_TITLE;
    for (size_t r = 0; r < self->row_count; r++) {
        svg_row *row = &self->rows[r];
        row->y = y;
        row->inside = inside ? SVG_INSIDE : 0;
        row->height = SVG_AXIS + svg_layout_faults(row) + (int)row->wires * svg_layout_wire();
        for (unsigned i = 0; i < node_count; i++)
            row->height += svg_layout_node(row, i);
        y += row->height + (r + 1 < self->row_count ? SVG_ROW_GAP : 0);
    }
    self->height = y + SVG_LEGEND + (inside + rates) * SVG_LEGEND_LINE;
}

bool svg_layout_make(svg_layout *self, const note_list *notes, const cw_bit_view *bits,
                     size_t count, bool inside, bool rates)
{
    *self = (svg_layout){.labels = find_labels(notes->config),
                         .bits = bits,
                         .count = count,
                         .shortest = shortest_bit(bits, count)};
    if (!make_rows(self) || !place_notes(self, notes, count))
        return false;
    stack_rows(self, bits[0].node_count, inside, rates);
    return true;
}

void svg_layout_free(svg_layout *self)
{
    free(self->rows);
    free(self->notes);
    *self = (svg_layout){.bit = 0};
}
