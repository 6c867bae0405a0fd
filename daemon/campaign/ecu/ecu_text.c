/* SPDX-License-Identifier: MIT
 *
 * ecu_text.c - the scenario of a row as canwired runs it: with a port for each program.
 *
 * Each change loads the text anew, since a change moves the places of the others.
 */
#include "campaign/ecu/ecu_text.h"

#include "base/text/jsontext.h"
#include "base/text/yamlfile.h"
#include "campaign/ecu/ecu_folder.h"
#include "campaign/space/splice.h"

#include <inttypes.h>
#include <string.h>

#define FILES_MAX 1024u /* files that a scenario names */
#define NO_MEMORY "out of memory"

typedef struct change {
    buffer *text;
    arena *memory;
    const ecu_changes *wanted;
    yaml_document_t document;
} change;

void ecu_port_path(char out[ECU_SOCKET_MAX], const ecu_changes *changes, size_t program)
{
    const ecu *list = changes->plan->list;
    size_t first = 0;
    while (strcmp(list[first].node, list[program].node) != 0)
        first++;
    (void)snprintf(out, ECU_SOCKET_MAX, "%s/%zu", changes->sockets, first);
}

/* ---- One change ------------------------------------------------------------------------------ */

/* Loads the text as it is now. Returns what is wrong, or NULL. */
static const char *ecu_text_load(change *c)
{
    const char *wrong = "it is no configuration";
    diag *errors = arena_alloc(c->memory, sizeof *errors);
    if (!errors || c->text->no_memory)
        return NO_MEMORY;
    if (yaml_text_load(&c->document, buffer_first(c->text), buffer_length(c->text),
                       &yaml_file_limits, errors))
        wrong = NULL;
    diag_flush(errors, NULL);
    return wrong;
}

/* Replaces what is at the place by a value in JSON. */
static void apply(buffer *text, const splice_place *place, const char *value)
{
    buffer changed = {.data = NULL};
    const char *all = buffer_first(text);
    const size_t size = buffer_length(text);
    (void)buffer_append(&changed, all, place->begin);
    buffer_put(&changed, place->before);
    buffer_put(&changed, value);
    buffer_put(&changed, place->after);
    (void)buffer_append(&changed, all + place->end, size - place->end);
    buffer_free(text);
    *text = changed;
}

/* Sets the value at a path to one in JSON. */
static const char *set_json(change *c, const char *path, const char *value)
{
    const char *rule;
    splice_place place;
    const char *wrong = ecu_text_load(c);
    if (wrong)
        return wrong;
    const splice_text t = {.text = buffer_first(c->text),
                           .size = buffer_length(c->text), .document = &c->document,
                           .memory = c->memory};
    wrong = path && value ? splice_find(&place, &t, path, &rule) : NO_MEMORY;
    if (!wrong)
        apply(c->text, &place, value);
    yaml_document_delete(&c->document);
    return wrong && path ? arena_print(c->memory, "%s: %s", path, wrong) : wrong;
}

/* Sets the value at a path to a text. */
static const char *ecu_text_set(change *c, const char *path, const char *text)
{
    buffer quoted = {.no_memory = !text};
    jsontext_quoted(&quoted, text ? text : "");
    return set_json(c, path, jsontext_keep(&quoted, c->memory));
}

/* ---- Time ------------------------------------------------------------------------------------ */

/* Lets the programs move time, which begins when all are there. */
static const char *set_time(change *c)
{
    const unsigned programs = ecus_virtual(c->wanted->plan);
    const uint64_t until_ns = c->wanted->until_ns;
    const char *wrong = ecu_text_set(c, "pacing", "virtual");
    buffer value = {.data = NULL};
    char until[32];
    if (wrong)
        return wrong;
    (void)snprintf(until, sizeof until, "%" PRIu64 "ns", until_ns);
    jsontext_item(&value, "{");
    jsontext_number(&value, "programs", programs);
    if (until_ns != UINT64_MAX)
        jsontext_string(&value, "until", until);
    buffer_put(&value, "}");
    return set_json(c, "virtual", jsontext_keep(&value, c->memory));
}

/* ---- Ports ----------------------------------------------------------------------------------- */

/* Returns item i of a list; NULL: it has fewer, or there is no list. */
static yaml_node_t *item_of(schema *self, const yaml_node_t *list, size_t i)
{
    if (!list || list->type != YAML_SEQUENCE_NODE ||
        i >= (size_t)(list->data.sequence.items.top - list->data.sequence.items.start))
        return NULL;
    return yaml_document_get_node(self->document, list->data.sequence.items.start[i]);
}

/* Returns a key of a map, or NULL. */
static yaml_node_t *ecu_text_value_of(schema *self, const yaml_node_t *map, const char *key)
{
    return map && map->type == YAML_MAPPING_NODE ? schema_find(self, map, key) : NULL;
}

static const char *ecu_text_text_of(const yaml_node_t *value)
{
    return value && value->type == YAML_SCALAR_NODE ? (const char *)value->data.scalar.value
                                                    : NULL;
}

