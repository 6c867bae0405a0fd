/* SPDX-License-Identifier: MIT
 *
 * valuepath.h - the path of a value in a configuration: nodes.engine.traffic[0].every.
 *
 * Its parts are keys, or names of items in lists, with points between, and numbers of items in
 * brackets.
 */
#ifndef CANWIRE_CAMPAIGN_VALUEPATH_H
#define CANWIRE_CAMPAIGN_VALUEPATH_H

#include "base/arena.h"

#include <stdbool.h>

#define VALUEPATH_PART_MAX 128 /* bytes of a part with its final 0 */

/* A part of a path: `key`, or `3` of `[3]`. */
typedef struct valuepath_part {
    char text[VALUEPATH_PART_MAX];
    bool number;
    bool last;
} valuepath_part;

/* Returns NULL for a path, otherwise what is wrong with it and where, in memory of an arena. */
const char *valuepath_check(arena *memory, const char *path);

/* Takes the next part off what is left of a good path. */
void valuepath_take(const char **rest, valuepath_part *p);

#endif
