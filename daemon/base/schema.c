/* SPDX-License-Identifier: MIT
 *
 * schema.c - walks a YAML document by tables of keys, into plain structs.
 */
#include "base/schema.h"

#include "base/text/number.h"
#include "base/text/plain.h"
#include "base/text/yamlfile.h"

#include <assert.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#define SHOWN_MAX 40 /* bytes of a value that a message shows */

static const schema_choice booleans[] = {
    {.name = "on", .value = true},
    {.name = "off", .value = false},
    {.name = "yes", .value = true},
    {.name = "no", .value = false},
    {.name = "true", .value = true},
    {.name = "false", .value = false},
    {.name = NULL},
};

/* The keys of one kind of maps. */
typedef struct key_table {
    const schema_key *keys;
    uint8_t kind;
} key_table;

static bool schema_check_keys(schema *self, const char *what, const yaml_node_t *map,
                              key_table table);
static const char *allowed_keys(schema *self, key_table table);
static bool is_text(const yaml_node_t *node, const char *text);
static const char *scalar_text(const yaml_node_t *node);
static const char *shown(schema *self, const yaml_node_t *node);
static const char *quoted(schema *self, const yaml_node_t *node, const char *quote);
static const char *allowed_choices(schema *self, const schema_choice *choices);
static void store_uint(void *target, size_t bytes, uint64_t value);
static size_t clamp_count(schema *self, const schema_key *key, const yaml_node_t *list, size_t min,
                          size_t max);

/* Returns this key, or the next one of its kind, or the last row. */
static const schema_key *of_kind(key_table table, const schema_key *key)
{
    while (key->name && key->where && !(key->where & table.kind))
        key++;
    return key;
}

static const schema_key *first_key(key_table table)
{
    return of_kind(table, table.keys);
}

static const schema_key *next_key(key_table table, const schema_key *key)
{
    return of_kind(table, key + 1);
}

/* Shows what a name alone would be as a map, such as `- engine` in a list of nodes. */
static void complain_no_map(schema *self, const char *what, const yaml_node_t *value,
                            key_table table)
{
    const char *text = scalar_text(value);
    bool named = false;

    for (const schema_key *key = first_key(table); key->name; key = next_key(table, key))
        named = named || (key->read && strcmp(key->name, "name") == 0);
    if (named && text && *text)
        schema_complain(self, value, "%s %s is a map: name: %s",
                        strchr("aeiou", *what) ? "an" : "a", what, quoted(self, value, ""));
    else
        schema_complain(self, value, "%s: expected a map with the keys %s, not %s", what,
                        allowed_keys(self, table), shown(self, value));
}

void schema_map(schema *self, const char *what, yaml_node_t *map, const schema_key *keys,
                void *object)
{
    schema_map_in(self, what, map, keys, UINT8_MAX, object);
}

void schema_map_in(schema *self, const char *what, yaml_node_t *map, const schema_key *keys,
                   uint8_t kind, void *object)
{
    const key_table table = {.keys = keys, .kind = kind};
    if (map->type != YAML_MAPPING_NODE) {
        complain_no_map(self, what, map, table);
        return;
    }
    bool complete = !self->errors->overflow && schema_check_keys(self, what, map, table);
    if (self->errors->overflow)
        return; /* further errors are not shown */
    for (const schema_key *key = first_key(table); key->name; key = next_key(table, key)) {
        yaml_node_t *value = schema_find(self, map, key->name);

        if (value && key->read && !schema_is_open(self, value))
            key->read(self, key, value, object);
        else if (!value && key->required && complete)
            schema_complain(self, map, "%s: the key '%s' is missing", what, key->name);
    }
}

/* A list is a document of its own. */
static void read_preset_list(schema *self, const schema_key *key, void *object)
{
    yaml_document_t *const document = self->document;
    yaml_document_t list;

    if (!yaml_text_load(&list, key->preset, strlen(key->preset), &yaml_text_limits, self->errors))
        return;
    self->document = &list;
    key->read(self, key, yaml_document_get_root_node(&list), object);
    self->document = document;
    yaml_document_delete(&list);
}

void schema_read_preset(schema *self, const schema_key *key, void *object)
{
    yaml_node_t value = {.type = YAML_SCALAR_NODE,
                         .start_mark = {.line = SIZE_MAX, .column = SIZE_MAX}}; /* 0:0 */

    if (!key->preset)
        return;
    value.data.scalar.value = (yaml_char_t *)(uintptr_t)key->preset;
    value.data.scalar.length = strlen(key->preset);
    if (*key->preset == '[')
        read_preset_list(self, key, object);
    else
        key->read(self, key, &value, object);
}

