/* SPDX-License-Identifier: MIT
 *
 * protect.h - counters and checksums of periodic frames.
 */
#ifndef CANWIRE_CONFIG_PROTECT_H
#define CANWIRE_CONFIG_PROTECT_H

#include "config/walk.h"

schema_reader cfg_read_counter, cfg_read_checksum; /* object: a cfg_traffic */

/* Checks counter and checksum of an entry, whose keys have been read, against each other and
 * against its frame. */
void cfg_complete_protection(schema *self, yaml_node_t *map, cfg_traffic *traffic);

/* Collects what all entries say. All nodes have been read from the list. */
void cfg_collect_protections(schema *self, yaml_node_t *nodes);

/* Complains when a rule on counters or checksums waits for no frame that has one. */
void cfg_check_protected(schema *self, const yaml_node_t *at, const cw_rule *rule);

#endif
