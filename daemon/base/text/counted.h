/* SPDX-License-Identifier: MIT
 *
 * counted.h - a number with its noun, "1 frame" or "2 frames".
 */
#ifndef CANWIRE_BASE_COUNTED_H
#define CANWIRE_BASE_COUNTED_H

#include <stdint.h>

#define COUNTED_BYTES 64

typedef struct counted_text {
    char text[COUNTED_BYTES];
} counted_text;

/* Returns the number and the noun, whose singular is given: "frame", "error frame", "bus",
 * "entry". */
counted_text counted(uint64_t count, const char *noun);

#endif
