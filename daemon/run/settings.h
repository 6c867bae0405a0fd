/* SPDX-License-Identifier: MIT
 *
 * settings.h - the settings of a node that can change while the bus runs, as JSON.
 *
 * Keys are those of a node in the configuration that change (config/live.h).
 */
#ifndef CANWIRE_RUN_SETTINGS_H
#define CANWIRE_RUN_SETTINGS_H

#include "config/change/retime.h"

#include <jansson.h>

#define SETTINGS_ERROR_MAX 720

/* Reads an object; values may be texts as in KEY=VALUE. An error returns false and leaves *out and
 * *time unchanged; `error` then names the problem and the allowed values. */
bool settings_from_json(cw_settings *out, cfg_retime *time, char error[SETTINGS_ERROR_MAX],
                        const json_t *object);

/* Returns the settings that `which` and the mask of the modes name. `time` adds the given keys of
 * the bit timing; it may be NULL. settings_from_json() reads all of them back. */
json_t *settings_given_to_json(const cw_settings *settings, const cfg_retime *time);

/* Returns all settings but the bit timing, whatever `which` selects. */
json_t *settings_to_json(const cw_settings *settings);

#endif