void schema_read_presets(schema *self, const schema_key *keys, void *object)
{
    for (; keys->name; keys++)
        schema_read_preset(self, keys, object);
}

void *schema_member(const schema_key *key, void *object)
{
    return (char *)object + key->offset;
}

bool schema_is_open(const schema *self, const yaml_node_t *value)
{
    const char *text = scalar_text(value);

    return self->has_open && text && *text == SCHEMA_OPEN;
}

bool schema_is_null(const yaml_node_t *value)
{
    if (value->type != YAML_SCALAR_NODE || value->data.scalar.style != YAML_PLAIN_SCALAR_STYLE)
        return false;

    const char *text = (const char *)value->data.scalar.value;
    return *text == '\0' || strcmp(text, "~") == 0 || strcmp(text, "null") == 0;
}

yaml_node_t *schema_pair(schema *self, yaml_node_t **value, const yaml_node_t *map, size_t i)
{
    const yaml_node_pair_t *pair = map->data.mapping.pairs.start + i;

    if (pair >= map->data.mapping.pairs.top)
        return NULL;
    *value = yaml_document_get_node(self->document, pair->value);
    return yaml_document_get_node(self->document, pair->key);
}

yaml_node_t *schema_find(schema *self, const yaml_node_t *map, const char *name)
{
    const yaml_node_pair_t *pair = map->data.mapping.pairs.start;
    const yaml_node_pair_t *end = map->data.mapping.pairs.top;

    if (end - pair > SCHEMA_KEYS_MAX)
        end = pair + SCHEMA_KEYS_MAX;
    for (; pair < end; pair++)
        if (is_text(yaml_document_get_node(self->document, pair->key), name))
            return yaml_document_get_node(self->document, pair->value);
    return NULL;
}

const char *schema_text(schema *self, const schema_key *key, const yaml_node_t *value,
                        const char *expected)
{
    const char *text = scalar_text(value);

    if (text && *text && (schema_is_open(self, value) || !plain_is_not(text)))
        return text;
    if (text && *text)
        schema_complain(self, value, "%s: a text has no control characters and is UTF-8",
                        key->name);
    else
        schema_expected(self, key, value, expected);
    return NULL;
}

size_t schema_count(schema *self, const schema_key *key, const yaml_node_t *list, size_t min,
                    size_t max)
{
    if (list->type == YAML_SEQUENCE_NODE)
        return clamp_count(self, key, list, min, max);
    schema_expected(self, key, list, "a list");
    return 0;
}

size_t schema_count_one(schema *self, const schema_key *key, const yaml_node_t *list, size_t min,
                        size_t max)
{
    if (list->type == YAML_SEQUENCE_NODE)
        return clamp_count(self, key, list, min, max);
    return 1;
}

yaml_node_t *schema_item(schema *self, yaml_node_t *list, size_t i)
{
    if (list->type != YAML_SEQUENCE_NODE)
        return list;
    return yaml_document_get_node(self->document, list->data.sequence.items.start[i]);
}

bool schema_choose(schema *self, unsigned *out, const schema_key *key, const yaml_node_t *value,
                   const schema_choice *choices)
{
    const char *text = scalar_text(value);
    const schema_choice *choice = choices;

    while (choice->name && (!text || strcmp(text, choice->name) != 0))
        choice++;
    if (choice->name) {
        *out = choice->value;
        return true;
    }
    schema_complain(self, value, "%s: expected one of %s, not %s", key->name,
                    allowed_choices(self, choices), shown(self, value));
    return false;
}

bool schema_choose_bool(schema *self, bool *out, const schema_key *key, const yaml_node_t *value)
{
    unsigned choice;

    if (!schema_choose(self, &choice, key, value, booleans))
        return false;
    *out = choice;
    return true;
}

bool schema_parse_bool(bool *out, const char *text)
{
    for (const schema_choice *choice = booleans; choice->name; choice++)
        if (strcmp(choice->name, text) == 0) {
            *out = choice->value;
            return true;
        }
    return false;
}

void schema_read_uint(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const schema_range *range = key->arg;
    const char *text = scalar_text(value);
    uint64_t number = 0;
    const char *problem = text && *text ? text_parse_uint(&number, text) : "";

    if (!problem && number >= range->min && number <= range->max) {
        store_uint(schema_member(key, object), range->bytes, number);
        return;
    }
    problem = text && text_meant_uint(&number, text) && number >= range->min && number <= range->max
                  ? schema_print(self, "write %" PRIu64, number)
                  : problem;
    schema_complain(
        self, value, "%s: expected a decimal integer %" PRIu64 "..%" PRIu64 ", not %s%s%s%s",
        key->name, range->min, range->max, shown(self, value), problem && *problem ? " (" : "",
        problem ? problem : "", problem && *problem ? ")" : "");
}

