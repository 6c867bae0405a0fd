/* SPDX-License-Identifier: MIT
 *
 * edits.h - where the values of factors go in the text of the scenario.
 */
#ifndef CANWIRE_CAMPAIGN_EDITS_H
#define CANWIRE_CAMPAIGN_EDITS_H

#include "campaign/campaign_owner.h"

/* Finds the places of the rules of spaces. Complains, at entries of the list of factors, about
 * values that would be put into each other. */
void campaign_place_edits(schema *self, yaml_node_t *list, campaign_owner *o);

#endif
