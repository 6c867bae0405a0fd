/* SPDX-License-Identifier: MIT
 *
 * memory.h - memory of a report. Half a report would be wrong, so a lack of it ends the program.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_MEMORY_H
#define CANWIRE_CAMPAIGN_REPORT_MEMORY_H

#include "base/text/buffer.h"
#include "base/text/jsonread.h"

/* Makes room for `count` items in a list, or in a new one (NULL). Returns it; the caller frees it.
 * New items are not set. */
void *memory_list(void *list, size_t count, size_t item_bytes);

/* Doubles the room of a list when `count` items fill it. */
void *memory_grow(void *list, size_t *room, size_t count, size_t item_bytes);

/* Returns a copy of a text, to be freed. */
char *memory_text(const char *text);

/* Returns the text of a buffer, as long as that stays as it is. */
const char *memory_seen(buffer *b);

/* Returns the text of a buffer, which is empty then; to be freed. */
char *memory_of_buffer(buffer *b);

/* Reads a JSON text, see jsonread_text(). */
const jsonread_value *memory_json(jsonread *r, jsonread_problem *problem, const char *text,
                                  size_t length);

/* Returns a formatted text, to be freed. */
char *memory_print(const char *format, ...) __attribute__((format(printf, 1, 2)));

#endif
