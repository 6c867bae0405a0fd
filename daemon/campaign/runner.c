/* SPDX-License-Identifier: MIT
 *
 * runner.c - runs the rows of a campaign, and writes them.
 */
#include "campaign/runner.h"

#include "base/text/jsontext.h"
#include "base/text/memo.h"
#include "campaign/loaded.h"
#include "campaign/shellword.h"
#include "campaign/tally.h"
#include "campaign/space/variant.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define NUMBER_MAX 32 /* bytes of " --only N" */
#define RULES_KEPT_MAX 131072u /* of all scenarios that are loaded */

struct runner {
    const campaign *campaign;
    bool reload;
    loaded_list loaded;    /* without room: none has been loaded */
    buffer key;
    buffer text;
    buffer repeat;
    uint64_t slot_factors; /* of all slots, as a set */
    size_t slot_count;
    rule_slot slots[CAMPAIGN_FACTORS_MAX]; /* without rules */
};

runner *runner_new(const campaign *c, bool reload)
{
    runner *r = calloc(1, sizeof *r);
    if (!r)
        return NULL;
    r->campaign = c;
    r->reload = reload;
    r->slot_count = reload ? 0 : rule_slot_find(r->slots, c);
    for (size_t i = 0; i < r->slot_count; i++)
        r->slot_factors |= r->slots[i].factors;
    return r;
}

void runner_free(runner *r)
{
    if (!r)
        return;
    loaded_clear(&r->loaded);
    buffer_free(&r->key);
    buffer_free(&r->text);
    buffer_free(&r->repeat);
    free(r);
}

/* ---- Loading --------------------------------------------------------------------------------- */

/* Reads the scenario with the values of a row. It must have an end. Messages may be NULL. */
static scenario *runner_load(runner *r, const choice *choices, FILE *messages)
{
    const campaign *c = r->campaign;
    buffer_clear(&r->text);
    variant_text(&r->text, c, choices);
    const cfg_file file = {.name = c->scenario_name, .text = buffer_first(&r->text),
                           .size = buffer_length(&r->text)};
    scenario *s = r->text.no_memory ? NULL : scenario_open(&file, messages);
    const char *wrong = s && c->until ? scenario_set_until(s, c->until_time) : NULL;
    if (wrong && messages)
        fprintf(messages, "%s: until: %s\n", c->file, wrong);
    if (s && !wrong && scenario_ends(s, "give `until` in the campaign", messages))
        return s;
    scenario_close(s);
    return NULL;
}

/* Decides by the first scenario how many are kept. */
static void find_room(runner *r, const scenario *s)
{
    uint64_t rules = 1;
    for (size_t i = 0; i < r->slot_count; i++)
        rules += r->slots[i].values;
    const uint64_t room = RULES_KEPT_MAX / rules / s->count;
    r->loaded.room = room < LOADED_MAX / s->count ? (size_t)room : LOADED_MAX / s->count;
    if (r->loaded.room == 0 || r->reload)
        r->loaded.room = 1;
}

/* Loads the scenario of the choices and keeps it under the key, with slots that have no rules
 * yet. */
static loaded *load_base(runner *r, const choice *choices)
{
    scenario *s = runner_load(r, choices, NULL);
    if (!s)
        return NULL;
    if (r->loaded.room == 0)
        find_room(r, s);
    return loaded_keep(&r->loaded, s, &r->key, r->slots, r->slot_count);
}

/* Binds the slots to the scenario, whose rules have the values of the choices. A rig has no
 * slots. */
static bool begin_slots(const runner *r, const loaded *l, const choice *choices)
{
    bool good = l->scenario->alone || l->slot_count == 0;
    for (size_t i = 0; i < l->slot_count && good; i++) {
        good = rule_slot_begin(&l->slots[i], l->scenario->alone);
        l->slots[i].shown = rule_slot_value(&l->slots[i], r->campaign, choices);
    }
    return good;
}

/* Writes the values of the factors that change more than a rule. */
static void write_key(runner *r, const choice *choices)
{
    const campaign *c = r->campaign;
    buffer_clear(&r->key);
    for (size_t i = 0; i < c->factor_count; i++) {
        if (c->factors[i].is_seed || (r->slot_factors >> i & 1))
            continue;
        sample_value(&r->key, &c->factors[i], &choices[i]);
        buffer_put(&r->key, "\n");
    }
}

/* Goes on without slots: each value of a factor then has a scenario of its own. */
static void forget_slots(runner *r)
{
    r->slot_count = 0;
    r->slot_factors = 0;
    loaded_clear(&r->loaded);
    r->loaded.room = 0;
}

/* Returns the scenario of the choices, perhaps with other values of its slots. From the first
 * scenario on that lacks a rule of a slot, there are no slots. */
static loaded *find_base(runner *r, const choice *choices)
{
    write_key(r, choices);
    loaded *l = r->reload ? NULL : loaded_find(&r->loaded, &r->key);
    if (l)
        return l;
    l = load_base(r, choices);
    if (!l || begin_slots(r, l, choices))
        return l;
    forget_slots(r);
    write_key(r, choices);
    return load_base(r, choices);
}

/* Copies the rules of a slot out of a configuration. */
static cw_rule *copy_rules(const rule_slot *slot, const cfg *config)
{
    cw_rule *rules = calloc(2, sizeof *rules);
    for (unsigned i = 0; i < 2 && slot->names[i] && rules; i++)
        rules[i] = config->rules[slot->index[i]];
    return rules;
}

