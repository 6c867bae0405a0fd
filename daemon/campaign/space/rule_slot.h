/* SPDX-License-Identifier: MIT
 *
 * rule_slot.h - the rules of a configuration that factors change alone, by the values of these.
 */
#ifndef CANWIRE_CAMPAIGN_RULE_SLOT_H
#define CANWIRE_CAMPAIGN_RULE_SLOT_H

#include "campaign/space/sample.h"

#define RULE_SLOT_VALUES_MAX 16384u

/* A rule, or the pair of rules of a space. */
typedef struct rule_slot {
    const char *names[2]; /* of the rules; the second may be NULL */
    uint64_t factors;     /* that change it, as a set */
    uint64_t values;      /* combinations of their values */
    uint64_t shown;       /* the combination that the configuration has now */
    int index[2];         /* of the rules in the configuration */
    cw_rule **rules;      /* for each combination two, or NULL: not loaded yet */
} rule_slot;

/* Finds the slots of a campaign. Returns their number. */
size_t rule_slot_find(rule_slot slots[CAMPAIGN_FACTORS_MAX], const campaign *c);

/* Returns the number of the combination that the choices make. */
uint64_t rule_slot_value(const rule_slot *slot, const campaign *c, const choice *choices);

/* Forgets all rules: the rest of the configuration has changed. Returns false when the
 * configuration lacks these rules, or without memory. */
bool rule_slot_begin(rule_slot *slot, const cfg *config);

void rule_slot_free(rule_slot *slot);

#endif
