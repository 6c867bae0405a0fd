/* SPDX-License-Identifier: MIT
 *
 * outline.c - a scenario of which items of lists are left out: rules, traffic, expectations,
 * gateways. It is a bus or a rig.
 */
#include "campaign/report/outline.h"

#include "base/text/buffer.h"
#include "base/text/yamlfile.h"
#include "campaign/report/memory.h"

#include <stdlib.h>
#include <string.h>

#define LEVELS_MAX 64u
#define COLUMNS 100
#define TEXT_MAX (16u << 20) /* bytes; aliases may make a text long */

/* ---- Loading --------------------------------------------------------------------------------- */

static bool is_word(const yaml_node_t *node, const char *word)
{
    return node && node->type == YAML_SCALAR_NODE &&
           strcmp((const char *)node->data.scalar.value, word) == 0;
}

/* Returns the value of a key of a map, or NULL. */
static yaml_node_t *outline_find(outline *o, const yaml_node_t *map, const char *key)
{
    if (!map || map->type != YAML_MAPPING_NODE)
        return NULL;
    for (const yaml_node_pair_t *p = map->data.mapping.pairs.start;
         p < map->data.mapping.pairs.top; p++)
        if (is_word(yaml_document_get_node(&o->document, p->key), key))
            return yaml_document_get_node(&o->document, p->value);
    return NULL;
}

static bool is_list(const yaml_node_t *node)
{
    return node && node->type == YAML_SEQUENCE_NODE;
}

static void add_list(outline *o, const yaml_node_t *node, outline_kind kind, size_t owner)
{
    if (is_list(node) && o->list_count < OUTLINE_LISTS_MAX)
        o->lists[o->list_count++] =
            (outline_list){.kind = kind, .node = node, .owner = owner};
}

/* Adds a list of each item of a list. */
static void add_inner_lists(outline *o, const yaml_node_t *outer, const char *key,
                            outline_kind kind)
{
    for (size_t i = 0; is_list(outer); i++) {
        const size_t item = outline_item(&(outline_list){.node = outer}, i);
        if (item == 0)
            break;
        add_list(o, outline_find(o, yaml_document_get_node(&o->document, (int)item), key), kind,
                 item);
    }
}

/* Finds the lists of a configuration from which items may go. */
static void find_lists(outline *o, const yaml_node_t *root)
{
    add_list(o, outline_find(o, root, "faults"), OUTLINE_FAULTS, 0);
    add_list(o, outline_find(o, root, "profiles"), OUTLINE_FAULTS, 0);
    add_inner_lists(o, outline_find(o, root, "nodes"), "traffic", OUTLINE_TRAFFIC);
    add_list(o, outline_find(o, root, "expect"), OUTLINE_EXPECT, 0);
}

/* Finds the lists of a rig: gateways, the rules of each, and buses. Whole gateways go first. */
static void find_lists_of_rig(outline *o, const yaml_node_t *root)
{
    const yaml_node_t *gateways = outline_find(o, root, "gateways");
    add_list(o, gateways, OUTLINE_GATEWAYS, 0);
    add_inner_lists(o, gateways, "rules", OUTLINE_GATEWAYS);
    add_list(o, outline_find(o, root, "buses"), OUTLINE_BUSES, 0);
}

bool outline_load(outline *o, const char *text, size_t size)
{
    diag found = {.file.name = ""};
    *o = (outline){.loaded = false};
    o->loaded = yaml_text_load(&o->document, text, size, &yaml_file_limits, &found);
    diag_flush(&found, NULL);
    if (!o->loaded)
        return false;
    o->nodes = (size_t)(o->document.nodes.top - o->document.nodes.start);
    o->left_out = memory_list(NULL, o->nodes + 1, sizeof *o->left_out);
    memset(o->left_out, 0, (o->nodes + 1) * sizeof *o->left_out);
    o->renamed = memory_list(NULL, o->nodes + 1, sizeof *o->renamed);
    memset(o->renamed, 0, (o->nodes + 1) * sizeof *o->renamed);
    const yaml_node_t *root = yaml_document_get_root_node(&o->document);
    o->is_rig = is_list(outline_find(o, root, "buses"));
    if (o->is_rig)
        find_lists_of_rig(o, root);
    else
        find_lists(o, root);
    return o->is_rig || outline_find(o, root, "bus") != NULL;
}

