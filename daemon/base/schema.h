/* SPDX-License-Identifier: MIT
 *
 * schema.h - walks a YAML document by tables of keys, into plain structs.
 *
 * A map is described by a table of schema_key; each key has a reader that turns its value into a
 * member of the struct that stands for the map. Readers complain and go on, so one walk finds all
 * errors. The depth of a walk is that of the tables: aliases that form a cycle end as an error.
 */
#ifndef CANWIRE_BASE_SCHEMA_H
#define CANWIRE_BASE_SCHEMA_H

#include "base/arena.h"
#include "base/diag.h"
#include "base/nearest.h"

#include <stdint.h>
#include <yaml.h>

#define SCHEMA_KEYS_MAX 64 /* of one map */
#define SCHEMA_OPEN '\x02' /* begins a text whose value is not known yet */

typedef struct schema {
    diag *errors;
    arena *arena; /* owns the strings and arrays that are read */
    yaml_document_t *document;
    void *user;    /* for the readers */
    bool has_open; /* texts that begin with SCHEMA_OPEN are taken for anything */
} schema;

typedef struct schema_key schema_key;

/* Turns the value into its member of *object, or complains. */
typedef void schema_reader(schema *self, const schema_key *key, yaml_node_t *value, void *object);

struct schema_key {
    const char *name;    /* NULL ends a table */
    schema_reader *read; /* NULL: the key is refused because it comes later */
    size_t offset;       /* of the member in the struct */
    const void *arg;     /* what the reader wants to know, see there */
    bool required;
};

/* What schema_read_uint() takes. */
typedef struct schema_range {
    uint64_t min;
    uint64_t max;
    size_t bytes; /* of the member: 1, 2, 4 or 8 */
} schema_range;

/* One of the words that schema_choose() takes; a table ends with name NULL. */
typedef struct schema_choice {
    const char *name;
    unsigned value;
} schema_choice;

/* Walks a map. Complains about what is no map, and about unknown, duplicate and missing keys;
 * calls the readers in the order of the table. `what` names the map in messages. Once there are
 * more errors than are shown, nothing more is read. */
void schema_map(schema *self, const char *what, yaml_node_t *map, const schema_key *keys,
                void *object);

/* The member of an object that a key stands for. */
void *schema_member(const schema_key *key, void *object);

/* Whether a value is not known yet; its key is then not read. */
bool schema_is_open(const schema *self, const yaml_node_t *value);

/* Whether a value is YAML's null: nothing, ~ or null, without quotes. */
bool schema_is_null(const yaml_node_t *value);

/* Key and value i of a map, or NULL at its end. */
yaml_node_t *schema_pair(schema *self, yaml_node_t **value, const yaml_node_t *map, size_t i);

/* The value of a key among the first SCHEMA_KEYS_MAX of the map, or NULL. No table has more keys,
 * so a map with more has errors anyway. */
yaml_node_t *schema_find(schema *self, const yaml_node_t *map, const char *name);

/* A value's text, or NULL after a complaint that says what was expected. Never empty; the
 * document's. */
const char *schema_text(schema *self, const schema_key *key, const yaml_node_t *value,
                        const char *expected);

/* Length of a list of min..max items, else complains and returns the nearest number that can be
 * read. schema_count_one() takes a single value for a list of one. */
size_t schema_count(schema *self, const schema_key *key, const yaml_node_t *list, size_t min,
                    size_t max);
size_t schema_count_one(schema *self, const schema_key *key, const yaml_node_t *list, size_t min,
                        size_t max);

/* Item i of a list, or the single value. */
yaml_node_t *schema_item(schema *self, yaml_node_t *list, size_t i);

/* The value of the word that is written, or false after a complaint. */
bool schema_choose(schema *self, unsigned *out, const schema_key *key, const yaml_node_t *value,
                   const schema_choice *choices);

/* on, yes, true, off, no, false; or false after a complaint. */
bool schema_choose_bool(schema *self, bool *out, const schema_key *key, const yaml_node_t *value);

schema_reader schema_read_uint;   /* arg: a schema_range */
schema_reader schema_read_bool;   /* member: bool */
schema_reader schema_read_choice; /* arg: schema_choice[]; member: an enum */

/* Complains at a node; the text begins with the key. */
void schema_complain(schema *self, const yaml_node_t *at, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Warns at a node, in the same way; the value is good all the same. */
void schema_warn(schema *self, const yaml_node_t *at, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Complains about a file that a node names; the text begins with the place in that file. */
void schema_complain_elsewhere(schema *self, const yaml_node_t *at, const char *text);

/* Complains that a value is not what was expected, and shows what it is. */
void schema_expected(schema *self, const schema_key *key, const yaml_node_t *value,
                     const char *expected);

/* Complains about a value when there is a problem, as the parsers of text.h return it. */
void schema_problem(schema *self, const schema_key *key, const yaml_node_t *value,
                    const char *problem);

/* " (did you mean 'X'?)" or "", for the end of a complaint. Takes a guess that has considered. */
const char *schema_suggestion(schema *self, const nearest *guess);

/* Adds ", word" to a list; "" starts one. */
const char *schema_join(schema *self, const char *list, const char *word);

/* Zeroed memory that lives as long as the arena, or NULL after a complaint. */
void *schema_alloc(schema *self, size_t count, size_t size);

/* A copy of a text, or NULL after a complaint. */
char *schema_copy(schema *self, const char *text);

/* A text in memory of the configuration, or NULL after a complaint. */
char *schema_print(schema *self, const char *format, ...) __attribute__((format(printf, 2, 3)));

#endif
