/* SPDX-License-Identifier: MIT
 *
 * main.c - writes the JSON schemas of the files that people write, from the tables of keys that
 *          their readers have (base/schema.h), and the tables of counters and actions for
 *          scripts/man. The build runs it: json-schema FOLDER TABLES
 */
#include "base/text/jsonput.h"
#include "base/text/memo.h"
#include "campaign/campaign_owner.h"
#include "config/parts.h"
#include "config/rig.h"
#include "port/port.h"
#include "schema/type.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* A schema that is being made. */
typedef struct maker {
    json_t *definitions;
    bool open; /* values may be parameters of a profile */
} maker;

/* Maps are in maps, no deeper than the tables. NOLINTBEGIN(misc-no-recursion) */
static json_t *make_map(maker *self, const schema_key *keys, uint8_t kind, const char *name);

static json_t *reference_to(const char *name)
{
    char text[128];
    (void)snprintf(text, sizeof text, "#/$defs/%s", name);
    return json_pack("{s:s}", "$ref", text);
}

/* Defines the types that a definition refers to. Those of maps are defined. */
static void define_types(maker *self, json_t *value)
{
    for (void *i = json_object_iter(value); i; i = json_object_iter_next(value, i))
        define_types(self, json_object_iter_value(i));
    for (size_t i = 0; i < json_array_size(value); i++)
        define_types(self, json_array_get(value, i));
    const char *name = get_text(value, "$ref");
    name = name ? name + strlen("#/$defs/") : NULL;
    if (!name || json_object_get(self->definitions, name))
        return;
    const char *text = type_text(name);
    json_t *type = text ? type_parse(text, NULL) : type_words(name);
    if (!type) {
        (void)fprintf(stderr, "json-schema: there is no type '%s'\n", name);
        exit(EXIT_FAILURE);
    }
    json_object_set_new(self->definitions, name, type);
    define_types(self, type);
}

/* ---- One key --------------------------------------------------------------------------------- */

/* Returns the words of a choice as an enumeration. */
static json_t *words_of(const schema_choice *choices)
{
    json_t *list = json_array();
    for (; choices->name; choices++)
        json_array_append_new(list, json_string(choices->name));
    return json_pack("{s:o}", "enum", list);
}

/* A number above those of json_int_t is a text until it is written. */
static json_t *schema_number_of(uint64_t number)
{
    char text[32];
    if (number <= INT64_MAX)
        return json_integer((json_int_t)number);
    (void)snprintf(text, sizeof text, "#%" PRIu64, number);
    return json_string(text);
}

static json_t *numbers_of(const schema_range *range)
{
    return json_pack("{s:s, s:o, s:o}", "type", "integer", "minimum", schema_number_of(range->min),
                     "maximum", schema_number_of(range->max));
}

/* Returns what the type of a key says of its value, or NULL when its reader must say it. */
static json_t *typed(maker *self, const schema_key *key)
{
    json_t *map = key->map ? make_map(self, key->map, key->within, key->as) : NULL;
    json_t *value;
    if (!key->type || strcmp(key->type, TYPE_UINT) == 0 || strcmp(key->type, TYPE_CHOICE) == 0)
        return map;
    value = *key->type == '{' ? type_parse(key->type, map) : reference_to(key->type);
    json_decref(map);
    return value;
}

/* Returns what JSON schema says of the value of a key. One without a known type ends the build. */
static json_t *schema_value_of(maker *self, const schema_key *key)
{
    json_t *value = typed(self, key);
    const char *type = key->type ? key->type : "";
    if (value)
        return value;
    if (key->read == cfg_read_setting)
        return schema_value_of(self, key->live);
    const char *known = type_of_reader(key->read);
    if (key->read == schema_read_uint || strcmp(type, TYPE_UINT) == 0)
        return numbers_of(key->arg);
    if (key->read == schema_read_choice || strcmp(type, TYPE_CHOICE) == 0)
        return words_of(key->arg);
    if (known)
        return reference_to(known);
    (void)fprintf(stderr, "json-schema: the key '%s' has no type\n", key->name);
    exit(EXIT_FAILURE);
}

/* Returns true for maps and lists, which no parameter stands for. */
static bool is_whole(const maker *self, const schema_key *key, const json_t *value)
{
    const char *type = get_text(value, "type");
    const json_t *form = key->type ? json_object_get(self->definitions, key->type) : NULL;
    return (key->map && !key->type) || json_object_get(form, "oneOf") ||
           (type && (strcmp(type, "object") == 0 || strcmp(type, "array") == 0));
}

/* A default that is not JSON is a text as people write it, such as 1ms. */
static json_t *preset_of(const char *text)
{
    json_t *value = *text == '[' ? type_parse(text, NULL)
                                 : json_loads(text, JSON_DECODE_ANY, NULL);
    return value ? value : json_string(text);
}

