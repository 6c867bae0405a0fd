/* SPDX-License-Identifier: MIT
 *
 * type.h - what JSON schema says of the values of a configuration.
 *
 * A type is a text of JSON that is easy to write in C. An apostrophe in it stands for the quote of
 * JSON. Two apostrophes stand for one, and a backslash for two. The map that a key has (schema_key)
 * takes the place of @. TYPE_REF is a type of this file, and so is a word alone.
 */
#ifndef CANWIRE_SCHEMA_TYPE_H
#define CANWIRE_SCHEMA_TYPE_H


#include "base/schema.h"

#include <jansson.h>

/* Returns the text of a named type, or NULL. */
const char *type_text(const char *name);

/* Returns the words of a named type, which is then one of them; or NULL. */
json_t *type_words(const char *name);

/* Returns the name of the type that a reader reads, or NULL. */
const char *type_of_reader(schema_reader *read);

/* Returns what a text says, with the JSON of a map in place of @. */
json_t *type_parse(const char *text, const json_t *map);

#endif