void outline_free(outline *o)
{
    if (o->loaded)
        yaml_document_delete(&o->document);
    free(o->left_out);
    free(o->renamed);
    *o = (outline){.loaded = false};
}

/* ---- Items ----------------------------------------------------------------------------------- */

size_t outline_item(const outline_list *list, size_t i)
{
    const yaml_node_item_t *start = list->node->data.sequence.items.start;
    const size_t count = (size_t)(list->node->data.sequence.items.top - start);
    return i < count ? (size_t)start[i] : 0;
}

static size_t count_items(const outline *o, const outline_list *list)
{
    size_t count = 0;
    for (size_t i = 0, item; (item = outline_item(list, i)) != 0; i++)
        count += !o->left_out[item];
    return count;
}

const outline_list *outline_buses(const outline *o)
{
    for (size_t i = 0; i < o->list_count; i++)
        if (o->lists[i].kind == OUTLINE_BUSES)
            return &o->lists[i];
    return NULL;
}

bool outline_is_gone(const outline *o, const outline_list *list)
{
    return list->owner != 0 && o->left_out[list->owner];
}

size_t outline_count(const outline *o, outline_kind kind)
{
    size_t count = 0;
    for (size_t i = 0; i < o->list_count; i++)
        if (o->lists[i].kind == kind && !outline_is_gone(o, &o->lists[i]))
            count += count_items(o, &o->lists[i]);
    return count;
}

/* ---- Writing --------------------------------------------------------------------------------- */

/* A list or a map of which some items are written. */
typedef struct level {
    const yaml_node_t *node;
    size_t next;
} level;

typedef struct writer {
    outline *outline;
    bool without_faults;
    const char *folder;
    yaml_emitter_t emitter;
    buffer text;
    level levels[LEVELS_MAX];
    size_t depth;
    bool is_path; /* the next value is the name of a file */
    bool good;
} writer;

static int take_bytes(void *user, unsigned char *bytes, size_t count)
{
    writer *w = user;
    return buffer_length(&w->text) < TEXT_MAX &&
           buffer_append(&w->text, (const char *)bytes, count);
}

static void emit(writer *w, yaml_event_t *event, int made)
{
    w->good = w->good && made && yaml_emitter_emit(&w->emitter, event);
}

/* The root and its lists have lines of their own; all else is within one. */
static bool has_lines(const writer *w, const yaml_node_t *node)
{
    return w->depth == 0 || (w->depth == 1 && is_list(node));
}

/* Returns what stands for a text in another folder, to be freed; NULL: itself. */
static char *moved_text(const writer *w, const yaml_node_t *node)
{
    const char *value = (const char *)node->data.scalar.value;
    if (!w->folder)
        return NULL;
    const char *renamed = w->outline->renamed[node - w->outline->document.nodes.start + 1];
    if (renamed)
        return memory_text(renamed);
    return w->is_path && *value != '/' ? memory_print("%s/%s", w->folder, value) : NULL;
}

/* Writes a scalar in its own style, so that a quoted text stays quoted. For another folder, paths
 * change. */
static void begin_scalar(writer *w, const yaml_node_t *node)
{
    yaml_event_t event;
    char *path = moved_text(w, node);
    const char *text = path ? path : (const char *)node->data.scalar.value;
    emit(w, &event, yaml_scalar_event_initialize(&event, NULL, NULL, (yaml_char_t *)text,
                                                 (int)strlen(text), 1, 1,
                                                 node->data.scalar.style));
    free(path);
}

