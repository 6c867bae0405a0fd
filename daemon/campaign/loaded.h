/* SPDX-License-Identifier: MIT
 *
 * loaded.h - scenarios that are loaded, by the values that they were loaded with.
 *
 * When there is no room for another one, the one that was used least recently goes.
 */
#ifndef CANWIRE_CAMPAIGN_LOADED_H
#define CANWIRE_CAMPAIGN_LOADED_H

#include "campaign/space/rule_slot.h"
#include "campaign/scenario.h"

#define LOADED_MAX 64u

typedef struct loaded {
    scenario *scenario; /* NULL: an empty place */
    buffer key;        /* the values, as a text */
    uint64_t used;      /* the larger, the later */
    size_t slot_count;  /* 0: the scenario has no slots */
    rule_slot *slots;
} loaded;

/* All zeros is an empty one without room. */
typedef struct loaded_list {
    size_t room; /* at most LOADED_MAX */
    uint64_t uses;
    loaded places[LOADED_MAX];
} loaded_list;

/* Returns the scenario with this key, or NULL. */
loaded *loaded_find(loaded_list *list, const buffer *key);

/* Keeps a scenario, which the list then owns, with copies of the key and of the slots. These must
 * have no rules yet. Returns its place, which stays until the next call, or NULL without memory:
 * the scenario is then closed. */
loaded *loaded_keep(loaded_list *list, scenario *s, const buffer *key, const rule_slot *slots,
                    size_t slot_count);

/* Closes all scenarios. The room stays. */
void loaded_clear(loaded_list *list);

#endif