/* Makes the schema of a key, with help and default. In a profile a parameter may stand for part of
 * a value. */
static json_t *make_key(maker *self, const schema_key *key)
{
    json_t *value = schema_value_of(self, key);
    if (self->open && !is_whole(self, key, value))
        value = json_pack("{s:[o, o]}", "anyOf", value, reference_to("parameter"));
    if (key->help)
        json_object_set_new(value, "description", json_string(key->help));
    if (key->preset)
        json_object_set_new(value, "default", preset_of(key->preset));
    return value;
}

/* ---- Maps ------------------------------------------------------------------------------------ */

/* Adds what a key needs and excludes to the rules of its map. */
static void add_neighbours(json_t *rules, const schema_key *key)
{
    char *words = strdup(key->needs ? key->needs : key->excludes);
    char *rest = words;
    json_t *value = key->needs ? json_array() : json_object();
    for (char *word; (word = strsep(&rest, " ")) != NULL;) {
        if (key->needs)
            json_array_append_new(value, json_string(word));
        else
            json_object_set_new(value, word, json_false());
    }
    free(words);
    json_object_set_new(rules, key->name,
                        key->needs ? value : json_pack("{s:o}", "properties", value));
}

/* Adds a key to a map. */
static void add_key(maker *self, json_t *map, const schema_key *key)
{
    json_object_set_new(json_object_get(map, "properties"), key->name, make_key(self, key));
    if (key->required)
        json_array_append_new(json_object_get(map, "required"), json_string(key->name));
    if (key->needs)
        add_neighbours(json_object_get(map, "dependentRequired"), key);
    if (key->excludes)
        add_neighbours(json_object_get(map, "dependentSchemas"),
                       &(schema_key){.name = key->name, .excludes = key->excludes});
}

/* Adds the rules of the whole map, and takes the empty ones away. */
static void end_map(json_t *map, const schema_key *last)
{
    static const char *const names[] = {"required", "dependentRequired", "dependentSchemas"};
    json_t *rules = last->type ? type_parse(last->type, NULL) : NULL;
    if (rules)
        json_object_update(map, rules);
    json_decref(rules);
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        const json_t *value = json_object_get(map, names[i]);
        if (json_array_size(value) + json_object_size(value) == 0)
            json_object_del(map, names[i]);
    }
}

/* Makes the schema of a map from the table of its reader. One with a name becomes a definition,
 * once. */
static json_t *make_map(maker *self, const schema_key *keys, uint8_t kind, const char *name)
{
    const bool open = self->open;
    const schema_key *last = keys;
    while (last->name)
        last++;
    if (name && json_object_get(self->definitions, name))
        return reference_to(name);
    json_t *map = json_pack("{s:s, s:{}, s:b, s:[], s:{}, s:{}}", "type", "object", "properties",
                            "additionalProperties", false, "required", "dependentRequired",
                            "dependentSchemas");
    self->open = open || last->open;
    for (const schema_key *key = keys; key->name; key++)
        if (!key->where || !kind || key->where & kind)
            add_key(self, map, key);
    self->open = open;
    end_map(map, last);
    if (!name)
        return map;
    json_object_set_new(self->definitions, name, map);
    return reference_to(name);
}

/* NOLINTEND(misc-no-recursion) */

/* ---- Maps of several forms ------------------------------------------------------------------- */

/* Defines each form of a map as WHAT-KEY after its first key, and WHAT as one of them. */
static void make_forms(maker *self, const char *what, const char *which, cfg_form *form, bool open)
{
    const schema_key *keys;
    json_t *all = json_array();
    self->open = open;
    schema_key room[SCHEMA_KEYS_MAX];
    for (size_t i = 0; (keys = form(i, room)) != NULL; i++) {
        char name[64];
        (void)snprintf(name, sizeof name, "%s-%s", what, keys->name);
        json_t *map = make_map(self, keys, 0, NULL);
        json_t *required = json_object_get(map, "required");
        if (!required)
            json_object_set_new(map, "required", required = json_array());
        json_array_insert_new(required, 0, json_string(keys->name));
        json_object_set_new(self->definitions, name, map);
        json_array_append_new(all, reference_to(name));
    }
    self->open = false;
    json_object_set_new(self->definitions, what, json_pack("{s:o}", which, all));
}

/* An expectation has one subject, and the conditions of that. */
static void add_subjects(json_t *expectation)
{
    json_t *subjects = json_array();
    json_t *conditions = json_object();
    const char *subject, *condition;
    for (size_t i = 0; (subject = cfg_expect_subject(i)) != NULL; i++)
        json_array_append_new(subjects, json_pack("{s:[s]}", "required", subject));
    for (size_t j = 0; (condition = cfg_expect_condition(j)) != NULL; j++) {
        json_t *list = json_array();
        for (size_t i = 0; (subject = cfg_expect_subject(i)) != NULL; i++)
            if (cfg_expect_has(i, j))
                json_array_append_new(list, json_pack("{s:[s]}", "required", subject));
        json_object_set_new(conditions, condition, json_pack("{s:o}", "anyOf", list));
    }
    json_object_set_new(expectation, "oneOf", subjects);
    json_object_set_new(expectation, "dependentSchemas", conditions);
}