/* Returns the number of a node in the text, SIZE_MAX: there is none. Names may have characters that
 * paths have not. */
static size_t ecu_text_find_node(change *c, const char *name)
{
    schema self = {.document = &c->document};
    const yaml_node_t *item;
    size_t found = SIZE_MAX;
    if (ecu_text_load(c))
        return SIZE_MAX;
    const yaml_node_t *nodes =
        ecu_text_value_of(&self, yaml_document_get_root_node(&c->document), "nodes");
    for (size_t i = 0; (item = item_of(&self, nodes, i)) && found == SIZE_MAX; i++) {
        const char *text = ecu_text_text_of(ecu_text_value_of(&self, item, "name"));
        if (text && strcmp(text, name) == 0)
            found = i;
    }
    yaml_document_delete(&c->document);
    return found;
}

/* Returns the path of a socket from the folder of the row on. */
static const char *from_row(const change *c, const char *socket)
{
    return arena_print(c->memory, ECU_SOCKETS "%s", socket + strlen(c->wanted->sockets));
}

/* Puts the socket of a program into the port of its node. */
static const char *set_port(change *c, size_t program)
{
    char socket[ECU_SOCKET_MAX];
    const char *node = c->wanted->plan->list[program].node;
    const size_t number = ecu_text_find_node(c, node);
    if (number == SIZE_MAX)
        return arena_print(c->memory, "there is no node '%s'", node);
    ecu_port_path(socket, c->wanted, program);
    const char *path = from_row(c, socket);
    return ecu_text_set(c, arena_print(c->memory, "nodes[%zu].port", number),
                        path ? arena_print(c->memory, "unix:%s", path) : NULL);
}

/* ---- Files ----------------------------------------------------------------------------------- */

/* A file that the text names by a relative path. */
typedef struct found_file {
    const char *path; /* of the value in the text; NULL: there is none */
    const char *file;
} found_file;

/* Keeps the name of a file that is relative: from the folder of a row it would lead elsewhere. */
static bool is_relative(found_file *found, const yaml_node_t *value)
{
    const char *text = ecu_text_text_of(value);
    if (text && *text && *text != '/')
        found->file = text;
    return found->file;
}

/* Finds the first profile with a relative path, which has an absolute one the next time. */
static void find_profile(change *c, schema *self, const yaml_node_t *root, found_file *found)
{
    const yaml_node_t *item;
    const yaml_node_t *profiles = ecu_text_value_of(self, root, "profiles");
    for (size_t i = 0; !found->file && (item = item_of(self, profiles, i)); i++)
        if (is_relative(found, ecu_text_value_of(self, item, "file")))
            found->path = arena_print(c->memory, "profiles[%zu].file", i);
}

/* Finds the first log to be replayed with a relative path, at any node. */
static void find_replay(change *c, schema *self, const yaml_node_t *root, found_file *found)
{
    const yaml_node_t *node;
    const yaml_node_t *item;
    const yaml_node_t *nodes = ecu_text_value_of(self, root, "nodes");
    for (size_t i = 0; (node = item_of(self, nodes, i)); i++) {
        const yaml_node_t *traffic = ecu_text_value_of(self, node, "traffic");
        for (size_t k = 0; !found->file && (item = item_of(self, traffic, k)); k++)
            if (is_relative(found, ecu_text_value_of(self, item, "replay")))
                found->path = arena_print(c->memory, "nodes[%zu].traffic[%zu].replay", i, k);
    }
}

/* Makes the next relative path absolute. *done: there was none. */
static const char *set_next_file(change *c, bool *done)
{
    schema self = {.document = &c->document};
    found_file found = {.path = NULL};
    const char *wrong = ecu_text_load(c);
    if (wrong)
        return wrong;
    const yaml_node_t *root = yaml_document_get_root_node(&c->document);
    find_profile(c, &self, root, &found);
    if (!found.file)
        find_replay(c, &self, root, &found);
    *done = !found.file;
    const char *whole =
        found.file ? arena_print(c->memory, "%s/%s", c->wanted->directory, found.file) : NULL;
    yaml_document_delete(&c->document);
    return *done ? NULL : ecu_text_set(c, found.path, whole);
}

const char *ecu_text_change(buffer *text, const ecu_changes *changes, arena *memory)
{
    change c = {.text = text, .memory = memory, .wanted = changes};
    const char *wrong = NULL;
    bool done = false;
    const bool own = changes->plan->own_bus;
    for (size_t i = 0; i < changes->plan->count && !own && !wrong; i++)
        wrong = set_port(&c, i);
    if (!wrong && !own)
        wrong = ecu_text_set(&c, "control", from_row(&c, changes->control));
    if (!wrong && changes->plan->virtual_time)
        wrong = set_time(&c);
    for (unsigned i = 0; i < FILES_MAX && !done && !wrong; i++)
        wrong = set_next_file(&c, &done);
    return wrong;
}
