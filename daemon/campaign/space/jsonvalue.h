/* SPDX-License-Identifier: MIT
 *
 * jsonvalue.h - values of a YAML document as JSON, which YAML is, too.
 */
#ifndef CANWIRE_CAMPAIGN_JSONVALUE_H
#define CANWIRE_CAMPAIGN_JSONVALUE_H

#include "base/schema.h"

#define JSONVALUE_ALL_MAX (64u << 20) /* bytes of all values of a file */

/* Returns the value as JSON, in memory of the schema, or NULL after a complaint. Plain numbers,
 * true, false and null stay what they are; other words become strings. Aliases are written out.
 * *left are the bytes that all values may still have. */
const char *jsonvalue_of(schema *self, const yaml_node_t *value, size_t *left);

#endif
