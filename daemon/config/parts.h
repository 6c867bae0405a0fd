/* SPDX-License-Identifier: MIT
 *
 * parts.h - the parts of a configuration, each read by a file of its own. schema.user is a
 *           cfg_walk.
 */
#ifndef CANWIRE_CONFIG_PARTS_H
#define CANWIRE_CONFIG_PARTS_H

#include "config/walk.h"

/* Each reads the value of a key of the file. `object` is the cfg; earlier keys have been read
 * (load.c has their order). */
schema_reader cfg_read_bus;      /* bus.c */
schema_reader cfg_read_defaults; /* node.c */
schema_reader cfg_read_nodes;    /* the same */
schema_reader cfg_read_profiles; /* profile.c */
schema_reader cfg_read_faults;   /* rule.c */
schema_reader cfg_read_expect;   /* expect.c */
schema_reader cfg_read_expect_report; /* the same */
schema_reader cfg_read_record;   /* record.c */
schema_reader cfg_read_lcm;      /* lcm.c */
schema_reader cfg_read_virtual;  /* virtual.c */
schema_reader cfg_read_metrics;  /* metrics.c */

/* Sets what the keys of the bus leave out. */
void cfg_bus_presets(schema *self, cfg *config);

/* Complains when frames are to begin at their ticks, and bits of nodes differ. The nodes are
 * complete. */
void cfg_check_start(schema *self, const yaml_node_t *bus);

/* Gives a bus in virtual time what its keys do not say. All keys of the file have been read. */
void cfg_complete_virtual(schema *self, yaml_node_t *root, cfg *config);

/* The tables of keys, for the JSON schema (daemon/schema). */
extern const schema_key cfg_file_keys[], cfg_bus_keys[], cfg_profile_keys[],
    cfg_profile_use_keys[], cfg_rule_keys[], cfg_expect_keys[], cfg_record_keys[], cfg_lcm_keys[],
    cfg_virtual_keys[], cfg_usb_keys[], cfg_peer_keys[], cfg_clients_keys[], cfg_model_keys[],
    cfg_mailbox_keys[], cfg_local_time_keys[], cfg_schedule_keys[], cfg_counter_keys[],
    cfg_checksum_keys[];
extern const schema_key cfg_edge_keys[]; /* two cw_span, by the level after an edge */

/* The kinds of maps that cfg_profile_keys are for. */
#define CFG_IN_PROFILES 1u
#define CFG_IN_INJECTED 2u

/* Returns the keys of form i of a map, the first of which names the form, or NULL. */
typedef const schema_key *cfg_form(size_t i, schema_key room[SCHEMA_KEYS_MAX]);
cfg_form cfg_action_form, cfg_traffic_form;

/* Return the name of a subject or a condition of expectations, or NULL; and whether a subject has a
 * condition. */
const char *cfg_expect_subject(size_t i);
const char *cfg_expect_condition(size_t i);
bool cfg_expect_has(size_t of, size_t i);

schema_reader cfg_read_action;  /* `do`; object: a cw_rule whose `when` has been read */
/* Actions that act for parts of bits, action_time.c. */
extern const schema_key cfg_pulse_keys[], cfg_jitter_keys[], cfg_ramp_keys[];
/* The action `raw`, action_raw.c. */
extern const schema_key cfg_raw_keys[];
void cfg_complete_raw(schema *self, yaml_node_t *map, cw_rule *rule);

schema_reader cfg_read_ramp; /* `ramp` of a rule that sets; object: a cw_rule */
void cfg_complete_ramp(schema *self, yaml_node_t *map, cw_rule *rule);
/* A key of a rule that sets; its row of cfg_node_keys is in the column `live`. */
schema_reader cfg_read_setting;
schema_reader cfg_read_retime; /* a row of time of such a rule */

void cfg_complete_retime(schema *self, yaml_node_t *map, cw_rule *rule);

/* Keys of nodes, node.c; object: a cfg_node. */
schema_reader cfg_read_node_name, cfg_read_port, cfg_read_guest_port, cfg_read_peer,
    cfg_read_missing_port, cfg_read_mode, cfg_read_when_full, cfg_read_fd, cfg_read_exception,
    cfg_read_wake;

schema_reader cfg_read_traffic; /* object: a cfg_node whose port has been read */