/* Loads the rules of a slot with the values of these choices. */
static bool load_rules(runner *r, const scenario *base, rule_slot *slot, uint64_t value,
                       const choice *choices)
{
    scenario *s = runner_load(r, choices, NULL);
    const bool same = s && s->alone && s->alone->rule_count == base->alone->rule_count;
    if (same)
        slot->rules[value] = copy_rules(slot, s->alone);
    scenario_close(s);
    return same && slot->rules[value];
}

/* Puts the rules of a slot into the configuration, which keeps their names. */
static void runner_show(const rule_slot *slot, uint64_t value, const cfg *config)
{
    for (unsigned i = 0; i < 2 && slot->names[i]; i++) {
        cw_rule *rule = &config->rules[slot->index[i]];
        const char *name = rule->name;
        *rule = slot->rules[value][i];
        rule->name = name;
    }
}

/* Gives the rules in slots the values of the choices. Rules of a value are loaded once. */
static bool fill_slots(runner *r, const loaded *l, const choice *choices)
{
    for (size_t i = 0; i < l->slot_count; i++) {
        rule_slot *slot = &l->slots[i];
        const uint64_t value = rule_slot_value(slot, r->campaign, choices);
        if (value == slot->shown)
            continue;
        if (!slot->rules[value] && !load_rules(r, l->scenario, slot, value, choices))
            return false;
        runner_show(slot, value, l->scenario->alone);
        slot->shown = value;
    }
    return true;
}

/* ---- Rows ------------------------------------------------------------------------------------ */

/* Writes what is known before the row runs: number, values of the factors, seed. */
static void runner_write_head(runner *r, buffer *row, uint64_t number, const choice *choices)
{
    const campaign *c = r->campaign;
    uint64_t seed = c->scenario_seed;
    buffer_put(row, "{");
    jsontext_number(row, "number", number);
    jsontext_value(row, "factors", "{");
    for (size_t i = 0; i < c->factor_count; i++) {
        jsontext_key(row, c->factors[i].name);
        sample_value(row, &c->factors[i], &choices[i]);
    }
    buffer_put(row, "}");
    (void)variant_seed(&seed, c, choices);
    jsontext_number(row, "seed", seed);
}

void runner_begin(runner *r, uint64_t number, buffer *row)
{
    choice choices[CAMPAIGN_FACTORS_MAX];
    sample_choose(choices, r->campaign, number);
    runner_write_head(r, row, number, choices);
}

void runner_head(runner *r, uint64_t number, buffer *row)
{
    runner_begin(r, number, row);
    buffer_put(row, ",\"outcome\":\"");
}

/* Ends the row with the command that runs it alone. */
static void write_repeat(runner *r, buffer *row, uint64_t number)
{
    char option[NUMBER_MAX];
    const char *end = chars_decimal(chars_text(option, " --only "), number);
    shellword_begin(&r->repeat, "canwire campaign run", r->campaign->file);
    (void)buffer_append(&r->repeat, option, (size_t)(end - option));
    outcome_end_row(row, &r->repeat);
}

/* Loads a scenario that could not be loaded once more, for the message. One that can be loaded now
 * is not invalid. */
static outcome write_invalid(runner *r, buffer *row, const choice *choices)
{
    memo said;
    FILE *out = memo_begin(&said);
    scenario *s = out ? runner_load(r, choices, out) : NULL;
    const outcome o = outcome_write_invalid(row, s ? NULL : memo_text(&said));
    scenario_close(s);
    memo_end(&said);
    return o;
}

/* Runs the scenario of a row. The outcome of one that cannot be loaded is invalid. */
static outcome runner_run(runner *r, buffer *row, const choice *choices)
{
    uint64_t seed;
    const bool varies = variant_seed(&seed, r->campaign, choices);
    const loaded *l = find_base(r, choices);
    if (!l || !fill_slots(r, l, choices))
        return write_invalid(r, row, choices);
    if (scenario_run(l->scenario, varies ? &seed : NULL))
        return outcome_write(row, l->scenario);
    return outcome_write_broken(row, l->scenario);
}

outcome runner_row(runner *r, uint64_t number, buffer *row)
{
    choice choices[CAMPAIGN_FACTORS_MAX];
    sample_choose(choices, r->campaign, number);
    runner_write_head(r, row, number, choices);
    const outcome o = runner_run(r, row, choices);
    write_repeat(r, row, number);
    return o;
}

outcome runner_lost(runner *r, uint64_t number, const pool_loss *loss, buffer *row)
{
    choice choices[CAMPAIGN_FACTORS_MAX];
    sample_choose(choices, r->campaign, number);
    runner_write_head(r, row, number, choices);
    const outcome o = tally_lost(row, loss);
    write_repeat(r, row, number);
    return o;
}

/* Writes why a scenario that is valid has no result. */
static void explain_run(const campaign *c, scenario *s, const choice *choices, FILE *out)
{
    uint64_t seed;
    const bool varies = variant_seed(&seed, c, choices);
    if (scenario_run(s, varies ? &seed : NULL))
        return;
    char *why = scenario_why(s);
    fprintf(out, "%s\n", why ? why : "out of memory");
    free(why);
}

void runner_explain(const campaign *c, uint64_t number, FILE *out)
{
    choice choices[CAMPAIGN_FACTORS_MAX];
    runner *r = runner_new(c, true);
    scenario *s = NULL;
    sample_choose(choices, c, number);
    if (r)
        s = runner_load(r, choices, out);
    if (s)
        explain_run(c, s, choices, out);
    scenario_close(s);
    runner_free(r);
}
