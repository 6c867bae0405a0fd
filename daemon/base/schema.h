/* SPDX-License-Identifier: MIT
 *
 * schema.h - walks a YAML document by tables of keys, into plain structs.
 *
 * A table of schema_key describes a map. Each key has a reader that turns its value into a member
 * of a struct. Readers complain and go on, so one walk finds all errors. A walk is as deep as the
 * tables: aliases that form a cycle end as an error.
 *
 * The same tables tell people and editors of the keys: daemon/schema makes the JSON schemas of
 * them, and scripts/man the man page of these.
 */
#ifndef CANWIRE_BASE_SCHEMA_H
#define CANWIRE_BASE_SCHEMA_H

#include "base/arena.h"
#include "base/diag.h"
#include "base/text/nearest.h"
#include "base/text/typetext.h"

#include <stdint.h>
#include <yaml.h>

#define SCHEMA_KEYS_MAX 64 /* of one map */
#define SCHEMA_OPEN '\x02' /* begins a text whose value is not known yet */

typedef struct schema {
    diag *errors;
    arena *arena; /* owns the strings and arrays that are read */
    yaml_document_t *document;
    void *user;    /* for the readers */
    bool has_open; /* texts that begin with SCHEMA_OPEN are accepted as any value */
} schema;

typedef struct schema_key schema_key;

/* Turns the value into its member of *object, or complains. */
typedef void schema_reader(schema *self, const schema_key *key, yaml_node_t *value, void *object);

struct schema_key {
    const char *name;    /* NULL ends a table */
    schema_reader *read; /* NULL: the key is refused because it comes later */
    size_t offset;       /* of the member in the struct */
    const void *arg;     /* argument of the reader, see there */
    bool required;
    uint8_t where;             /* the kinds of maps that have it, as bits; 0: all (schema_map_in) */
    const void *live;          /* for its owner: a change while it is in use, or NULL */
    /* For people and the JSON schema. */
    const char *help;          /* a sentence */
    const char *preset;        /* the default: a text, or JSON with ' for " */
    const char *type;          /* of the value, see base/typetext.h; NULL: as the reader has it */
    const schema_key *map;     /* keys of a value that is a map, or of maps in it */
    uint8_t within;            /* ... of this kind */
    const char *as;            /* the name of that map among the definitions, or NULL */
    const char *needs;         /* keys that it needs, between blanks */
    const char *excludes;      /* ... that it excludes */
    bool open;                 /* last row: values may be parameters of a profile */
};

/* The argument of schema_read_uint(). */
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

/* Walks a map. Complains about a node that is not a map, and about unknown, duplicate and missing
 * keys. Calls the readers in the order of the table. `what` names the map in messages. Reading
 * stops once there are more errors than are shown. The last row of a table may have the `type` of
 * the whole map. schema_map_in() walks a map of one kind, a bit: other keys are unknown in it. */
void schema_map(schema *self, const char *what, yaml_node_t *map, const schema_key *keys,
                void *object);
void schema_map_in(schema *self, const char *what, yaml_node_t *map, const schema_key *keys,
                   uint8_t kind, void *object);

/* Reads the `preset` of a key, if it has one, or of each key of a table into the object. */
void schema_read_preset(schema *self, const schema_key *key, void *object);
void schema_read_presets(schema *self, const schema_key *keys, void *object);

/* Returns the member of an object that a key stands for. */
void *schema_member(const schema_key *key, void *object);

/* Returns true when a value is not known yet; its key is then not read. */
bool schema_is_open(const schema *self, const yaml_node_t *value);

/* Returns true when a value is YAML's null: nothing, ~ or null, without quotes. */
bool schema_is_null(const yaml_node_t *value);

/* Returns key and value i of a map, or NULL at its end. */
yaml_node_t *schema_pair(schema *self, yaml_node_t **value, const yaml_node_t *map, size_t i);

/* Returns the value of a key among the first SCHEMA_KEYS_MAX of the map, or NULL. No table has more
 * keys, so a map with more has errors anyway. */
yaml_node_t *schema_find(schema *self, const yaml_node_t *map, const char *name);

/* Returns a value's text, or NULL after a complaint that says what was expected. The text is never
 * empty and belongs to the document. */
const char *schema_text(schema *self, const schema_key *key, const yaml_node_t *value,
                        const char *expected);

/* Returns the length of a list of min..max items. A wrong length causes a complaint; the nearest
 * readable number is returned. schema_count_one() accepts a single value as a list of one. */
size_t schema_count(schema *self, const schema_key *key, const yaml_node_t *list, size_t min,
                    size_t max);
size_t schema_count_one(schema *self, const schema_key *key, const yaml_node_t *list, size_t min,
                        size_t max);

/* Returns item i of a list, or the single value. */
yaml_node_t *schema_item(schema *self, yaml_node_t *list, size_t i);

/* Reads the value of a word. Returns false after a complaint. */
bool schema_choose(schema *self, unsigned *out, const schema_key *key, const yaml_node_t *value,
                   const schema_choice *choices);

/* Reads on, yes, true, off, no or false. Returns false after a complaint. */
bool schema_choose_bool(schema *self, bool *out, const schema_key *key, const yaml_node_t *value);

/* Reads one of the words that schema_choose_bool() knows. */
bool schema_parse_bool(bool *out, const char *text);

schema_reader schema_read_uint;   /* arg: a schema_range */
schema_reader schema_read_bool;   /* member: bool */
schema_reader schema_read_choice; /* arg: schema_choice[]; member: an enum */

/* Complains at a node; the text begins with the key. */
void schema_complain(schema *self, const yaml_node_t *at, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Warns at a node in the same way; the value is valid. */
void schema_warn(schema *self, const yaml_node_t *at, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Complains about a file that a node names; the text begins with the place in that file. */
void schema_complain_elsewhere(schema *self, const yaml_node_t *at, const char *text);

/* Complains that a value is not as expected, and shows the value. */
void schema_expected(schema *self, const schema_key *key, const yaml_node_t *value,
                     const char *expected);

/* Complains about a value when there is a problem, in the form that the parsers of base/number.h
 * return. */
void schema_problem(schema *self, const schema_key *key, const yaml_node_t *value,
                    const char *problem);

/* Returns " (did you mean 'X'?)" or "", for the end of a complaint. The guess has considered all
 * words. */
const char *schema_suggestion(schema *self, const nearest *guess);

/* Returns the suggestion, or without one "; allowed: LIST": a list of all words would hide it. */
const char *schema_allowed(schema *self, const nearest *guess, const char *list);

/* Returns a list with ", word" added; "" starts one. */
const char *schema_join(schema *self, const char *list, const char *word);

/* Returns zeroed memory that lives as long as the arena, or NULL after a complaint. */
void *schema_alloc(schema *self, size_t count, size_t size);

/* Returns a copy of a text, or NULL after a complaint. */
char *schema_copy(schema *self, const char *text);

/* Returns a text in memory of the configuration, or NULL after a complaint. */
char *schema_print(schema *self, const char *format, ...) __attribute__((format(printf, 2, 3)));

#endif
