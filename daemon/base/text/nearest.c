/* SPDX-License-Identifier: MIT
 *
 * nearest.c - finds the word that was probably intended.
 */
#include "base/text/nearest.h"

#include <ctype.h>
#include <stddef.h>
#include <string.h>

#define LENGTH_MAX 32u  /* longer words are never suggested */
#define DISTANCE_MAX 2u /* edits that still make a suggestion */

static unsigned edit_distance(const char *a, const char *b);

/* Keeps the candidate if it is nearer than those before; the first of equal ones stays. */
void nearest_consider(nearest *self, const char *candidate)
{
    size_t length = strlen(candidate);

    if (length > LENGTH_MAX || strlen(self->word) > LENGTH_MAX)
        return;
    unsigned distance = edit_distance(self->word, candidate);
    /* Two edits turn a two-letter word into any other. */
    if (distance > DISTANCE_MAX || distance >= length || (self->best && distance >= self->distance))
        return;
    self->best = candidate;
    self->distance = distance;
}

static int folded(char c)
{
    return c == '_' ? '-' : tolower((unsigned char)c);
}

static unsigned least(unsigned a, unsigned b)
{
    return a < b ? a : b;
}

/* Returns the insertions, deletions and replacements that turn a into b, with one row of
 * Levenshtein's table. */
static unsigned edit_distance(const char *a, const char *b)
{
    unsigned row[LENGTH_MAX + 1];
    size_t length = strlen(b);

    for (unsigned j = 0; j <= length; j++)
        row[j] = j;
    for (; *a; a++) {
        unsigned diagonal = row[0]++;

        for (size_t j = 1; j <= length; j++) {
            unsigned replaced = diagonal + (folded(*a) != folded(b[j - 1]));
            diagonal = row[j];
            row[j] = least(replaced, least(row[j], row[j - 1]) + 1);
        }
    }
    return row[length];
}
