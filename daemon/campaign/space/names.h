/* SPDX-License-Identifier: MIT
 *
 * names.h - names that factors bring into the scenario: those of rules, and of keys.
 */
#ifndef CANWIRE_CAMPAIGN_NAMES_H
#define CANWIRE_CAMPAIGN_NAMES_H

#include "campaign/campaign_owner.h"

/* Complains, at entries of the list of factors, about spaces whose rules have the names of other
 * rules. */
void names_check_rules(schema *self, yaml_node_t *list, const campaign_owner *o);

/* Complains, at entries of the list of factors, about keys that are put into the scenario and that
 * it does not know. The rows are known. */
void names_check_keys(schema *self, yaml_node_t *list, const campaign_owner *o);

#endif
