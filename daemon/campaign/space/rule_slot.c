/* SPDX-License-Identifier: MIT
 *
 * rule_slot.c - the rules of a configuration that factors change alone, by the values of these.
 */
#include "campaign/space/rule_slot.h"

#include <stdlib.h>
#include <string.h>

/* Returns true for a factor whose values have numbers. */
static bool is_counted(const campaign *c, const factor *f)
{
    const bool drawn = f->kind == FACTOR_UNIFORM || f->kind == FACTOR_NORMAL;
    const bool product = c->sample == SAMPLE_FULL || c->sample == SAMPLE_PAIRWISE;
    return !drawn || product;
}

static rule_slot *find_slot(rule_slot *slots, size_t count, const char *name)
{
    for (size_t i = 0; i < count; i++)
        if (strcmp(slots[i].names[0], name) == 0)
            return &slots[i];
    return NULL;
}

static void add_factor(rule_slot *slot, const factor *f, size_t number)
{
    slot->factors |= UINT64_C(1) << number;
    slot->values = f->count > RULE_SLOT_VALUES_MAX ? RULE_SLOT_VALUES_MAX + 1
                                                   : slot->values * f->count;
}

/* Slots with too many values are left out: their factors then change the whole configuration. */
static size_t drop_large(rule_slot *slots, size_t count)
{
    size_t kept = 0;
    for (size_t i = 0; i < count; i++)
        if (slots[i].values <= RULE_SLOT_VALUES_MAX)
            slots[kept++] = slots[i];
    return kept;
}

size_t rule_slot_find(rule_slot slots[CAMPAIGN_FACTORS_MAX], const campaign *c)
{
    size_t count = 0;
    for (size_t i = 0; i < c->factor_count; i++) {
        const factor *f = &c->factors[i];
        if (!f->rule_names[0])
            continue;
        rule_slot *slot = find_slot(slots, count, f->rule_names[0]);
        if (!slot) {
            slot = &slots[count++];
            *slot = (rule_slot){.names = {f->rule_names[0], f->rule_names[1]}, .values = 1};
        }
        if (is_counted(c, f) && slot->values <= RULE_SLOT_VALUES_MAX)
            add_factor(slot, f, i);
        else
            slot->values = RULE_SLOT_VALUES_MAX + 1;
    }
    return drop_large(slots, count);
}

uint64_t rule_slot_value(const rule_slot *slot, const campaign *c, const choice *choices)
{
    uint64_t value = 0;
    for (size_t i = 0; i < c->factor_count; i++)
        if (slot->factors >> i & 1)
            value = value * c->factors[i].count + choices[i].index;
    return value;
}

static int rule_slot_find_rule(const cfg *config, const char *name)
{
    for (size_t i = 0; i < config->rule_count; i++)
        if (strcmp(config->rules[i].name, name) == 0)
            return (int)i;
    return -1;
}

/* Frees the rules of all combinations; they are loaded again when they are needed. */
static void rule_slot_forget(rule_slot *slot)
{
    for (uint64_t i = 0; slot->rules && i < slot->values; i++)
        free(slot->rules[i]);
    free(slot->rules);
    slot->rules = NULL;
}

bool rule_slot_begin(rule_slot *slot, const cfg *config)
{
    rule_slot_forget(slot);
    slot->rules = calloc((size_t)slot->values, sizeof(cw_rule *));
    slot->shown = UINT64_MAX;
    for (unsigned i = 0; i < 2 && slot->names[i]; i++) {
        slot->index[i] = rule_slot_find_rule(config, slot->names[i]);
        if (slot->index[i] < 0)
            return false;
    }
    return slot->rules;
}

void rule_slot_free(rule_slot *slot)
{
    rule_slot_forget(slot);
}
