/* SPDX-License-Identifier: MIT
 *
 * shellword.h - writes a command line that a shell reads as it was.
 */
#ifndef CANWIRE_CAMPAIGN_SHELLWORD_H
#define CANWIRE_CAMPAIGN_SHELLWORD_H

#include "campaign/rowtext.h"

/* Appends a word, in quotes where it needs them. */
void shellword_put(rowtext *line, const char *word);

#endif
