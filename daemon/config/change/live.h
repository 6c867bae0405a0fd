/* SPDX-License-Identifier: MIT
 *
 * live.h - how the keys of a node change while it is in use: by fault rules that set, and by
 *          `canwire set`. The table of node_keys.c has it in the column `live`.
 */
#ifndef CANWIRE_CONFIG_LIVE_H
#define CANWIRE_CONFIG_LIVE_H

#include "base/schema.h"
#include "config/change/retime.h"

typedef enum cfg_live_kind {
    CFG_LIVE_FIXED = 0, /* the configuration alone has it */
    CFG_LIVE_MODE,
    CFG_LIVE_NUMBER,
    CFG_LIVE_ORDER,
    CFG_LIVE_SLEEP,
    CFG_LIVE_WAKE_TIME,
    CFG_LIVE_WAKE_ON,
    CFG_LIVE_CLOCK, /* from here on those of config/retime.h */
    CFG_LIVE_PPM,
    CFG_LIVE_SAMPLE,
    CFG_LIVE_CLOCKS, /* or quanta */
    CFG_LIVE_SWITCH,
    CFG_LIVE_TDC,
    CFG_LIVE_DELAYS,
    CFG_LIVE_DELAY,
    CFG_LIVE_LENGTH
} cfg_live_kind;

typedef struct cfg_live {
    cfg_live_kind kind;
    unsigned which;    /* CW_MODE_*, or CW_SET_* */
    size_t offset;     /* of the member: in cw_settings; of keys of time in a cfg_retime */
    size_t bytes;      /* ... of a number */
    unsigned unit;     /* ... how many of these one is */
    unsigned time;     /* a retime_key */
    const char *range; /* for people, where the type does not say it */
} cfg_live;

/* The kinds of maps that have keys of nodes. */
#define CFG_IN_NODES 1u
#define CFG_IN_DEFAULTS 2u
#define CFG_IN_GUESTS 4u

/* All keys of nodes, in the order of reading and of lists. */
extern const schema_key cfg_node_keys[];

/* Returns how a key changes, or NULL for one that does not. */
static inline const cfg_live *cfg_live_of(const schema_key *key)
{
    return key->live;
}

static inline bool cfg_is_live(const schema_key *key)
{
    return key->live && cfg_live_of(key)->kind != CFG_LIVE_FIXED;
}

/* Returns true for a key that config/retime.h changes. */
static inline bool cfg_is_retime(const schema_key *key)
{
    return key->live && cfg_live_of(key)->kind >= CFG_LIVE_CLOCK;
}

/* Returns true for such a key of the data phase. */
static inline bool cfg_is_data(const schema_key *key)
{
    return cfg_is_retime(key) && cfg_live_of(key)->time >= RETIME_DSAMPLE_POINT &&
           cfg_live_of(key)->time <= RETIME_TDCV;
}

/* Returns the key of a name, or NULL. */
const schema_key *cfg_find_node_key(const char *name);

/* Put and return the value of a key of kind CFG_LIVE_NUMBER. */
void cfg_put_number(cw_settings *settings, const schema_key *key, uint64_t number);
uint64_t cfg_get_number(const cw_settings *settings, const schema_key *key);

/* Prints what values a key may have, for people. */
void cfg_print_range(char *text, size_t size, const schema_key *key);

#endif
