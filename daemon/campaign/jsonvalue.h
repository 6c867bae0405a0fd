/* SPDX-License-Identifier: MIT
 *
 * jsonvalue.h - values of a YAML document as JSON, which YAML is, too.
 */
#ifndef CANWIRE_CAMPAIGN_JSONVALUE_H
#define CANWIRE_CAMPAIGN_JSONVALUE_H

#include "base/schema.h"

/* Returns the value as JSON, in memory of the schema, or NULL after a complaint. Plain numbers,
 * true, false and null stay what they are; other words become strings. */
const char *jsonvalue_of(schema *self, const yaml_node_t *value);

#endif
