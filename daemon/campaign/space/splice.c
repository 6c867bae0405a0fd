/* SPDX-License-Identifier: MIT
 *
 * splice.c - puts other values into the text of a configuration, which keeps all else as it is.
 */
#include "campaign/space/splice.h"

#include "base/text/number.h"
#include "campaign/space/valuepath.h"

#include <string.h>

#define NO_MEMORY "out of memory"

/* ---- Places ---------------------------------------------------------------------------------- */

size_t splice_offset(const char *text, size_t size, size_t character)
{
    size_t at = size >= 3 && memcmp(text, "\xEF\xBB\xBF", 3) == 0 ? 3 : 0;
    for (; at < size && character > 0; character--)
        for (at++; at < size && (text[at] & 0xC0) == 0x80; at++)
            continue;
    return at;
}

static size_t offset_of(const splice_text *t, const yaml_mark_t *mark)
{
    return splice_offset(t->text, t->size, mark->index);
}

/* Returns the end of a line of a block, and the blanks before what follows. */
static const char *next_line(const splice_text *t, const yaml_mark_t *mark)
{
    return arena_print(t->memory, "\n%*s", (int)mark->column, "");
}

static bool is_first_of_line(const splice_text *t, size_t at)
{
    while (at > 0 && t->text[at - 1] == ' ')
        at--;
    return at == 0 || t->text[at - 1] == '\n';
}

/* Replaces a value. A block ends at the next line, whose blanks belong to it; they stay. */
static const char *replace(splice_place *out, const splice_text *t, const yaml_node_t *value)
{
    *out = (splice_place){.begin = offset_of(t, &value->start_mark),
                    .end = offset_of(t, &value->end_mark),
                    .before = "",
                    .after = ""};
    while (out->end > out->begin && strchr(" \t\r\n", t->text[out->end - 1]))
        out->end--;
    /* `key:` without a value, or a block that is perhaps not further right than its key */
    if (out->begin == out->end || is_first_of_line(t, out->begin))
        out->before = " ";
    return NULL;
}

/* Inserts a key in front of the others of a map. */
static const char *splice_insert(splice_place *out, const splice_text *t, yaml_node_t *map,
                                 const char *key)
{
    yaml_node_t *value;
    const yaml_node_t *first = NULL;
    schema self = {.document = t->document};
    const bool flow = map->data.mapping.style == YAML_FLOW_MAPPING_STYLE;
    first = schema_pair(&self, &value, map, 0);
    out->begin = first ? offset_of(t, &first->start_mark) : offset_of(t, &map->start_mark) + 1;
    out->end = out->begin;
    out->before = arena_print(t->memory, "%s: ", key);
    out->after = flow ? ", " : next_line(t, first ? &first->start_mark : &map->start_mark);
    return out->before && out->after ? NULL : NO_MEMORY;
}

/* ---- Paths ----------------------------------------------------------------------------------- */

/* Returns an item of a list by its name, or NULL. */
static yaml_node_t *find_named(schema *self, const yaml_node_t *list, const char *name)
{
    for (yaml_node_item_t *i = list->data.sequence.items.start;
         i < list->data.sequence.items.top; i++) {
        yaml_node_t *item = yaml_document_get_node(self->document, *i);
        const yaml_node_t *found =
            item->type == YAML_MAPPING_NODE ? schema_find(self, item, "name") : NULL;
        if (found && found->type == YAML_SCALAR_NODE &&
            strcmp((const char *)found->data.scalar.value, name) == 0)
            return item;
    }
    return NULL;
}

/* Returns an item of a list by its number from 0 on, or NULL. */
static yaml_node_t *find_numbered(const schema *self, const yaml_node_t *list, const char *digits)
{
    uint64_t number;
    const size_t count =
        (size_t)(list->data.sequence.items.top - list->data.sequence.items.start);
    if (text_parse_uint(&number, digits) || number >= count)
        return NULL;
    return yaml_document_get_node(self->document, list->data.sequence.items.start[number]);
}

/* Returns the name of an item, or NULL. */
static const char *splice_name_of(schema *self, yaml_node_t *item)
{
    const yaml_node_t *name =
        item && item->type == YAML_MAPPING_NODE ? schema_find(self, item, "name") : NULL;
    return name && name->type == YAML_SCALAR_NODE ? (const char *)name->data.scalar.value : NULL;
}

