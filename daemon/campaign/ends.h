/* SPDX-License-Identifier: MIT
 *
 * ends.h - scenarios without an end, which are found before any row runs.
 */
#ifndef CANWIRE_CAMPAIGN_ENDS_H
#define CANWIRE_CAMPAIGN_ENDS_H

#include "campaign/campaign_owner.h"

/* Notes what never ends in a bus of the scenario, if it is the first such bus. `inside`: the bus is
 * in the text of the scenario, and not in another file. */
void ends_note(campaign_owner *o, schema *self, const cfg *config, bool inside);

/* Complains at the key `scenario` about what never ends, if there is no `until`, no program that
 * ends, and no factor can change that. The factors have been read. */
void ends_check(schema *self, const yaml_node_t *root, campaign_owner *o);

#endif
