/* SPDX-License-Identifier: MIT
 *
 * parts.h - the parts of a configuration, each read by a file of its own. schema.user is a
 *           cfg_walk.
 */
#ifndef CANWIRE_CONFIG_PARTS_H
#define CANWIRE_CONFIG_PARTS_H

#include "config/walk.h"

/* Each of these reads the value of a key of the file; object: the cfg, with the keys before it
 * already read (load.c has their order). */
schema_reader cfg_read_bus;      /* bus.c */
schema_reader cfg_read_defaults; /* node.c */
schema_reader cfg_read_nodes;    /* the same */
schema_reader cfg_read_profiles; /* profile.c */
schema_reader cfg_read_faults;   /* rule.c */
schema_reader cfg_read_expect;   /* expect.c */
schema_reader cfg_read_record;   /* record.c */
schema_reader cfg_read_lcm;      /* lcm.c */

schema_reader cfg_read_action;  /* `do`; object: a cw_rule whose `when` has been read */
schema_reader cfg_read_traffic; /* object: a cfg_node whose port has been read */

/* What a node is that says nothing: its name is not known, it is found by no name. */
void cfg_node_defaults(cfg_node *node);

/* Adds a list of rules to the configuration, or one rule. */
void cfg_read_rules(schema *self, const schema_key *key, yaml_node_t *value);

/* Whether a document is a profile and no configuration. */
bool cfg_is_profile(schema *self, const yaml_node_t *root);

/* Reads rules from the root of a profile, which may have its own `with`. With walk->any_node
 * parameters without default stand for anything. */
void cfg_read_profile(schema *self, yaml_node_t *root);

#endif
