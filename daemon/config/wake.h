/* SPDX-License-Identifier: MIT
 *
 * wake.h - the keys about what wakes a sleeping node, of a configuration and of `canwire set`.
 */
#ifndef CANWIRE_CONFIG_WAKE_H
#define CANWIRE_CONFIG_WAKE_H

#include "config/source.h"

#define WAKE_FILTER_DEFAULT_TICKS (CW_CLOCK_HZ / 1000000 * 5) /* 5 us: the longest filter time of
                                                                 ISO 11898-2 */
#define WAKE_TEXT_MAX 256 /* bytes of a printed value with its final 0 */

typedef enum cfg_wake_key {
    CFG_WAKE_FILTER = 0,
    CFG_WAKE_TIME,
    CFG_WAKE_ON,
    CFG_WAKE_KEYS
} cfg_wake_key;

/* Find the key of a name, or CFG_WAKE_KEYS; the name of a key; and its CW_SET_*. */
cfg_wake_key cfg_wake_find(const char *name);
const char *cfg_wake_name(cfg_wake_key key);
unsigned cfg_wake_set(cfg_wake_key key);

/* Reads a value: "5us", "123,100:700", "off". Returns NULL, or what is allowed. */
const char *cfg_wake_parse(cw_sleep_settings *out, cfg_wake_key key, const char *text);

/* Prints it so that it can be read again. */
void cfg_wake_print(char out[WAKE_TEXT_MAX], const cw_sleep_settings *settings, cfg_wake_key key);

/* Reads the value of a key in a configuration. */
void cfg_wake_read(schema *self, const schema_key *key, yaml_node_t *value,
                   cw_sleep_settings *out);

#endif
