/* SPDX-License-Identifier: MIT
 *
 * svg.h - a picture of some bits of a bus, for reports: levels, fields, errors, faults.
 */
#ifndef CANWIRE_CLI_SVG_SVG_H
#define CANWIRE_CLI_SVG_SVG_H

#include "config/config.h"

#include <stdio.h>

#define SVG_BITS_MAX 2000 /* of one picture */

typedef struct svg svg;

/* Begins a picture of the later bits of a bus, between two bits. config must not change. Returns
 * NULL without memory. */
svg *svg_new(const cfg *config, const cw_bus *bus);

/* Takes each event, before the bit at whose end it came. Returns false without memory. */
bool svg_event(svg *self, const cw_event *event);

/* Takes each bit, in order. Bits beyond SVG_BITS_MAX are counted, not kept. Returns false without
 * memory. */
bool svg_bit(svg *self, const cw_bit_view *bit);

/* Takes note of a bit before the picture that came after svg_new(). */
void svg_skip(svg *self, const cw_bit_view *bit);

/* Returns the number of bits so far. */
size_t svg_count(const svg *self);

/* Draws the kept bits, at least one. The requested end is the tick `to`, CW_NEVER: the end of the
 * run; the caption reports an earlier end. Returns false without memory; otherwise the caller
 * checks ferror(out). */
bool svg_write(FILE *out, const svg *self, uint64_t to);

/* Frees the picture. NULL is allowed. */
void svg_free(svg *self);

#endif
