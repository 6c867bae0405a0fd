/* SPDX-License-Identifier: MIT
 *
 * names.c - names that factors bring into the scenario: those of rules, and of keys.
 */
#include "campaign/space/names.h"

#include "base/text/memo.h"
#include "campaign/space/variant.h"
#include "config/rig.h"

#include <stdlib.h>
#include <string.h>

/* ---- Rules ----------------------------------------------------------------------------------- */

static bool has_rule(const cfg *config, const char *name)
{
    for (size_t i = 0; i < config->rule_count; i++)
        if (strcmp(config->rules[i].name, name) == 0)
            return true;
    return false;
}

/* Returns the name of an earlier factor with a rule of that name, or NULL. */
static const char *find_space(const campaign *c, size_t before, const char *name)
{
    for (size_t i = 0; i < before; i++)
        for (unsigned k = 0; k < 2 && c->factors[i].rules; k++)
            if (c->factors[i].rule_names[k] && strcmp(c->factors[i].rule_names[k], name) == 0)
                return c->factors[i].name;
    return NULL;
}

/* The rule of a space is added to those of the scenario, so its name must be new. */
static void check_rule(schema *self, const yaml_node_t *item, const campaign_owner *o, size_t index,
                       const char *name)
{
    const char *other = find_space(&o->campaign, index, name);
    if (has_rule(o->config, name))
        schema_complain(self, item, "the scenario has a rule '%s'; this space of faults needs "
                        "another 'name'", name);
    else if (other)
        schema_complain(self, item, "'%s' has a rule '%s', too; this space of faults needs another "
                        "'name'", other, name);
}

void names_check_rules(schema *self, yaml_node_t *list, const campaign_owner *o)
{
    const campaign *c = &o->campaign;
    for (size_t i = 0; i < c->factor_count && o->config; i++)
        for (unsigned k = 0; k < 2 && c->factors[i].rules; k++)
            if (c->factors[i].rule_names[k])
                check_rule(self, schema_item(self, list, i), o, i, c->factors[i].rule_names[k]);
}

/* ---- Keys ------------------------------------------------------------------------------------ */

/* Returns the messages about the scenario of row 0, to be freed; NULL: without memory. */
static char *messages_of_row(const campaign *c)
{
    memo messages;
    choice choices[CAMPAIGN_FACTORS_MAX];
    buffer text = {.data = NULL};
    rig *several;
    cfg *alone;
    if (!memo_begin(&messages))
        return NULL;
    sample_choose(choices, c, 0);
    variant_text(&text, c, choices);
    const cfg_file file = {.name = c->scenario_name, .text = buffer_first(&text),
                           .size = buffer_length(&text)};
    (void)rig_load_either(&several, &alone, &file, messages.out);
    rig_free(several);
    cfg_free(alone);
    buffer_free(&text);
    return memo_take(&messages);
}

/* Returns true when a factor puts a key in. */
static bool is_new_key(const factor *f)
{
    return !f->rules && f->edit.before && f->edit.begin == f->edit.end && f->edit.after[0];
}

/* Complains about a key that the messages call unknown. */
static void check_key(schema *self, const yaml_node_t *item, const factor *f, const char *messages)
{
    const int length = (int)strcspn(f->edit.before, ":");
    const char *words = schema_print(self, "unknown key '%.*s'", length, f->edit.before);
    const char *at = words ? strstr(messages, words) : NULL;
    if (at)
        schema_complain(self, item, "set: '%s': %.*s", f->path, (int)strcspn(at, "\n"), at);
}

void names_check_keys(schema *self, yaml_node_t *list, const campaign_owner *o)
{
    const campaign *c = &o->campaign;
    size_t count = 0;
    for (size_t i = 0; i < c->factor_count; i++)
        count += is_new_key(&c->factors[i]);
    char *messages = count > 0 ? messages_of_row(c) : NULL;
    if (count > 0 && !messages)
        schema_complain(self, list, "out of memory");
    for (size_t i = 0; i < c->factor_count && messages; i++)
        if (is_new_key(&c->factors[i]))
            check_key(self, schema_item(self, list, i), &c->factors[i], messages);
    free(messages);
}