/* ---- Numbers --------------------------------------------------------------------------------- */

/* Prints a pattern of the numbers of a range: those with the same digits in front, one digit of a
 * few, and then any digits. */
static void print_numbers(FILE *out, uint64_t from, uint64_t to)
{
    const char *between = "^(?:";
    for (bool more = true; more; between = "|") {
        uint64_t size = 1; /* of what the digits behind the one of a few can be */
        unsigned behind = 0;
        while (from > 0 && from % (size * 10) == 0 && to - from >= size * 10 - 1) {
            size *= 10;
            behind++;
        }
        const unsigned digit = (unsigned)(from / size % 10);
        const uint64_t fitting = (to - from - (size - 1)) / size; /* steps of the digit */
        const unsigned last = fitting < 9 - digit ? digit + (unsigned)fitting : 9;
        (void)fputs(between, out);
        if (from / size >= 10)
            (void)fprintf(out, "%" PRIu64, from / size / 10);
        (void)fprintf(out, last > digit ? "[%u-%u]" : "%u", digit, last);
        if (behind > 0)
            (void)fprintf(out, "[0-9]{%u}", behind);
        const uint64_t end = from + (last - digit) * size + (size - 1);
        more = end < to;
        from = end + 1;
    }
    (void)fputs(")$", out);
}

static uint64_t limit_of(const json_t *type, const char *key)
{
    const json_t *limit = json_object_get(type, key);
    return json_is_string(limit) ? strtoull(json_string_value(limit) + 1, NULL, 10)
                                 : (uint64_t)json_integer_value(limit);
}

/* The readers ignore quotes: a whole number may be a text. */
static void allow_text(json_t *type)
{
    memo pattern;
    print_numbers(memo_begin(&pattern), limit_of(type, "minimum"), limit_of(type, "maximum"));
    json_object_set_new(type, "type", json_pack("[s, s]", "integer", "string"));
    json_object_set_new(type, "pattern", json_string(memo_text(&pattern)));
    memo_end(&pattern);
}

/* Lists are in maps, no deeper than the schema. NOLINTNEXTLINE(misc-no-recursion) */
static void allow_texts(json_t *value)
{
    const char *type = json_string_value(json_object_get(value, "type"));
    if (type && strcmp(type, "integer") == 0 && json_object_get(value, "maximum"))
        allow_text(value);
    for (void *i = json_object_iter(value); i; i = json_object_iter_next(value, i))
        allow_texts(json_object_iter_value(i));
    for (size_t i = 0; i < json_array_size(value); i++)
        allow_texts(json_array_get(value, i));
}

/* ---- Files ----------------------------------------------------------------------------------- */

static maker make_begin(void)
{
    return (maker){.definitions = json_object()};
}

/* Completes a schema and writes it. */
static void make_end(maker *self, json_t *root, const char *folder, const char *name)
{
    char path[4096];
    define_types(self, root);
    json_t *defined = json_deep_copy(self->definitions); /* it grows */
    define_types(self, defined);
    json_decref(defined);
    json_object_set_new(root, "$defs", self->definitions);
    allow_texts(root);
    (void)snprintf(path, sizeof path, "%s/%s.schema.json", folder, name);
    char *text = json_dumps(root, JSON_INDENT(1));
    FILE *out = fopen(path, "w");
    if (!text || !out) {
        perror(path);
        exit(EXIT_FAILURE);
    }
    for (const char *c = text; *c; c++) {
        const size_t digits = strncmp(c, "\"#", 2) == 0 ? strspn(c + 2, "0123456789") : 0;
        (void)fprintf(out, "%.*s", digits > 0 ? (int)digits : 1, digits > 0 ? c + 2 : c);
        c += digits > 0 ? digits + 2 : 0;
    }
    if (fputc('\n', out) == EOF || fclose(out) != 0) {
        perror(path);
        exit(EXIT_FAILURE);
    }
    free(text);
    json_decref(root);
}

static json_t *begin_file(const char *title, const char *what)
{
    return json_pack("{s:s, s:s, s:s}", "$schema", "https://json-schema.org/draft/2020-12/schema",
                     "title", title, "description", what);
}

