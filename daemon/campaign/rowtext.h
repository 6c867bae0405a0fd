/* SPDX-License-Identifier: MIT
 *
 * rowtext.h - builds a line of JSON with keys in a fixed order, faster than jansson does.
 */
#ifndef CANWIRE_CAMPAIGN_ROWTEXT_H
#define CANWIRE_CAMPAIGN_ROWTEXT_H

#include "base/buffer.h"

#include <stdint.h>

/* A text that grows. All zeros is an empty one. */
typedef struct rowtext {
    buffer bytes;
    bool no_memory; /* parts are missing */
} rowtext;

/* Appends a text as it is. */
void rowtext_put(rowtext *row, const char *text);

/* Appends a text in quotes. */
void rowtext_quoted(rowtext *row, const char *text);

/* Append a comma where one is needed, then "key": and the value. */
void rowtext_number(rowtext *row, const char *key, uint64_t value);
void rowtext_string(rowtext *row, const char *key, const char *text);
void rowtext_seconds(rowtext *row, const char *key, uint64_t ticks);
void rowtext_key(rowtext *row, const char *key); /* ... without the value */

/* Ends a row with the command that repeats it. */
void rowtext_end(rowtext *row, rowtext *command);

/* Forgets the text. */
void rowtext_clear(rowtext *row);

void rowtext_free(rowtext *row);

#endif
