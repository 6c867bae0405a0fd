/* SPDX-License-Identifier: MIT
 *
 * wake.h - the keys about what wakes a sleeping node, of a configuration and of `canwire set`.
 */
#ifndef CANWIRE_CONFIG_WAKE_H
#define CANWIRE_CONFIG_WAKE_H

#include "config/source.h"

#define WAKE_TEXT_MAX 256 /* bytes of a printed value with its final 0 */

/* Reads a value: "5us", "123,100:700", "off". Returns NULL, or what is allowed. */
const char *cfg_wake_parse(cw_sleep_settings *out, const schema_key *key, const char *text);

/* Prints it so that it can be read again. */
void cfg_wake_print(char out[WAKE_TEXT_MAX], const cw_sleep_settings *settings,
                    const schema_key *key);

/* Reads the value of a key in a configuration. */
void cfg_wake_read_into(schema *self, const schema_key *key, yaml_node_t *value,
                   cw_sleep_settings *out);

#endif
