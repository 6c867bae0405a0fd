/* SPDX-License-Identifier: MIT
 *
 * svg_inside.h - what nodes with clocks of their own do inside the bits of a picture.
 */
#ifndef CANWIRE_CLI_SVG_SVG_INSIDE_H
#define CANWIRE_CLI_SVG_SVG_INSIDE_H

#include "record/bit_moments.h"

#include <stddef.h>
#include <stdio.h>

#define SVG_PLACES 10000u /* of moments in a bit time */

typedef enum inside_kind {
    INSIDE_QUANTUM = 0,
    INSIDE_SAMPLE,
    INSIDE_LATE_SAMPLE, /* at the secondary sample point */
    INSIDE_DRIVE,       /* drawn by the lanes of levels, as that of samples is, too */
    INSIDE_WIRE,
    INSIDE_HARD_SYNC,
    INSIDE_RESYNC,
} inside_kind;

typedef struct inside_moment {
    uint16_t bit; /* from the start of the picture */
    uint16_t place;
    int16_t phase_error; /* in quanta */
    uint8_t node;
    uint8_t kind;
    bool level; /* from then on, or as it is sampled */
} inside_moment;

/* The moments of all nodes, in the order of time. */
typedef struct inside_list {
    inside_moment *list;
    size_t count;
    size_t capacity;
    bit_clocks clocks;
    bit_walk walk;
} inside_list;

/* Takes each bit, in order. Returns false without memory. */
bool inside_bit(inside_list *self, const cw_bit_view *bit, size_t number);

/* Returns the number of moments before a bit. */
size_t inside_before(const inside_list *self, size_t bit);

/* Draws a moment at the left edge of its bit, x, and the top of its lane, y. Quanta too close to
 * the one drawn last, whose place is *last, are left out. It begins at INSIDE_NONE. */
#define INSIDE_NONE (-1000)
void inside_draw(FILE *out, const inside_moment *moment, int x, int y, int width, int *last);

void inside_free(inside_list *self);

#endif