/* Complains about frames of traffic that their nodes do not know. All nodes have been read from the
 * list. */
void cfg_check_traffic(schema *self, yaml_node_t *nodes);

schema_reader cfg_read_clients; /* of `defaults`: a number, or a map; clients.c */
schema_reader cfg_read_port_clients; /* of a node whose port has been read */

/* Keys of all guests, guests.c. The first guest is read with the nodes, and completed as they are.
 * The others are copies of it. */
schema_reader cfg_read_guests; /* object: the cfg */
schema_reader cfg_read_guest_count; /* object: a cfg_node */
void cfg_add_guest(schema *self, const schema_key *keys);
void cfg_copy_guests(schema *self);

/* Keys of nodes about time, node_time.c; object: a cfg_node. */
schema_reader cfg_read_clock, cfg_read_ppm, cfg_read_length, cfg_read_edge_delays;
schema_reader cfg_read_sample_point; /* member: uint16_t, permille */

/* Keys of nodes about their controllers, controller.c; object: a cfg_node. */
schema_reader cfg_read_controller; /* a name, or a map */
schema_reader cfg_read_acceptance; /* filters */

schema_reader cfg_read_mailboxes;  /* of a model: their number, or a list. mailbox.c */

/* Gives a controller mailboxes: some for received frames of any identifier, then others for frames
 * to send. */
void cfg_add_mailboxes(schema *self, cfg_controller *controller, unsigned receive,
                       unsigned transmit);

/* Keys of nodes about time-triggered operation, schedule.c; object: a cfg_node. The first one and
 * the modes are read before the second one. */
schema_reader cfg_read_local_time, cfg_read_schedule;
void cfg_check_schedules(schema *self, yaml_node_t *nodes);

/* Completes what the models of controllers say about other keys. All nodes have been read from the
 * list. */
void cfg_complete_controllers(schema *self, yaml_node_t *nodes);

/* Returns true when a key has no name of a controller, which has bit timings, but a model that has
 * none. */
bool cfg_is_model(schema *self, const char *key, const yaml_node_t *value);

/* Keys of the segments of a phase of a bit, whose names begin with a prefix: "", or "d" at the data
 * rate. segment_keys.c. The first one checks that a node, or `defaults`, says all or nothing of
 * them. The second one returns true when keys give them: a node's own sample point replaces those
 * of `defaults`. */
void cfg_check_together(schema *self, const yaml_node_t *map, const char *prefix);
bool cfg_gives_segments(schema *self, const yaml_node_t *item, const char *prefix);

/* Turns what the keys say into the timing of each node. All nodes have been read from the list. */
void cfg_complete_time(schema *self, yaml_node_t *nodes);

/* Checks the keys of CAN FD of all nodes against the bus and against each other. node_data.c */
void cfg_check_fd(schema *self, yaml_node_t *nodes);

/* Gives a node its data phase. Its own bit timing is complete. */
void cfg_complete_data(schema *self, yaml_node_t *item, cfg_node *node);

/* Adds what missing terminators cause to the ringing of the nodes that have no such key. Their
 * places are known. */
void cfg_add_ringing(schema *self, yaml_node_t *nodes); /* termination.c */

/* Complains of what the library does not take: cw_bus_check() is the one judge of that. early: of
 * the timing alone, since rules and traffic have not been read. */
void cfg_check_limits(schema *self, yaml_node_t *nodes, bool early); /* limits.c */

/* Warns of what ISO 11898 does not promise to work: clocks that differ too much, a line that is too
 * long, too many nodes. Their timing is complete. */
void cfg_check_pairs(schema *self, yaml_node_t *nodes); /* pairs.c */

/* Sets the values of a node without keys; its name is unknown, and no search finds it. */
void cfg_node_defaults(cfg_node *node);

/* Adds a list of rules to the configuration, or one rule. */
void cfg_read_rules(schema *self, const schema_key *key, yaml_node_t *value);

/* Returns true when a document is a profile and no configuration. */
bool cfg_is_profile(schema *self, const yaml_node_t *root);

/* Reads rules from the root of a profile, which may have its own `with`. With walk->any_node a
 * parameter without default matches any value. */
void cfg_read_profile(schema *self, yaml_node_t *root);

#endif
