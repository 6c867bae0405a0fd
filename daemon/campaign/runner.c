/* SPDX-License-Identifier: MIT
 *
 * runner.c - runs the rows of a campaign, and writes them.
 */
#include "campaign/runner.h"

#include "campaign/rule_slot.h"
#include "campaign/shellword.h"
#include "campaign/tally.h"
#include "campaign/variant.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define NUMBER_MAX 32 /* bytes of " --only N" */

struct runner {
    const campaign *campaign;
    bool reload;
    scenario *scenario;   /* NULL: none is loaded */
    rowtext key;          /* the values of the factors that it was loaded with, but for slots */
    rowtext text;
    rowtext repeat;
    uint64_t slot_factors; /* of all slots, as a set */
    bool has_slots;       /* the scenario has the rules of the slots */
    size_t slot_count;
    rule_slot slots[CAMPAIGN_FACTORS_MAX];
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
    for (size_t i = 0; i < r->slot_count; i++)
        rule_slot_free(&r->slots[i]);
    scenario_close(r->scenario);
    rowtext_free(&r->key);
    rowtext_free(&r->text);
    rowtext_free(&r->repeat);
    free(r);
}

/* ---- Loading --------------------------------------------------------------------------------- */

static scenario *load(runner *r, const choice *choices, FILE *messages)
{
    const campaign *c = r->campaign;
    rowtext_clear(&r->text);
    variant_text(&r->text, c, choices);
    const cfg_file file = {.name = c->scenario_name, .text = buffer_first(&r->text.bytes),
                           .size = buffer_length(&r->text.bytes)};
    scenario *s = r->text.no_memory ? NULL : scenario_open(&file, messages);
    const char *wrong = s && c->until ? scenario_set_until(s, c->until_time) : NULL;
    if (wrong && messages)
        fprintf(messages, "%s: until: %s\n", c->file, wrong);
    if (s && !wrong && scenario_ends(s, "give `until` in the campaign", messages))
        return s;
    scenario_close(s);
    return NULL;
}

static bool begin_slots(runner *r)
{
    bool good = r->scenario->alone != NULL;
    for (size_t i = 0; i < r->slot_count && good; i++)
        good = rule_slot_begin(&r->slots[i], r->scenario->alone);
    return good;
}

/* Writes the values of the factors that change more than a rule. */
static void write_key(runner *r, rowtext *key, const choice *choices, uint64_t without)
{
    const campaign *c = r->campaign;
    rowtext_clear(key);
    for (size_t i = 0; i < c->factor_count; i++) {
        if (c->factors[i].is_seed || (without >> i & 1))
            continue;
        sample_value(key, &c->factors[i], &choices[i]);
        rowtext_put(key, "\n");
    }
}

static bool is_same(const rowtext *a, const rowtext *b)
{
    const size_t length = buffer_length(&a->bytes);
    return !a->no_memory && !b->no_memory && length == buffer_length(&b->bytes) &&
           (length == 0 || memcmp(buffer_first(&a->bytes), buffer_first(&b->bytes), length) == 0);
}

