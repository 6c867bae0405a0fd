/* SPDX-License-Identifier: MIT
 *
 * spans.h - where the fields of a frame stand, as tables.h has it.
 */
#ifndef CANWIRE_FORMAT_SPANS_H
#define CANWIRE_FORMAT_SPANS_H

#include <stdint.h>

/* The bits of a field. The identifier of an extended frame is in two parts: bits from index split
 * on are gap bits later. A field that the frame does not have is 0 bits long. */
typedef struct cw_field_span {
    uint8_t first;
    uint8_t bits;
    uint8_t split;
    uint8_t gap;
    uint8_t behind; /* the last part before it whose length differs between frames; 0 */
} cw_field_span;

#define CW_BEHIND_DATA 1
#define CW_BEHIND_STUFF_COUNT 2
#define CW_BEHIND_CRC 3

#endif
