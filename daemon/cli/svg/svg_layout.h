/* SPDX-License-Identifier: MIT
 *
 * svg_layout.h - the layout of a picture: rows of bits, lanes of nodes, notes beside them.
 */
#ifndef CANWIRE_CLI_SVG_SVG_LAYOUT_H
#define CANWIRE_CLI_SVG_SVG_LAYOUT_H

#include "cli/svg/svg_notes.h"

/* All sizes are in pixels. */
#define SVG_MARGIN 14
#define SVG_LABELS_MIN 98 /* names of lanes, left of the bits */
#define SVG_AREA 720      /* at most, for the bits of a row */
#define SVG_AREA_MIN 570  /* for title, legend and notes */
#define SVG_BIT_MIN 9
#define SVG_BIT_MAX 24
#define SVG_TITLE 30
#define SVG_AXIS 32
#define SVG_NOTE 13 /* a line of notes */
#define SVG_BAND 18 /* fields */
#define SVG_WAVE 16
#define SVG_DIGITS 11
#define SVG_INSIDE 17 /* quanta, sample points and synchronisations of a node */
#define SVG_LEGEND_LINE 14 /* a further line of the legend */
#define SVG_GAP 12 /* below a lane */
#define SVG_ROW_GAP 26
#define SVG_LEGEND 26
#define SVG_LETTER 6 /* average width of a letter of a note, at most */

/* Names of nodes, which can be long, use a font of fixed width. */
#define SVG_NAME_FONT " font-family=\"'DejaVu Sans Mono','Liberation Mono',Menlo,monospace\""
#define SVG_NAME_SIZE 11
#define SVG_NAME_SIZE_SMALL 9
#define SVG_NAME_PERMILLE 603 /* width of a letter, in permille of the font size */

/* A note with its place. Level 0 is nearest to the lane. */
typedef struct placed_note {
    const note *note;
    unsigned level;
    int x;       /* of the bit's end or middle */
    int text;    /* left edge of its text */
    int letters; /* that there is room for, or all */
    bool before; /* the text is left of x: it would exceed the picture otherwise */
    bool same;   /* the text equals that of a neighbour and is not repeated */
    int joined;  /* same: x of the neighbour */
} placed_note;

typedef struct svg_row {
    size_t first; /* bit, counted from the start of the picture */
    size_t end;
    unsigned wires;
    unsigned levels[CW_NODES_MAX + 1]; /* of notes, of each node and of the bus */
    int y;
    int height;
    int inside; /* height of what is shown inside bits, of each node */
} svg_row;

typedef struct svg_layout {
    const cw_bit_view *bits;
    size_t count;
    uint64_t shortest; /* ticks of the shortest bit; all others are to scale */
    int bit;    /* its width */
    int labels; /* width of the labels left of the bits */
    int width;
    int height;
    size_t row_count;
    svg_row *rows;
    size_t note_count;
    placed_note *notes; /* in the order of the list that they were made from, without invisible
                           ones */
} svg_layout;

/* Lays out `count` bits, which stay the caller's. inside: with room for what happens inside
 * them. rates: with room for what the legend says about the data rate. Returns false when there is
 * no memory. The layout must be freed in either case. */
bool svg_layout_make(svg_layout *self, const note_list *notes, const cw_bit_view *bits,
                     size_t count, bool inside, bool rates);

void svg_layout_free(svg_layout *self);

/* Returns the number of letters of a name that fit into a label in this size. */
int svg_layout_letters(const svg_layout *self, int size);

/* Returns the width of the text of a note. */
int svg_layout_text(const placed_note *n);

/* Returns the tick at which a bit begins; the end of the last one for the one behind it. */
uint64_t svg_layout_start(const svg_layout *self, size_t bit);

/* Return the left edge of a bit of a row, and its width. */
int svg_layout_x(const svg_layout *self, const svg_row *row, size_t bit);
int svg_layout_width(const svg_layout *self, const svg_row *row, size_t bit);

/* Return heights of a lane with its gap. */
int svg_layout_faults(const svg_row *row);
int svg_layout_wire(void);
int svg_layout_node(const svg_row *row, unsigned node);

#endif
