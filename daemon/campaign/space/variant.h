/* SPDX-License-Identifier: MIT
 *
 * variant.h - the scenario of a row as a text.
 */
#ifndef CANWIRE_CAMPAIGN_VARIANT_H
#define CANWIRE_CAMPAIGN_VARIANT_H

#include "campaign/space/sample.h"

/* Writes the text of the scenario with the values of these choices. The seed of a rig is not in
 * it. */
void variant_text(buffer *out, const campaign *c, const choice *choices);

/* Writes it with the scenario's own values for a set of factors. */
void variant_text_without(buffer *out, const campaign *c, const choice *choices,
                          uint64_t without);

/* Reads the seed of the choices. Returns false when the seed does not vary. */
bool variant_seed(uint64_t *seed, const campaign *c, const choice *choices);

/* Returns the next factor in the order of the text, but for a set of those that are done, or
 * SIZE_MAX. */
size_t variant_next_edit(const campaign *c, uint64_t done);

#endif
