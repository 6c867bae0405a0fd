/* SPDX-License-Identifier: MIT
 *
 * jsonput.h - fills JSON objects and arrays, writes them, and reads their members.
 *
 * Half a report would be read as zeros, so running out of memory ends the program, with status 1.
 * In libcanwire-sim the report is thrown away instead.
 */
#ifndef CANWIRE_BASE_JSONPUT_H
#define CANWIRE_BASE_JSONPUT_H

#include <jansson.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

/* Handles a lack of memory. Programs have that of base/jsonexit.c, which ends them; a library
 * brings its own, which returns. */
void json_no_memory(void);

/* Ends the program when jansson runs out of memory, too: by itself jansson drops parts of texts or
 * crashes. main() calls it first.
 */
void json_must_have_memory(void);

/* Puts a value into an object and takes it over. */
void put(json_t *object, const char *key, json_t *value);

/* Appends a value to an array and takes it over. */
void put_last(json_t *array, json_t *value);

/* Writes the value on lines of its own. The stream keeps the error of a failed write. */
void put_out(FILE *out, const json_t *value);

/* Puts a count. JSON integers are signed here; larger values saturate. */
void put_count(json_t *object, const char *key, uint64_t value);

/* Puts a time in nanoseconds. A tick is 12.5 ns; half a nanosecond is truncated. Saturates after
 * 292 years. */
void put_ticks(json_t *object, const char *key, uint64_t ticks);

void put_bool(json_t *object, const char *key, bool value);

/* Puts a text, or null for NULL. */
void put_text(json_t *object, const char *key, const char *text);

/* Appends a text. */
void put_text_last(json_t *array, const char *text);

/* Returns true for one of an array of texts. */
bool json_has_text(const json_t *array, const char *text);

/* Returns a text of an object; NULL when there is none. */
const char *get_text(const json_t *object, const char *key);

/* Returns a text of an object; "" when there is none. */
const char *get_any_text(const json_t *object, const char *key);

/* Returns an integer of an object; 0 when there is none. */
intmax_t get_number(const json_t *object, const char *key);

/* Returns an integer of an object; 0 for one below 0, and when there is none. */
uint64_t get_count(const json_t *object, const char *key);

/* Makes a string from any bytes; '?' replaces non-ASCII bytes that are not UTF-8. */
json_t *text_to_json(const char *text, size_t length);

#endif
