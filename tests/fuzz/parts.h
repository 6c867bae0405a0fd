/* SPDX-License-Identifier: MIT
 *
 * parts.h - an input that is several texts: a line "=== HEAD" begins each but the first.
 */
#ifndef CANWIRE_FUZZ_PARTS_H
#define CANWIRE_FUZZ_PARTS_H

#include <stddef.h>
#include <stdint.h>

#define FUZZ_PARTS_MAX 24u
#define FUZZ_HEAD_MAX 40u /* bytes, with the final 0 */

typedef struct fuzz_part {
    char head[FUZZ_HEAD_MAX]; /* "" of the first */
    const char *text;         /* of the input */
    size_t size;
} fuzz_part;

/* Returns the number of parts, at least one; what is more than fits belongs to the last. */
size_t fuzz_split(fuzz_part parts[FUZZ_PARTS_MAX], const uint8_t *data, size_t size);

#endif
