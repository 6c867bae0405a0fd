/* SPDX-License-Identifier: MIT
 *
 * shellword.h - writes a command line that a shell reads as it was.
 */
#ifndef CANWIRE_CAMPAIGN_SHELLWORD_H
#define CANWIRE_CAMPAIGN_SHELLWORD_H

#include "base/text/buffer.h"

/* Begins a command line in place of the text before: a command, and a file for it. */
void shellword_begin(buffer *line, const char *command, const char *file);

/* Appends a word, in quotes where it needs them. */
void shellword_put(buffer *line, const char *word);

/* Takes the next word off a command line that these functions have written. Returns false at its
 * end, and for another line. */
bool shellword_take(buffer *word, const char **line);

#endif
