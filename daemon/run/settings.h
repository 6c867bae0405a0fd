/* SPDX-License-Identifier: MIT
 *
 * settings.h - the settings of a node that can change while the bus runs, as JSON.
 *
 * Keys are those of a node in the configuration: modes, restart-ms, queue, order, warning-limit.
 */
#ifndef CANWIRE_RUN_SETTINGS_H
#define CANWIRE_RUN_SETTINGS_H

#include "canwire.h"

#include <jansson.h>

#define SETTINGS_ERROR_MAX 240

/* Reads an object; values may be texts as in KEY=VALUE. An error returns false and leaves *out
 * unchanged; `error` then names the problem and the allowed values. */
bool settings_from_json(cw_settings *out, char error[SETTINGS_ERROR_MAX], const json_t *object);

/* Returns the settings that `which` and the mask of the modes name; settings_from_json() reads them
 * back. */
json_t *settings_given_to_json(const cw_settings *settings);

/* Returns all settings, whatever `which` selects. */
json_t *settings_to_json(const cw_settings *settings);

#endif
