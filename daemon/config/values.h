/* SPDX-License-Identifier: MIT
 *
 * values.h - reads single values: names, times, fractions, frames, nodes, states.
 */
#ifndef CANWIRE_CONFIG_VALUES_H
#define CANWIRE_CONFIG_VALUES_H

#include "config/walk.h"
#include "trace/frametext.h"

#define NODE_NAME_MAX CFG_NODE_NAME_MAX                  /* of a bus too */
#define RULE_NAME_MAX (CW_RULE_NAME_MAX - 1) /* length that the library distinguishes */

schema_reader cfg_read_time;      /* member: cfg_time */
schema_reader cfg_read_span;      /* the same, not 0 */
schema_reader cfg_read_ticks;     /* member: uint64_t, of a time */
schema_reader cfg_read_ticks_min; /* the same, not 0 */
schema_reader cfg_read_bits;      /* the same, of what acts at bits: warns when it is rounded */
schema_reader cfg_read_bits_min;  /* the same, not 0 */
schema_reader cfg_read_period;    /* ... of what comes again: warns only below one bit, since times
                                     keep to their grid as far as there are bits for them */
schema_reader cfg_read_fine;      /* member: cw_span, of a time */
schema_reader cfg_read_fine_min;  /* the same, not 0 */
schema_reader cfg_read_fraction;  /* member: uint64_t, of 2^64 */
schema_reader cfg_read_level;     /* object: a cw_rule; arg: cfg_levels */
schema_reader cfg_read_burst;     /* object: a cw_rule; N, or LEAST..MOST */
schema_reader cfg_read_frame;     /* member: cw_frame */
schema_reader cfg_read_filters;   /* frames; object: a cw_rule, or what begins with one */
schema_reader cfg_read_data;      /* the same */
schema_reader cfg_read_rate;      /* member: cw_phase_rate; arg: a schema_choice[] */
schema_reader cfg_read_window;    /* object: as that of cfg_read_filters; exact */
schema_reader cfg_read_position;  /* object: a cw_rule */
schema_reader cfg_read_line;      /* the same; wire, NODE.tx or NODE.rx */
schema_reader cfg_read_node_set;  /* member: uint64_t; a node or a list of them */

extern const schema_choice cfg_levels[]; /* dominant and recessive */

/* Reads a name of letters, digits, '_', '.' and '-'. It complains about other names, but returns
 * them, so that references to them still work. Returns NULL without a text. */
char *cfg_read_name(schema *self, const schema_key *key, const yaml_node_t *value,
                    size_t length_max);

bool cfg_name_valid(const char *name, size_t length_max);

/* Returns the index of the node that a value names, or -1 when there is none, which has been
 * reported. */
int cfg_read_node(schema *self, const schema_key *key, const yaml_node_t *value, const char *name);

/* Reads the name of a node into a uint8_t. */
schema_reader cfg_read_node_index;

/* Returns the node that a value names as a mask. Returns 0 after a complaint or when the name is
 * not known yet. */
uint64_t cfg_read_node_mask(schema *self, const schema_key *key, const yaml_node_t *value);

/* Returns true when rules may ask for CAN FD frames: a node knows them, or a profile is checked
 * alone. */
bool cfg_takes_fd(const schema *self);

/* Complains about a CAN FD frame that its node does not know. */
void cfg_check_sender(schema *self, const schema_key *key, const yaml_node_t *value,
                      const cw_frame *frame, size_t node);

/* Reads filters of candump, one or a list, behind those that `filters` has. Returns how many there
 * are then; at most `most`. */
unsigned cfg_read_filter_list(schema *self, const schema_key *key, yaml_node_t *value,
                              cw_filter *filters, unsigned count, unsigned most);

/* Reads data bytes, as long as frames of the bus may be. Returns what is wrong, or NULL. */
const char *cfg_parse_bytes(const schema *self, text_bytes *out, const char *text);

/* Returns the states that a value names, one or a list, as bits. */
uint8_t cfg_read_states(schema *self, const schema_key *key, yaml_node_t *value);

/* Warns about a time that acts at bits and is not a whole number of them. */
void cfg_warn_rounded(schema *self, const schema_key *key, const yaml_node_t *value,
                      uint64_t ticks);

/* The words of `order`, and of `missing-port`. */
extern const schema_choice cfg_orders[], cfg_missing_ports[];

/* Returns the map of a node: an item of the list `nodes`, or `guests` for the first guest. */
yaml_node_t *cfg_node_map(schema *self, yaml_node_t *nodes, size_t i);

#endif