/* Loads the scenario of the choices, if another one is loaded. */
static bool load_base(runner *r, const choice *choices)
{
    rowtext key = {.no_memory = false};
    if (r->scenario && !r->has_slots)
        r->slot_factors = 0; /* nothing is shared */
    write_key(r, &key, choices, r->slot_factors);
    if (r->scenario && !r->reload && is_same(&key, &r->key)) {
        rowtext_free(&key);
        return true;
    }
    rowtext_free(&r->key);
    r->key = key;
    scenario_close(r->scenario);
    r->scenario = load(r, choices, NULL);
    r->has_slots = r->scenario && r->slot_factors && begin_slots(r);
    for (size_t i = 0; i < r->slot_count && r->has_slots; i++)
        r->slots[i].shown = rule_slot_value(&r->slots[i], r->campaign, choices);
    return r->scenario;
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
static bool load_rules(runner *r, rule_slot *slot, uint64_t value, const choice *choices)
{
    scenario *s = load(r, choices, NULL);
    const bool same = s && s->alone && s->alone->rule_count == r->scenario->alone->rule_count;
    if (same)
        slot->rules[value] = copy_rules(slot, s->alone);
    scenario_close(s);
    return same && slot->rules[value];
}

/* Puts the rules of a slot into the configuration, which keeps their names. */
static void show(const rule_slot *slot, uint64_t value, const cfg *config)
{
    for (unsigned i = 0; i < 2 && slot->names[i]; i++) {
        cw_rule *rule = &config->rules[slot->index[i]];
        const char *name = rule->name;
        *rule = slot->rules[value][i];
        rule->name = name;
    }
}

static bool fill_slots(runner *r, const choice *choices)
{
    for (size_t i = 0; i < r->slot_count && r->has_slots; i++) {
        rule_slot *slot = &r->slots[i];
        const uint64_t value = rule_slot_value(slot, r->campaign, choices);
        if (value == slot->shown)
            continue;
        if (!slot->rules[value] && !load_rules(r, slot, value, choices))
            return false;
        show(slot, value, r->scenario->alone);
        slot->shown = value;
    }
    return true;
}

/* ---- Rows ------------------------------------------------------------------------------------ */

static void write_head(runner *r, rowtext *row, uint64_t number, const choice *choices)
{
    const campaign *c = r->campaign;
    uint64_t seed = c->scenario_seed;
    rowtext_put(row, "{");
    rowtext_number(row, "number", number);
    rowtext_key(row, "factors");
    rowtext_put(row, "{");
    for (size_t i = 0; i < c->factor_count; i++) {
        rowtext_key(row, c->factors[i].name);
        sample_value(row, &c->factors[i], &choices[i]);
    }
    rowtext_put(row, "}");
    (void)variant_seed(&seed, c, choices);
    rowtext_number(row, "seed", seed);
}

void runner_head(runner *r, uint64_t number, rowtext *row)
{
    choice choices[CAMPAIGN_FACTORS_MAX];
    sample_choose(choices, r->campaign, number);
    write_head(r, row, number, choices);
    rowtext_put(row, ",\"outcome\":\"");
}

static void write_repeat(runner *r, rowtext *row, uint64_t number)
{
    char only[NUMBER_MAX];
    (void)snprintf(only, sizeof only, " --only %" PRIu64, number);
    shellword_begin(&r->repeat, "canwire campaign run", r->campaign->file);
    rowtext_put(&r->repeat, only);
    rowtext_end(row, &r->repeat);
}

static outcome run(runner *r, rowtext *row, const choice *choices)
{
    uint64_t seed;
    const bool varies = variant_seed(&seed, r->campaign, choices);
    if (!load_base(r, choices) || !fill_slots(r, choices)) {
        outcome_write_none(row, OUTCOME_INVALID, "");
        return OUTCOME_INVALID;
    }
    if (scenario_run(r->scenario, varies ? &seed : NULL))
        return outcome_write(row, r->scenario);
    return outcome_write_broken(row, r->scenario);
}

outcome runner_row(runner *r, uint64_t number, rowtext *row)
{
    choice choices[CAMPAIGN_FACTORS_MAX];
    sample_choose(choices, r->campaign, number);
    write_head(r, row, number, choices);
    const outcome o = run(r, row, choices);
    write_repeat(r, row, number);
    return o;
}

outcome runner_lost(runner *r, uint64_t number, const pool_loss *loss, rowtext *row)
{
    choice choices[CAMPAIGN_FACTORS_MAX];
    sample_choose(choices, r->campaign, number);
    write_head(r, row, number, choices);
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
        s = load(r, choices, out);
    if (s)
        explain_run(c, s, choices, out);
    scenario_close(s);
    runner_free(r);
}
