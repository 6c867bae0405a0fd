/* SPDX-License-Identifier: MIT
 *
 * ends.c - scenarios without an end, which are found before any row runs.
 */
#include "campaign/ends.h"

#include <string.h>

void ends_note(campaign_owner *o, schema *self, const cfg *config, bool inside)
{
    cfg_unending found;
    if (o->unending || !cfg_find_unending(config, &found))
        return;
    o->unending = schema_print(self, "%s:%d:%d: %s never ends: give `until` in the campaign",
                               found.file, found.place.line, found.place.column, found.what);
    o->unending_at = found.place;
    o->unending_inside = inside;
    o->unending_rule = found.is_rule;
}

static bool is_before(const yaml_mark_t *mark, const cfg_place *place)
{
    const size_t line = (size_t)place->line - 1;
    return mark->line < line ||
           (mark->line == line && mark->column < (size_t)place->column);
}

/* Returns the node of the bus that a place is in, or NULL. */
static const yaml_node_t *find_item(campaign_owner *o, const cfg_place *place)
{
    schema self = {.document = &o->document};
    yaml_node_t *root = yaml_document_get_root_node(&o->document);
    yaml_node_t *nodes = schema_find(&self, root, "nodes");
    const yaml_node_t *found = NULL;
    if (!nodes || nodes->type != YAML_SEQUENCE_NODE)
        return NULL;
    const size_t count =
        (size_t)(nodes->data.sequence.items.top - nodes->data.sequence.items.start);
    for (size_t i = 0; i < count; i++) {
        const yaml_node_t *item = schema_item(&self, nodes, i);
        if (is_before(&item->start_mark, place))
            found = item;
    }
    return found;
}

/* Returns true when a factor may change a node of the bus, or replace it. */
static bool touches(const campaign *c, const factor *f, const yaml_node_t *item)
{
    const size_t begin = splice_offset(c->text, c->size, item->start_mark.index);
    const size_t end = splice_offset(c->text, c->size, item->end_mark.index);
    return f->edit.before && f->edit.begin <= end && f->edit.end >= begin;
}

static bool begins_with(const char *path, const char *key)
{
    return strncmp(path, key, strlen(key)) == 0;
}

/* A bus in a file of its own is changed by the name of this file alone. A rule may stand in a
 * profile, whose parameters may end it: each row is asked again. */
static bool may_change(campaign_owner *o, const factor *f)
{
    if (f->rules || !f->path)
        return f->rules && o->unending_rule;
    if (!o->unending_inside)
        return begins_with(f->path, "buses");
    if (o->unending_rule)
        return begins_with(f->path, "faults") || begins_with(f->path, "profiles");
    const yaml_node_t *item = find_item(o, &o->unending_at);
    return !item || touches(&o->campaign, f, item);
}

void ends_check(schema *self, const yaml_node_t *root, campaign_owner *o)
{
    const campaign *c = &o->campaign;
    if (!o->unending || c->until || c->ecus.count > 0)
        return;
    for (size_t i = 0; i < c->factor_count; i++)
        if (may_change(o, &c->factors[i]))
            return;
    const yaml_node_t *scenario = schema_find(self, root, "scenario");
    schema_complain_elsewhere(self, scenario ? scenario : root, o->unending);
}
