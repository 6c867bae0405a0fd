/* SPDX-License-Identifier: MIT
 *
 * nearest.h - finds the word that was probably intended.
 *
 *     nearest guess = {.word = "bitrat"};
 *     nearest_consider(&guess, "bitrate");      for each word that is allowed
 *     guess.best                                the nearest one, or NULL when none is near
 */
#ifndef CANWIRE_BASE_NEAREST_H
#define CANWIRE_BASE_NEAREST_H

typedef struct nearest {
    const char *word;
    const char *best;
    unsigned distance; /* edits from word to best; case does not count, '_' is '-' */
} nearest;

void nearest_consider(nearest *self, const char *candidate);

#endif