void schema_read_bool(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    schema_choose_bool(self, schema_member(key, object), key, value);
}

void schema_read_choice(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    schema_choose(self, schema_member(key, object), key, value, key->arg);
}

typedef void diag_reporter(diag *self, size_t line, size_t column, const char *format, ...);

/* Lines and columns of libyaml count from 0, those of messages from 1. */
static void __attribute__((format(printf, 4, 0)))
schema_report(schema *self, diag_reporter *reporter, const yaml_node_t *at, const char *format,
              va_list args)
{
    char *text = NULL;

    if (vasprintf(&text, format, args) < 0)
        text = NULL;
    reporter(self->errors, at->start_mark.line + 1, at->start_mark.column + 1, "%s",
           text ? text : "out of memory");
    free(text);
}

void schema_complain(schema *self, const yaml_node_t *at, const char *format, ...)
{
    va_list args;

    va_start(args, format);
    schema_report(self, diag_add, at, format, args);
    va_end(args);
}

void schema_warn(schema *self, const yaml_node_t *at, const char *format, ...)
{
    va_list args;

    va_start(args, format);
    schema_report(self, diag_warn, at, format, args);
    va_end(args);
}

void schema_complain_elsewhere(schema *self, const yaml_node_t *at, const char *text)
{
    diag_add_elsewhere(self->errors, at->start_mark.line + 1, at->start_mark.column + 1, text);
}

void schema_expected(schema *self, const schema_key *key, const yaml_node_t *value,
                     const char *expected)
{
    schema_complain(self, value, "%s: expected %s, not %s", key->name, expected,
                    shown(self, value));
}

void schema_problem(schema *self, const schema_key *key, const yaml_node_t *value,
                    const char *problem)
{
    if (problem)
        schema_complain(self, value, "%s: %s: %s", key->name, shown(self, value), problem);
}

const char *schema_suggestion(schema *self, const nearest *guess)
{
    const char *text = "";

    if (guess->best)
        text = arena_print(self->arena, " (did you mean '%s'?)", guess->best);
    return text ? text : "";
}

const char *schema_allowed(schema *self, const nearest *guess, const char *list)
{
    const char *text = guess->best ? schema_suggestion(self, guess)
                                   : arena_print(self->arena, "; allowed: %s", list);

    return text ? text : "";
}

const char *schema_join(schema *self, const char *list, const char *word)
{
    const char *longer = arena_print(self->arena, "%s%s%s", list, *list ? ", " : "", word);

    return longer ? longer : list;
}

void *schema_alloc(schema *self, size_t count, size_t size)
{
    void *memory = count <= SIZE_MAX / size ? arena_alloc(self->arena, count * size) : NULL;

    if (!memory)
        diag_add(self->errors, 0, 0, "out of memory");
    return memory;
}

char *schema_copy(schema *self, const char *text)
{
    char *copy = schema_alloc(self, strlen(text) + 1, 1);

    return copy ? strcpy(copy, text) : NULL;
}

char *schema_print(schema *self, const char *format, ...)
{
    va_list args;

    va_start(args, format);
    char *text = arena_print_list(self->arena, format, args);
    va_end(args);
    if (!text)
        diag_add(self->errors, 0, 0, "out of memory");
    return text;
}

/* Lists keys for messages. Those that are only refused are left out. */
static const char *allowed_keys(schema *self, key_table table)
{
    const char *list = "";

    for (const schema_key *key = first_key(table); key->name; key = next_key(table, key))
        if (key->read)
            list = schema_join(self, list, key->name);
    return list;
}

/* Complains about a key, with the nearest one as a guess or with all of them. */
static void complain_unknown(schema *self, const char *what, const yaml_node_t *name,
                             key_table table)
{
    const char *text = scalar_text(name);
    nearest guess = {.word = text ? text : ""};

    if (text && strcmp(text, "<<") == 0) {
        schema_complain(self, name, "%s: merge keys (<<) are not supported", what);
        return;
    }
    for (const schema_key *key = first_key(table); key->name; key = next_key(table, key))
        if (key->read)
            nearest_consider(&guess, key->name);
    schema_complain(self, name, "%s: unknown key %s%s", what, shown(self, name),
                    schema_allowed(self, &guess, allowed_keys(self, table)));
}

/* Returns the index of a key in its table; that of the end when the key is unknown. */
static size_t schema_find_key(key_table table, const char *name)
{
    const schema_key *key = first_key(table);

    while (key->name && (!name || strcmp(key->name, name) != 0))
        key = next_key(table, key);
    return (size_t)(key - table.keys);
}

