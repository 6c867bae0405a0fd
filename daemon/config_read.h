/* SPDX-License-Identifier: MIT
 *
 * config_read.h - readers that the parts of the configuration share. schema.user is the cfg.
 */
#ifndef CANWIRE_CONFIG_READ_H
#define CANWIRE_CONFIG_READ_H

#include "config.h"
#include "schema.h"

#define NODE_NAME_MAX 32u                    /* of a bus too */
#define RULE_NAME_MAX (CW_RULE_NAME_MAX - 1) /* what the library tells apart */

schema_reader cfg_read_faults; /* object: the cfg, with its bit rate and nodes already read */
schema_reader cfg_read_time;   /* member: cfg_time */
schema_reader cfg_read_span;   /* the same, not 0 */

/* A name, from letters, digits, '_', '.' and '-'; complains about others, but returns them, so that
 * what refers to them is still understood. NULL when there is no text. */
char *cfg_read_name(schema *self, const schema_key *key, const yaml_node_t *value,
                    size_t length_max);

#endif
