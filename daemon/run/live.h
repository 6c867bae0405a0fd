/* SPDX-License-Identifier: MIT
 *
 * live.h - the configuration that is in effect: the file's, with the present rules.
 *
 * The library keeps no names of rules. This file keeps them by the library's index of a rule, for
 * configured rules and for injected ones.
 */
#ifndef CANWIRE_RUN_LIVE_H
#define CANWIRE_RUN_LIVE_H

#include "config/config.h"

typedef struct live live;

/* Takes over the configuration and frees it at its own end. Returns NULL without memory; the caller
 * then keeps the configuration. */
live *live_new(cfg *config);

/* Frees the configuration. NULL is allowed. */
void live_free(live *l);

/* Takes over another configuration. It frees the old one and forgets injected rules. */
void live_replace(live *l, cfg *config);

/* Goes back to the configuration of the file, with another seed: injected rules are forgotten, and
 * guests have their own names. */
void live_restart(live *l, uint64_t seed);

/* Returns the configuration in effect; the pointer stays the same. Entry i of its rules is rule i
 * of the bus; the name of a missing rule is NULL. */
const cfg *live_config(const live *l);

/* Gives a guest the name that its client has said; NULL: its own again. It keeps the name when
 * another configuration replaces this one. */
void live_name_guest(live *l, unsigned node, const char *name);

/* Notes what the keys of a node's clock and bit timing are now. */
void live_set_time(live *l, unsigned node, const cfg_node_time *time);

/* Returns the names alone, for cfg_load_rules(). */
cfg_running live_running(const live *l);

/* Finds the index of a rule. */
bool live_find(const live *l, unsigned *index, const char *name);

/* Returns true for an injected rule, and false for a configured one. */
bool live_is_injected(const live *l, unsigned index);

/* Notes an injected rule under its index on the bus; copies the rule. The name is from malloc() and
 * is taken over. */
void live_put(live *l, unsigned index, const cw_rule *rule, char *name);

/* Forgets a removed rule. */
void live_remove(live *l, unsigned index);

#endif