/* Begins to write a value. A list or map that was in lines is so again. */
static void begin_value(writer *w, const yaml_node_t *node)
{
    yaml_event_t event;
    if (node->type == YAML_SCALAR_NODE) {
        begin_scalar(w, node);
        return;
    }
    w->good = w->good && w->depth < LEVELS_MAX;
    if (!w->good)
        return;
    if (is_list(node))
        emit(w, &event, yaml_sequence_start_event_initialize(
                            &event, NULL, NULL, 1,
                            has_lines(w, node) ? YAML_BLOCK_SEQUENCE_STYLE
                                               : YAML_FLOW_SEQUENCE_STYLE));
    else
        emit(w, &event, yaml_mapping_start_event_initialize(
                            &event, NULL, NULL, 1,
                            has_lines(w, node) ? YAML_BLOCK_MAPPING_STYLE
                                               : YAML_FLOW_MAPPING_STYLE));
    w->levels[w->depth++] = (level){.node = node};
}

/* Returns true for a list of which nothing is to be written. */
static bool is_gone(const writer *w, const yaml_node_t *node)
{
    for (size_t i = 0; i < w->outline->list_count; i++) {
        const outline_list *list = &w->outline->lists[i];
        if (list->node == node)
            return (w->without_faults && list->kind == OUTLINE_FAULTS) ||
                   count_items(w->outline, list) == 0;
    }
    return false;
}

/* Returns the next item, or value of a map, whose key is written; NULL at the end. */
static const yaml_node_t *next_value(writer *w, level *l)
{
    yaml_document_t *document = &w->outline->document;
    for (size_t item; is_list(l->node);) {
        item = outline_item(&(outline_list){.node = l->node}, l->next++);
        if (item == 0 || !w->outline->left_out[item])
            return item == 0 ? NULL : yaml_document_get_node(document, (int)item);
    }
    const yaml_node_pair_t *pairs = l->node->data.mapping.pairs.start;
    while (pairs + l->next < l->node->data.mapping.pairs.top) {
        const yaml_node_pair_t *pair = &pairs[l->next++];
        const yaml_node_t *value = yaml_document_get_node(document, pair->value);
        const yaml_node_t *key = yaml_document_get_node(document, pair->key);
        if (is_gone(w, value))
            continue;
        w->is_path = false;
        begin_value(w, key);
        w->is_path = is_word(key, "replay") || is_word(key, "file");
        return value;
    }
    return NULL;
}

static void end_level(writer *w)
{
    yaml_event_t event;
    const bool list = is_list(w->levels[--w->depth].node);
    emit(w, &event, list ? yaml_sequence_end_event_initialize(&event)
                         : yaml_mapping_end_event_initialize(&event));
}

/* Writes the document without the items that have gone. It has its own stack: depth comes from
 * files. */
static void write_document(writer *w)
{
    yaml_event_t event;
    emit(w, &event, yaml_stream_start_event_initialize(&event, YAML_UTF8_ENCODING));
    emit(w, &event, yaml_document_start_event_initialize(&event, NULL, NULL, NULL, 1));
    begin_value(w, yaml_document_get_root_node(&w->outline->document));
    while (w->good && w->depth > 0) {
        const yaml_node_t *value = next_value(w, &w->levels[w->depth - 1]);
        if (value)
            begin_value(w, value);
        else
            end_level(w);
        w->is_path = value && w->is_path && value->type != YAML_SCALAR_NODE && is_list(value);
    }
    emit(w, &event, yaml_document_end_event_initialize(&event, 1));
    emit(w, &event, yaml_stream_end_event_initialize(&event));
}

char *outline_text(const outline *o, bool without_faults, const char *folder)
{
    char *text = NULL;
    writer *w = memory_list(NULL, 1, sizeof *w);
    *w = (writer){.outline = (outline *)o, .without_faults = without_faults, .folder = folder,
                  .good = true};
    if (yaml_emitter_initialize(&w->emitter)) {
        yaml_emitter_set_output(&w->emitter, take_bytes, w);
        yaml_emitter_set_width(&w->emitter, COLUMNS);
        yaml_emitter_set_unicode(&w->emitter, 1);
        write_document(w);
        if (w->good && buffer_append(&w->text, "", 1))
            text = memory_text(buffer_first(&w->text));
        yaml_emitter_delete(&w->emitter);
    }
    buffer_free(&w->text);
    free(w);
    return text;
}