/* Writes the schema of configurations and profiles, which are told apart by their keys. */
static void make_configuration(const char *folder)
{
    maker self = make_begin();
    json_t *root = begin_file("canwire configuration or fault profile",
                              "What canwired, canwire sim and canwire check read. Names that do "
                              "not exist, duplicates and the like only `canwire check` finds.");
    json_t *choice = type_parse(
        "{'if': " TYPE_ANY(TYPE_NEEDS("bus") ", " TYPE_NEEDS("nodes") ", " TYPE_NEEDS("guests"))
        ", 'then': " TYPE_REF("configuration") ", 'else': {'if': "
        TYPE_ANY(TYPE_NEEDS("faults") ", " TYPE_NEEDS("parameters") ", " TYPE_NEEDS("profile"))
        ", 'then': " TYPE_REF("profile") ", 'else': " TYPE_REF("configuration") "}}", NULL);
    json_object_update(root, choice);
    json_decref(choice);
    make_forms(&self, "do", "oneOf", cfg_action_form, true);
    make_forms(&self, "traffic", "anyOf", cfg_traffic_form, false);
    json_decref(make_map(&self, cfg_file_keys, 0, "configuration"));
    json_decref(make_map(&self, cfg_profile_keys, CFG_IN_PROFILES, "profile"));
    add_subjects(json_object_get(self.definitions, "expectation"));
    make_end(&self, root, folder, "canwire");
}

/* Writes the schema of files whose top level is one map. */
static void make_file(const char *folder, const char *name, const schema_key *keys,
                      const char *title, const char *what)
{
    maker self = make_begin();
    json_t *root = begin_file(title, what);
    json_t *map = make_map(&self, keys, 0, NULL);
    json_object_update(root, map);
    json_decref(map);
    make_end(&self, root, folder, name);
}

/* ---- Tables ---------------------------------------------------------------------------------- */

/* Returns the counters of a table that outputs have. */
static json_t *counters_of(const cw_stat *table)
{
    static const char *const where[] = {
        [CW_STAT_USUAL] = "",
        [CW_STAT_FD] = "where there is CAN FD",
        [CW_STAT_HOST] = "where a node has a `filter`, receive buffers or mailboxes",
        [CW_STAT_SLEEP] = "where the node has slept",
    };
    json_t *list = json_array();
    for (const cw_stat *c = table; c->name; c++)
        if (c->shown != CW_STAT_CODE)
            json_array_append_new(list, json_pack("{s:s, s:s, s:s, s:s}", "name", c->name, "unit",
                                                  cw_unit_name(c->unit), "where", where[c->shown],
                                                  "sentence", c->sentence));
    return list;
}

/* Returns the names of the actions of fault rules by their kinds, in the order of messages. Some
 * actions of the library are others to configurations. */
static json_t *actions_by_kind(void)
{
    static const char *const kinds[] = {
        [CW_KIND_POSITION] = "position", [CW_KIND_LEVEL] = "level", [CW_KIND_CONTROL] = "control",
        [CW_KIND_HOST] = "host",         [CW_KIND_TRAFFIC] = "traffic",
    };
    json_t *all = json_object();
    schema_key room[SCHEMA_KEYS_MAX];
    const schema_key *keys;
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++)
        json_object_set_new(all, kinds[i], json_array());
    for (size_t i = 0; (keys = cfg_action_form(i, room)) != NULL; i++) {
        cw_action action = CW_ACTION_FLIP;
        while (strcmp(cw_action_name(action), keys->name) != 0)
            action++;
        json_array_append_new(json_object_get(all, kinds[cw_action_kind_of(action)]),
                              json_string(keys->name));
    }
    return all;
}

/* Writes the tables of counters and actions, for the man pages. */
static void write_tables(const char *path)
{
    json_t *root = json_pack(
        "{s:o, s:o, s:o, s:o, s:o, s:o, s:o}", "bus", counters_of(cw_bus_counters), "node",
        counters_of(cw_node_counters), "host", counters_of(cw_host_counters), "sleep",
        counters_of(cw_sleep_counters), "interface", counters_of(port_counters), "tunnel",
        counters_of(port_tunnel_counters), "actions", actions_by_kind());
    if (json_dump_file(root, path, JSON_INDENT(1)) != 0) {
        perror(path);
        exit(EXIT_FAILURE);
    }
    json_decref(root);
}

int main(int argc, char **argv)
{
    if (argc != 3) {
        (void)fprintf(stderr, "usage: json-schema FOLDER TABLES\n");
        return 2;
    }
    write_tables(argv[2]);
    make_configuration(argv[1]);
    make_file(argv[1], "canwire-rig", rig_file_keys, "canwire rig",
              "Several buses and the gateways between their nodes, for canwire sim and canwire "
              "check. Names that do not exist, duplicates and loops only `canwire check` finds.");
    make_file(argv[1], "canwire-campaign", campaign_file_keys, "canwire campaign",
              "A scenario and what varies in it, for canwire campaign. Paths and names that do not "
              "exist only the tool finds.");
    return 0;
}
