/* SPDX-License-Identifier: MIT
 *
 * campaign_owner.h - what the readers of a campaign share (schema.user).
 */
#ifndef CANWIRE_CAMPAIGN_CAMPAIGN_OWNER_H
#define CANWIRE_CAMPAIGN_CAMPAIGN_OWNER_H

#include "base/schema.h"
#include "campaign/campaign.h"

/* campaign_load() returns its first member. */
typedef struct campaign_owner {
    campaign campaign;
    arena arena;
    FILE *errors;             /* of the scenario */
    cfg *config;              /* of the scenario; NULL for a rig */
    size_t json_left;         /* bytes that values of factors may still have */
    bool has_document;
    yaml_document_t document; /* of the scenario */
    const char *unending;     /* a message about what never ends in it; NULL: all ends */
    cfg_place unending_at;
    bool unending_inside;     /* ... in the text of the scenario */
    bool unending_rule;       /* it is a rule */
} campaign_owner;

/* The keys of the file, and of maps in it. */
extern const schema_key campaign_file_keys[], campaign_factor_keys[], campaign_ecu_keys[];

/* Reads the key `vary`. */
schema_reader campaign_read_factors; /* object: a campaign_owner */

/* Complains when the scenario has virtual time, but its programs have not. */
void campaign_check_virtual(schema *self, yaml_node_t *root, const campaign_owner *o);

#endif
