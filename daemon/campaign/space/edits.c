/* SPDX-License-Identifier: MIT
 *
 * edits.c - where the values of factors go in the text of the scenario.
 */
#include "campaign/space/edits.h"

#include "campaign/space/variant.h"

#include <string.h>

/* Finds the places of the rules of spaces, which come together. */
static void place_spaces(schema *self, const yaml_node_t *list, campaign_owner *o)
{
    campaign *c = &o->campaign;
    const splice_text t = {.text = c->text, .size = c->size, .document = &o->document,
                           .memory = self->arena};
    size_t count = 0;
    size_t placed = 0;
    for (size_t i = 0; i < c->factor_count; i++)
        count += c->factors[i].rules != NULL;
    for (size_t i = 0; i < c->factor_count; i++) {
        if (!c->factors[i].rules)
            continue;
        const char *wrong =
            splice_find_rules(&c->factors[i].edit, &t, placed == 0, placed + 1 == count);
        if (wrong)
            schema_complain(self, list, "%s", wrong);
        placed++;
    }
}

/* Returns true when two factors put the same key in. */
static bool is_same_key(const factor *a, const factor *b)
{
    const size_t length = strcspn(a->edit.before, ":");
    return !(a->rules && b->rules) && length == strcspn(b->edit.before, ":") &&
           strncmp(a->edit.before, b->edit.before, length) == 0;
}

/* Complains about two edits of the text, the first of which comes before the other one. */
static void check_edits(schema *self, yaml_node_t *list, const campaign *c, size_t first,
                        size_t second)
{
    const factor *a = &c->factors[first];
    const factor *b = &c->factors[second];
    const yaml_node_t *last = schema_item(self, list, first > second ? first : second);
    if (b->edit.begin < a->edit.end)
        schema_complain(self, last, "'%s' is part of what '%s' varies", b->name, a->name);
    else if (a->edit.begin == b->edit.begin && b->edit.begin < b->edit.end)
        schema_complain(self, last, "'%s' is part of what '%s' varies", a->name, b->name);
    else if (a->edit.begin == b->edit.begin && is_same_key(a, b))
        schema_complain(self, last, "'%s' and '%s' vary the same", a->name, b->name);
}

/* Compares each edit with all before it: one that is put in at the same place may be between. */
static void check_all_edits(schema *self, yaml_node_t *list, const campaign *c)
{
    size_t order[CAMPAIGN_FACTORS_MAX];
    size_t count = 0;
    uint64_t done = 0;
    for (size_t i; (i = variant_next_edit(c, done)) != SIZE_MAX; done |= UINT64_C(1) << i) {
        for (size_t k = 0; k < count; k++)
            check_edits(self, list, c, order[k], i);
        order[count++] = i;
    }
}

void campaign_place_edits(schema *self, yaml_node_t *list, campaign_owner *o)
{
    place_spaces(self, list, o);
    check_all_edits(self, list, &o->campaign);
}
