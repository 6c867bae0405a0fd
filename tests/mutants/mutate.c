/* SPDX-License-Identifier: MIT
 *
 * mutate.c - texts that are a YAML text without one of its lines, keys or items.
 */
#include "mutants.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <yaml.h>

typedef struct buffer {
    char *bytes;
    size_t size;
} buffer;

static void each_line(const char *text, size_t size, mutant_taker *take, void *user)
{
    char what[WHAT_BYTES];
    char *mutant = malloc(size + 1);
    unsigned line = 1;
    for (size_t begin = 0; mutant && begin < size; line++) {
        const char *newline = memchr(text + begin, '\n', size - begin);
        size_t end = newline ? (size_t)(newline - text) + 1 : size;
        memcpy(mutant, text, begin);
        memcpy(mutant + begin, text + end, size - end);
        (void)snprintf(what, sizeof what, "without line %u", line);
        take(user, mutant, size - (end - begin), what);
        begin = end;
    }
    free(mutant);
}

static bool load(yaml_document_t *document, const char *text, size_t size)
{
    yaml_parser_t parser;
    if (!yaml_parser_initialize(&parser))
        fail("out of memory", "");
    yaml_parser_set_input_string(&parser, (const unsigned char *)text, size);
    bool good = yaml_parser_load(&parser, document);
    yaml_parser_delete(&parser);
    return good;
}

static int append(void *user, unsigned char *bytes, size_t size)
{
    buffer *b = user;
    char *longer = realloc(b->bytes, b->size + size + 1);
    if (!longer)
        return 0;
    memcpy(longer + b->size, bytes, size);
    b->bytes = longer;
    b->size += size;
    return 1;
}

/* Frees the document, too. */
static void print(buffer *out, yaml_document_t *document)
{
    yaml_emitter_t emitter;
    if (!yaml_emitter_initialize(&emitter))
        fail("out of memory", "");
    yaml_emitter_set_output(&emitter, append, out);
    yaml_emitter_set_unicode(&emitter, 1);
    if (!yaml_emitter_open(&emitter) || !yaml_emitter_dump(&emitter, document) ||
        !yaml_emitter_close(&emitter))
        fail("a document cannot be written", "");
    yaml_emitter_delete(&emitter);
}

static const char *text_of(yaml_document_t *document, int node)
{
    const yaml_node_t *found = yaml_document_get_node(document, node);
    return found->type == YAML_SCALAR_NODE ? (const char *)found->data.scalar.value : "?";
}

static void remove_pair(yaml_document_t *document, yaml_node_t *map, size_t i,
                        char what[WHAT_BYTES])
{
    yaml_node_pair_t *pair = map->data.mapping.pairs.start + i;
    (void)snprintf(what, WHAT_BYTES, "without the key '%.40s' of the map in line %zu",
                   text_of(document, pair->key), map->start_mark.line + 1);
    for (; pair + 1 < map->data.mapping.pairs.top; pair++)
        pair[0] = pair[1];
    map->data.mapping.pairs.top--;
}

static void remove_item(yaml_node_t *list, size_t i, char what[WHAT_BYTES])
{
    yaml_node_item_t *item = list->data.sequence.items.start + i;
    (void)snprintf(what, WHAT_BYTES, "without item %zu of the list in line %zu", i + 1,
                   list->start_mark.line + 1);
    for (; item + 1 < list->data.sequence.items.top; item++)
        item[0] = item[1];
    list->data.sequence.items.top--;
}

/* Takes element number n away, in the order of the text. False: there are not so many. */
static bool remove_element(yaml_document_t *document, size_t n, char what[WHAT_BYTES])
{
    for (yaml_node_t *node = document->nodes.start; node < document->nodes.top; node++) {
        bool map = node->type == YAML_MAPPING_NODE;
        bool list = node->type == YAML_SEQUENCE_NODE;
        size_t count = 0;
        if (map)
            count = (size_t)(node->data.mapping.pairs.top - node->data.mapping.pairs.start);
        else if (list)
            count = (size_t)(node->data.sequence.items.top - node->data.sequence.items.start);
        if (n >= count) {
            n -= count;
            continue;
        }
        if (map)
            remove_pair(document, node, n, what);
        else
            remove_item(node, n, what);
        return true;
    }
    return false;
}

static void each_element(const char *text, size_t size, mutant_taker *take, void *user)
{
    char what[WHAT_BYTES];
    yaml_document_t document;
    size_t n = 0;
    if (!load(&document, text, size))
        fail("a file cannot be loaded", text);
    while (remove_element(&document, n++, what)) {
        buffer out = {.bytes = NULL};
        print(&out, &document);
        take(user, out.bytes, out.size, what);
        free(out.bytes);
        if (!load(&document, text, size))
            fail("a file cannot be loaded", text);
    }
    yaml_document_delete(&document);
}

void mutants_of(const char *text, size_t size, mutant_taker *take, void *user)
{
    each_line(text, size, take, user);
    each_element(text, size, take, user);
}
