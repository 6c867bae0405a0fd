/* SPDX-License-Identifier: MIT
 *
 * svg_parts.h - colours and labels of the parts of a frame in a picture.
 */
#ifndef CANWIRE_CLI_SVG_SVG_PARTS_H
#define CANWIRE_CLI_SVG_SVG_PARTS_H

#include "record/bitpart.h"

#include <stddef.h>

#define SVG_LABEL_MAX 48 /* bytes with the final 0 */
#define SVG_LABELS_MAX 4

#define INK "#222222"
#define FAINT "#777777"
#define SAMPLED "#9a9a9a"
#define DRIVEN "#1c4f9c"
#define STATE "#6b2fa0"
#define FAULT "#b5127d"
#define DATA_RATE "#b58bd0"
#define ERROR_RED "#c8202c"

typedef struct svg_style {
    const char *fill;
    const char *ink;
    const char *labels[SVG_LABELS_MAX]; /* from long to short */
} svg_style;

const svg_style *svg_part_style(const bit_part *part);

/* Returns true when a node is in the same part in a bit as in the one before, bit > 0. */
bool svg_same_part(const cw_bit_view *bits, unsigned node, size_t bit);

/* Writes the longest label of at most that many letters, or an empty text, for the part that
 * contains bit `first` of `count`. Identifier, DLC, data, stuff count and CRC have the node's value
 * in hexadecimal, if the whole part is visible. The CRC of a CAN FD frame has none. */
void svg_label(char out[SVG_LABEL_MAX], const cw_bit_view *bits, size_t count, unsigned node,
               size_t first, int letters, bool with_value);

#endif
