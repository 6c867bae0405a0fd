/* SPDX-License-Identifier: MIT
 *
 * live.h - the configuration that is in effect: that of the file, with the rules of now.
 *
 * The library keeps no names of rules. Here they are, by the index that the library counts a rule
 * under: those of the configuration and those that were injected while the bus runs.
 */
#ifndef CANWIRE_RUN_LIVE_H
#define CANWIRE_RUN_LIVE_H

#include "config/config.h"

typedef struct live live;

/* Takes the configuration over; it is freed with it. NULL when there is no memory; the
 * configuration is then still the caller's. */
live *live_new(cfg *config);

/* NULL is fine. */
void live_free(live *l);

/* Goes over to another configuration, which it takes over; the old one is freed, injected rules are
 * forgotten. */
void live_replace(live *l, cfg *config);

/* What is in effect; always the same pointer. Entry i of its rules is rule i of the bus; where
 * there is none, its name is NULL. */
const cfg *live_config(const live *l);

/* The names alone, for cfg_load_rules(). */
cfg_running live_running(const live *l);

/* The index of a rule that is there. */
bool live_find(const live *l, unsigned *index, const char *name);

/* Whether a rule was injected, not configured. */
bool live_is_injected(const live *l, unsigned index);

/* Notes an injected rule under the index that the bus gave it; copies the rule. The name is from
 * malloc() and is taken. */
void live_put(live *l, unsigned index, const cw_rule *rule, char *name);

/* Forgets a rule that was taken away. */
void live_remove(live *l, unsigned index);

#endif