/* Complains about unknown, refused and duplicate keys. Returns false when a key was refused or
 * there are too many to examine: a missing key may then be among them. */
static bool schema_check_keys(schema *self, const char *what, const yaml_node_t *map,
                              key_table table)
{
    const schema_key *keys = table.keys;
    size_t first_line[SCHEMA_KEYS_MAX] = {0};
    const yaml_node_pair_t *end = map->data.mapping.pairs.top;
    bool complete = end - map->data.mapping.pairs.start <= SCHEMA_KEYS_MAX;

    for (const yaml_node_pair_t *pair = map->data.mapping.pairs.start;
         pair < end && !self->errors->overflow; pair++) {
        const yaml_node_t *name = yaml_document_get_node(self->document, pair->key);
        size_t i = schema_find_key(table, scalar_text(name));

        assert(i < SCHEMA_KEYS_MAX);
        if (!keys[i].name)
            complain_unknown(self, what, name, table);
        else if (first_line[i] != 0)
            schema_complain(self, name, "%s: duplicate key '%s' (first in line %zu)", what,
                            keys[i].name, first_line[i]);
        else if (!keys[i].read)
            schema_complain(self, name, "%s: the key '%s' is not supported yet; allowed: %s", what,
                            keys[i].name, allowed_keys(self, table));
        if (keys[i].name && first_line[i] == 0)
            first_line[i] = name->start_mark.line + 1;
        complete = complete && !(keys[i].name && !keys[i].read);
    }
    return complete;
}

/* Returns true when a scalar is this text. A longer scalar costs nothing. */
static bool is_text(const yaml_node_t *node, const char *text)
{
    size_t length = strlen(text);

    return node->type == YAML_SCALAR_NODE && node->data.scalar.length == length &&
           memcmp(node->data.scalar.value, text, length) == 0;
}

/* Returns the text of a scalar without NUL, else NULL; "" for YAML's null. */
static const char *scalar_text(const yaml_node_t *node)
{
    if (schema_is_null(node))
        return "";
    if (node->type != YAML_SCALAR_NODE)
        return NULL;

    const char *text = (const char *)node->data.scalar.value;
    return strlen(text) == node->data.scalar.length ? text : NULL;
}

/* Returns a bounded copy on one line, in quotes; a cut never leaves half a UTF-8 character. */
static const char *quoted(schema *self, const yaml_node_t *node, const char *quote)
{
    const unsigned char *text = node->data.scalar.value;
    size_t length = node->data.scalar.length;
    size_t kept = length < SHOWN_MAX ? length : SHOWN_MAX;

    while (kept < length && kept > 0 && (text[kept] & 0xC0) == 0x80)
        kept--;
    char *copy = arena_print(self->arena, "%s%*s%s%s", quote, (int)kept, "", quote,
                             kept < length ? "..." : "");
    for (size_t i = 0; copy && i < kept; i++)
        copy[strlen(quote) + i] = (char)(text[i] ? text[i] : '?');
    if (copy)
        plain_make(copy, '?');
    return copy ? copy : "?";
}

/* Returns a value as messages name it. */
static const char *shown(schema *self, const yaml_node_t *node)
{
    switch (node->type) {
    case YAML_SCALAR_NODE:
        return node->data.scalar.length == 0 ? "nothing" : quoted(self, node, "'");
    case YAML_SEQUENCE_NODE:
        return "a list";
    case YAML_MAPPING_NODE:
        return "a map";
    case YAML_NO_NODE:
        break;
    }
    return "nothing";
}

/* Lists the words of a choice for messages. */
static const char *allowed_choices(schema *self, const schema_choice *choices)
{
    const char *list = "";

    for (; choices->name; choices++)
        list = schema_join(self, list, choices->name);
    return list;
}

/* Stores a number in the size that its key's range says. */
static void store_uint(void *target, size_t bytes, uint64_t value)
{
    switch (bytes) {
    case 1:
        *(uint8_t *)target = (uint8_t)value;
        break;
    case 2:
        *(uint16_t *)target = (uint16_t)value;
        break;
    case 4:
        *(uint32_t *)target = (uint32_t)value;
        break;
    default:
        assert(bytes == 8);
        *(uint64_t *)target = value;
        break;
    }
}

/* Complains about too few or too many items. Returns their number, at most max, so that readers can
 * go on. */
static size_t clamp_count(schema *self, const schema_key *key, const yaml_node_t *list, size_t min,
                          size_t max)
{
    size_t count = (size_t)(list->data.sequence.items.top - list->data.sequence.items.start);

    if (count >= min && count <= max)
        return count;
    schema_complain(self, list, "%s: expected %zu to %zu items, not %zu", key->name, min, max,
                    count);
    return count < max ? count : max;
}
