/* SPDX-License-Identifier: MIT
 *
 * jsonput.h - fills JSON objects and arrays, writes them.
 *
 * Half a report would be read as zeros, so running out of memory ends the program, with status 1.
 */
#ifndef CANWIRE_BASE_JSONPUT_H
#define CANWIRE_BASE_JSONPUT_H

#include <jansson.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

/*
 * To be called by main() first: running out of memory ends the program in jansson, too. By itself
 * it leaves out parts of texts, or crashes.
 */
void json_must_have_memory(void);

/* Takes the value. */
void put(json_t *object, const char *key, json_t *value);

/* Takes the value, as the last element of an array. */
void put_last(json_t *array, json_t *value);

/* Writes the value on lines of its own. Whether that could be written is known to the stream. */
void put_out(FILE *out, const json_t *value);

/* JSON integers are signed here; what does not fit saturates. */
void put_count(json_t *object, const char *key, uint64_t value);

/* In nanoseconds. A tick is 12.5 ns; half a nanosecond is truncated. Saturates after 292 years. */
void put_ticks(json_t *object, const char *key, uint64_t ticks);

void put_bool(json_t *object, const char *key, bool value);

/* null for NULL. */
void put_text(json_t *object, const char *key, const char *text);

/* As put_last(), with a text. */
void put_text_last(json_t *array, const char *text);

/* A string from any bytes; where they are no UTF-8, '?' stands for those that are not ASCII. */
json_t *text_to_json(const char *text, size_t length);

#endif
