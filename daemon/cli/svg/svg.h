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

/* Begins a picture of the bits that are still to come on a bus, between two bits. config must stay
 * as it is. NULL when there is no memory. */
svg *svg_new(const cfg *config, const cw_bus *bus);

/* Each event, before the bit at whose end it came. False when there is no memory. */
bool svg_event(svg *self, const cw_event *event);

/* Each bit, in order. Those beyond SVG_BITS_MAX are counted, not kept. False when there is no
 * memory. */
bool svg_bit(svg *self, const cw_bit_view *bit);

/* Bits taken so far. */
size_t svg_count(const svg *self);

/* Draws what was kept, at least one bit. It was to go up to the tick `to`, CW_NEVER: to the end;
 * the caption tells when it does not. False when there is no memory; else the caller looks at
 * ferror(out). */
bool svg_write(FILE *out, const svg *self, uint64_t to);

/* NULL is fine. */
void svg_free(svg *self);

#endif