/* Returns how many places name a node; an alias names it once more. */
static size_t count_places(const schema *self, const yaml_node_t *node)
{
    const int number = (int)(node - self->document->nodes.start) + 1;
    size_t count = 0;
    for (const yaml_node_t *n = self->document->nodes.start; n < self->document->nodes.top; n++) {
        if (n->type == YAML_SEQUENCE_NODE)
            for (yaml_node_item_t *i = n->data.sequence.items.start;
                 i < n->data.sequence.items.top; i++)
                count += *i == number;
        if (n->type == YAML_MAPPING_NODE)
            for (yaml_node_pair_t *i = n->data.mapping.pairs.start;
                 i < n->data.mapping.pairs.top; i++)
                count += (size_t)(i->key == number) + (size_t)(i->value == number);
    }
    return count;
}

/* Goes down by one part. Returns NULL where there is nothing. */
static yaml_node_t *step_down(schema *self, yaml_node_t *node, const valuepath_part *p)
{
    if (node->type == YAML_MAPPING_NODE && !p->number)
        return schema_find(self, node, p->text);
    if (node->type != YAML_SEQUENCE_NODE)
        return NULL;
    return p->number ? find_numbered(self, node, p->text) : find_named(self, node, p->text);
}

/* Goes down a path in the document to the place of its value. *rule becomes the name of the rule on
 * the way, if only that varies. Returns what is wrong, or NULL. */
static const char *walk(splice_place *out, const splice_text *t, const char *rest,
                        const char **rule)
{
    schema self = {.document = t->document};
    yaml_node_t *node = yaml_document_get_root_node(t->document);
    valuepath_part p = {.last = false};
    bool in_faults = false;
    for (unsigned depth = 0; !p.last; depth++) {
        valuepath_take(&rest, &p);
        yaml_node_t *next = step_down(&self, node, &p);
        if (depth == 1 && in_faults && !p.last)
            *rule = splice_name_of(&self, next);
        if (*rule && strcmp(p.text, "name") == 0)
            *rule = NULL; /* the rule gets another name */
        if (!next && p.last && node->type == YAML_MAPPING_NODE && !p.number)
            return splice_insert(out, t, node, p.text);
        if (!next)
            return arena_print(t->memory, "the scenario has no '%s' there", p.text);
        if (count_places(&self, next) > 1)
            return arena_print(t->memory, "'%s' is shared by an alias", p.text);
        in_faults = depth == 0 && strcmp(p.text, "faults") == 0;
        node = next;
    }
    return replace(out, t, node);
}

const char *splice_find(splice_place *out, const splice_text *t, const char *path,
                        const char **rule)
{
    *rule = NULL;
    const char *wrong = valuepath_check(t->memory, path);
    if (!wrong)
        wrong = walk(out, t, path, rule);
    if (*rule)
        *rule = arena_print(t->memory, "%s", *rule);
    return wrong;
}

const char *splice_find_rules(splice_place *out, const splice_text *t, bool first, bool last)
{
    schema self = {.document = t->document};
    yaml_node_t *root = yaml_document_get_root_node(t->document);
    const yaml_node_t *faults = schema_find(&self, root, "faults");
    if (!faults) {
        const char *wrong = splice_insert(out, t, root, "faults");
        if (wrong)
            return wrong;
        out->before = first ? "faults: [" : "";
        out->between = ", ";
        out->after = last ? arena_print(t->memory, "]%s", out->after) : ", ";
        return out->after ? NULL : NO_MEMORY;
    }
    if (faults->type != YAML_SEQUENCE_NODE)
        return "'faults' is no list";
    const bool flow = faults->data.sequence.style == YAML_FLOW_SEQUENCE_STYLE;
    out->begin = offset_of(t, &faults->start_mark) + (flow ? 1 : 0);
    out->end = out->begin;
    out->before = flow ? "" : "- ";
    out->after = flow ? ", " : next_line(t, &faults->start_mark);
    out->between = flow ? ", " : arena_print(t->memory, "%s- ", out->after ? out->after : "");
    return out->after && out->between ? NULL : NO_MEMORY;
}
